"""The number of bytes that a page may send in a session: what its plan can honestly need, times a factor. No I/O.

A rate limit on messages alone would let one page write a gigabyte in twenty minutes, which fills the disk for everyone.
"""

from minihuman.experiment.plan.session_plan import SessionPlan, needs_gamepad

MESSAGE_COST_BYTES = 400  # of a message in a log, beyond its own text
_STEP_BYTES = 4 * (60 + MESSAGE_COST_BYTES)  # a key down and up, a tick and a picture
_CHARACTER_BYTES = 60 + MESSAGE_COST_BYTES  # a message of its own
_MAX_STEPS = 20_000  # of one episode, whatever the protocol's limit: no participant plays more
_PART_BYTES = 50_000  # pages turned, sliders moved, keys tried
_FACTOR = 2
_BASE_BYTES = 1_000_000
_RATE_BYTES_PER_S = 3_000  # five keys, pressed and released in vain, every second
_TEXT_BYTES_PER_S = 10 * _CHARACTER_BYTES
_GAMEPAD_BYTES_PER_S = 60 * 2 * (60 + MESSAGE_COST_BYTES)  # both axes of a stick, once a frame


class SessionBudget:
    """Limits the bytes that a page may send in one session.

    Args:
        plan: the session's plan.
    """

    def __init__(self, plan: SessionPlan) -> None:
        self.spent_bytes = 0
        self._fixed_bytes = _BASE_BYTES + _FACTOR * estimate_plan_bytes(plan)
        self._bytes_per_s = _RATE_BYTES_PER_S
        if needs_gamepad(plan):
            self._bytes_per_s += _GAMEPAD_BYTES_PER_S
        if any(getattr(part.plan, "has_text_entry", False) for part in plan.parts):
            self._bytes_per_s += _TEXT_BYTES_PER_S

    def spend(self, n_bytes: int, session_ns: int) -> bool:
        """Count the bytes of a message; return False if the session has now sent more than it can need by this time."""
        self.spent_bytes += n_bytes + MESSAGE_COST_BYTES
        return self.spent_bytes <= self.find_limit_bytes(session_ns)

    def find_limit_bytes(self, session_ns: int) -> int:
        """Return the number of bytes that a session can need up to a time in it."""
        return self._fixed_bytes + self._bytes_per_s * max(0, session_ns) // 1_000_000_000


def estimate_plan_bytes(plan: SessionPlan) -> int:
    """Estimate the bytes that a plan needs with every step of every episode and the longest answers."""
    steps = sum(min(episode.max_steps, _MAX_STEPS) for episode in plan.episodes)
    answer_characters = sum(
        getattr(item, "longest", 0) for part in plan.parts for item in getattr(part.plan, "items", ())
    )
    return steps * _STEP_BYTES + answer_characters * _CHARACTER_BYTES + len(plan.parts) * _PART_BYTES
