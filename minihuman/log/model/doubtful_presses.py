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
_SURELY_BEFORE_NS = 100 * _NS_PER_MS  # a window that waits for the focus takes it up within a few milliseconds
_AUTO_REPEAT_NS = 2_000 * _NS_PER_MS  # no system that we know of waits longer before a held key repeats
_PAD_FRAME_NS = 100 * _NS_PER_MS  # a page reads a gamepad once a frame
_NEVER_NS = 1 << 62
_ACTED = ("accepted", "queued")


class DoubtfulPress(NamedTuple):
    """A press that had an effect, and certainly or possibly was made before the window had the focus."""

    key: str
    t_ns: int  # when the session took it
    is_certain: bool  # by the log's own record of when it went down


def find_doubtful_presses(log: SessionLog) -> list[DoubtfulPress]:
    """Return a session's doubtful presses, from segments that did not judge the causes of presses."""
    return [
        press for segment in log.segments if "key_rules" not in segment.facts for press in _find_in_segment(segment)
    ]


def describe_doubtful_presses(presses: Sequence[DoubtfulPress]) -> str:
    """Describe doubtful presses in one sentence; "" if there are none."""
    if not presses:
        return ""
    certain = [press for press in presses if press.is_certain]
    listed = ", ".join(f"{press.key} at {press.t_ns / 1e9:.3f} s" for press in presses[:5])
    more = f" and {len(presses) - 5} more" if len(presses) > 5 else ""
    return (
        f"keys that were down before the window had the focus were accepted: {len(certain)} for certain, "
        f"{len(presses) - len(certain)} possibly ({listed}{more})"
    )


def _find_in_segment(segment: Segment) -> Iterator[DoubtfulPress]:
    gains_ns = [note.t_ns for note in segment.notes if isinstance(note, Noted) and _is_gain(note)]
    downs = [press for press in segment.keys if press.down and press.verdict != "repeat"]
    for gain_ns, next_gain_ns in pairwise([*gains_ns, _NEVER_NS]):
        after = [press for press in downs if gain_ns <= press.t_ns < next_gain_ns]
        for place, press in enumerate(after):
            if press.verdict in _ACTED and (doubtful := _judge(press, gain_ns, segment.facts, is_first=place == 0)):
                yield doubtful


def _is_gain(note: Noted) -> bool:
    return (note.kind, note.text) == ("focus", "found")


def _judge(press: KeyPressed, gain_ns: int, facts: dict[str, str], *, is_first: bool) -> DoubtfulPress | None:
    pressed_ns = press.t_ns - press.waited_ns
    window = facts.get("window", "")
    if window == "pygame" and pressed_ns < gain_ns:
        return DoubtfulPress(press.key, press.t_ns, pressed_ns < gain_ns - _SURELY_BEFORE_NS)
    is_repeat = window == "pyglet" and is_first and pressed_ns < gain_ns + _AUTO_REPEAT_NS
    is_held_button = press.symbol == "gamepad" and is_first and pressed_ns < gain_ns + _PAD_FRAME_NS
    if is_repeat or is_held_button:
        return DoubtfulPress(press.key, press.t_ns, is_certain=False)
    return None
