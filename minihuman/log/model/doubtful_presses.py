"""Key presses in earlier logs that had an effect although the participant may not have made them in the study's window.

Before the second version of the key rules, a session accepted every press that its window reported. SDL reports a press
for each key that is down when the window gains the focus, the X server sends the key's auto-repeat to pyglet, and a
page accepted a gamepad button that was held down.
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

from minihuman.experiment.machine.events import KeyPressed, Noted
from minihuman.log.model.session_log import Segment, SessionLog

_NS_PER_MS = 1_000_000
_SURELY_BEFORE_NS = 100 * _NS_PER_MS  # a window notices the focus within a few milliseconds
_AUTO_REPEAT_NS = 2_000 * _NS_PER_MS  # known systems repeat a held key after at most this
_PAD_FRAME_NS = 100 * _NS_PER_MS  # a page reads a gamepad once a frame
_NEVER_NS = 1 << 62
_EFFECTIVE_VERDICTS = ("accepted", "queued")
_MAX_LISTED = 5


class DoubtfulPress(NamedTuple):
    """A press that had an effect, and certainly or possibly was made before the window had the focus."""

    key: str
    t_ns: int  # when the session accepted it
    is_certain: bool  # whether the logged time of the press proves it


def find_doubtful_presses(log: SessionLog) -> list[DoubtfulPress]:
    """Return a session's doubtful presses, from the segments whose rules did not yet judge the causes of presses."""
    return [
        press for segment in log.segments if "key_rules" not in segment.facts for press in _find_in_segment(segment)
    ]


def describe_doubtful_presses(presses: Sequence[DoubtfulPress]) -> str:
    """Describe doubtful presses in one sentence; "" if there are none."""
    if not presses:
        return ""
    n_certain = sum(press.is_certain for press in presses)
    n_possible = len(presses) - n_certain
    listed = ", ".join(_format_press(press) for press in presses[:_MAX_LISTED])
    if len(presses) > _MAX_LISTED:
        listed += f" and {len(presses) - _MAX_LISTED} more"
    return (
        f"keys that were down before the window had the focus were accepted: {n_certain} for certain, {n_possible} "
        f"possibly ({listed})"
    )


def _format_press(press: DoubtfulPress) -> str:
    time_s = press.t_ns / 1e9
    return f"{press.key} at {time_s:.3f} s"


def _find_in_segment(segment: Segment) -> Iterator[DoubtfulPress]:
    """Yield the doubtful presses of a segment, which come soon after the window gained the focus."""
    gains_ns = [note.t_ns for note in segment.notes if isinstance(note, Noted) and _is_focus_gain(note)]
    downs = [press for press in segment.keys if press.down and press.verdict != "repeat"]
    for gain_ns, next_gain_ns in pairwise([*gains_ns, _NEVER_NS]):
        after_gain = [press for press in downs if gain_ns <= press.t_ns < next_gain_ns]
        for index, press in enumerate(after_gain):
            doubtful_press = _judge_press(press, gain_ns, segment.facts, is_first=index == 0)
            if doubtful_press and press.verdict in _EFFECTIVE_VERDICTS:
                yield doubtful_press


def _is_focus_gain(note: Noted) -> bool:
    return (note.kind, note.text) == ("focus", "found")


def _judge_press(press: KeyPressed, gain_ns: int, facts: dict[str, str], *, is_first: bool) -> DoubtfulPress | None:
    """Return a press as doubtful if its key may have been down before the window gained the focus; else None.

    Args:
        press: the press.
        gain_ns: the time at which the window gained the focus.
        facts: the segment's facts, which name the window.
        is_first: whether it is the first press after the window gained the focus.
    """
    pressed_ns = press.t_ns - press.waited_ns
    window = facts.get("window", "")
    if window == "pygame" and pressed_ns < gain_ns:
        return DoubtfulPress(press.key, press.t_ns, pressed_ns < gain_ns - _SURELY_BEFORE_NS)
    if not is_first:
        return None
    is_repeat = window == "pyglet" and pressed_ns < gain_ns + _AUTO_REPEAT_NS
    is_held_button = press.symbol == "gamepad" and pressed_ns < gain_ns + _PAD_FRAME_NS
    if is_repeat or is_held_button:
        return DoubtfulPress(press.key, press.t_ns, is_certain=False)
    return None
