"""The number of bytes that a page may send in a session: what its plan can honestly need, times a factor. No I/O.

A rate limit on messages alone would let one page write a gigabyte in twenty minutes, which fills the disk for everyone.
So would a long plan's bytes if a page had them all at once: its steps' are granted as fast as steps can be made.
"""

from collections.abc import Callable

from minihuman.experiment.keys import MOUSE_AXES, TOUCH_AXES
from minihuman.experiment.plan.session_plan import EpisodePlan, SessionPlan, list_axes, needs_gamepad

MESSAGE_COST_BYTES = 400  # of a message in a log, beyond its own text
_MESSAGE_BYTES = 60 + MESSAGE_COST_BYTES  # of a message with a short text
_STEP_BYTES = 4 * _MESSAGE_BYTES  # a key down and up, a tick and a picture
_CHARACTER_BYTES = _MESSAGE_BYTES  # a typed character, as a message of its own
_MAX_STEPS = 20_000  # of one episode that are counted, even if the protocol allows more
_PART_BYTES = 50_000  # for the pages turned, sliders moved and keys tried in a part
_FACTOR = 2  # margin over the estimates
_PRESSED_STEPS_PER_S = 15  # by a quick participant, sustained
_REPEATED_STEPS_PER_S = 40  # by a held key
_BASE_BYTES = 1_000_000
_RATE_BYTES_PER_S = 3_000  # five ineffective keys, pressed and released, every second
_TEXT_BYTES_PER_S = 10 * _CHARACTER_BYTES
_GAMEPAD_BYTES_PER_S = 60 * 2 * _MESSAGE_BYTES  # both axes of a stick, or of a thumb's stick on a screen, once a frame
_MOUSE_BYTES_PER_S = 144 * 2 * _MESSAGE_BYTES  # both axes, once a frame of a quick display


class SessionBudget:
    """Limits the bytes that a page may send in one session.

    Args:
        plan: the session's plan.
    """

    def __init__(self, plan: SessionPlan) -> None:
        self.spent_bytes = 0
        self._granted_bytes = 0  # the limit when it was last found; it grows with time
        self._text_bytes = 0  # the part of those spent that was typed, which may not use the bytes granted for steps
        self._step_bytes = _FACTOR * _estimate_step_bytes(plan)  # for all steps, granted at the rate below
        self._step_bytes_per_s = _FACTOR * _STEP_BYTES * max(map(_estimate_steps_per_s, plan.episodes), default=0)
        self._fixed_bytes = _BASE_BYTES + _FACTOR * estimate_plan_bytes(plan) - self._step_bytes
        self._bytes_per_s = _RATE_BYTES_PER_S
        if needs_gamepad(plan) or not set(TOUCH_AXES).isdisjoint(list_axes(plan)):
            self._bytes_per_s += _GAMEPAD_BYTES_PER_S
        if not set(MOUSE_AXES).isdisjoint(list_axes(plan)):
            self._bytes_per_s += _MOUSE_BYTES_PER_S
        if any(getattr(part.plan, "has_text_entry", False) for part in plan.parts):
            self._bytes_per_s += _TEXT_BYTES_PER_S

    def spend(self, n_bytes: int, read_session_ns: Callable[[], int], *, is_text: bool = False) -> bool:
        """Count a message's bytes; return False if the page has sent more than the session can need by now.

        Args:
            n_bytes: the size of the message.
            read_session_ns: returns the session's time in nanoseconds; called only if the earlier limit is reached.
            is_text: whether the message holds what was typed, which is also limited by itself.
        """
        self.spent_bytes += n_bytes + MESSAGE_COST_BYTES
        if not is_text and self.spent_bytes <= self._granted_bytes:
            return True
        session_ns = read_session_ns()
        self._granted_bytes = self.find_limit_bytes(session_ns)
        if is_text:
            self._text_bytes += n_bytes + MESSAGE_COST_BYTES
            if self._text_bytes > self._find_other_bytes(session_ns):
                return False
        return self.spent_bytes <= self._granted_bytes

    def find_limit_bytes(self, session_ns: int) -> int:
        """Return the number of bytes that the session can need up to a session time, which is in nanoseconds."""
        step_bytes = min(self._step_bytes, self._step_bytes_per_s * max(0, session_ns) / 1e9)
        return self._find_other_bytes(session_ns) + round(step_bytes)

    def _find_other_bytes(self, session_ns: int) -> int:
        """Return the number of bytes that everything except steps can need up to a session time in nanoseconds."""
        return self._fixed_bytes + self._bytes_per_s * max(0, session_ns) // 1_000_000_000


def _estimate_step_bytes(plan: SessionPlan) -> int:
    return sum(min(episode.max_steps, _MAX_STEPS) for episode in plan.episodes) * _STEP_BYTES


def _estimate_steps_per_s(episode: EpisodePlan) -> float:
    """Estimate the most steps per second that a participant can make in an episode."""
    if episode.pace == "real_time":
        return max(_PRESSED_STEPS_PER_S, 1_000 / episode.step_period_ms)
    return _REPEATED_STEPS_PER_S if episode.auto_repeat else _PRESSED_STEPS_PER_S


def estimate_plan_bytes(plan: SessionPlan) -> int:
    """Estimate the bytes that a page sends in a whole session, with all steps and the longest answers."""
    answer_characters = sum(
        getattr(item, "longest", 0) for part in plan.parts for item in getattr(part.plan, "items", ())
    )
    return _estimate_step_bytes(plan) + answer_characters * _CHARACTER_BYTES + len(plan.parts) * _PART_BYTES
