"""Which keys are down, and auto-repeat made from that: alike on every toolkit and desktop, by the session's clock."""

from dataclasses import dataclass

from minihuman.study.inputs import KeyDown, KeyUp

REPEAT_DELAY_NS = 500_000_000  # the usual desktop's: half a second, then 30 a second
REPEAT_PERIOD_NS = 33_000_000


@dataclass(slots=True)
class _Repeating:
    key: str
    symbol: str
    due_ns: int


class HeldKeys:
    """Turns what a toolkit says about keys into presses, releases and repeats.

    The system's own auto-repeat is a press of a key that is down already; it is dropped, since toolkits disagree on
    whether and how to show it. The key pressed last repeats until it, or the focus, goes.
    """

    def __init__(self) -> None:
        self._down: set[str] = set()
        self._repeating: _Repeating | None = None

    def press(self, t_ns: int, key: str, symbol: str) -> list[KeyDown]:
        """A key is said to be down; [] if it was."""
        if key in self._down:
            return []
        self._down.add(key)
        self._repeating = _Repeating(key, symbol, t_ns + REPEAT_DELAY_NS)
        return [KeyDown(t_ns, key, symbol)]

    def release(self, t_ns: int, key: str, symbol: str) -> list[KeyUp]:
        """A key came up, also one that was pressed before the window had the focus."""
        self._down.discard(key)
        if self._repeating and self._repeating.key == key:
            self._repeating = None
        return [KeyUp(t_ns, key, symbol)]

    def forget(self) -> None:
        """The focus went: the releases will go elsewhere."""
        self._down.clear()
        self._repeating = None

    @property
    def next_repeat_ns(self) -> int | None:
        """When the held key repeats next; None: no key is held."""
        return self._repeating.due_ns if self._repeating else None

    def repeats(self, now_ns: int) -> list[KeyDown]:
        """The repeat that is due, if one is. A loop that came late gets one, not all that it missed."""
        held = self._repeating
        if held is None or now_ns < held.due_ns:
            return []
        on_time = now_ns - held.due_ns < REPEAT_PERIOD_NS
        held.due_ns = (held.due_ns if on_time else now_ns) + REPEAT_PERIOD_NS
        return [KeyDown(now_ns, held.key, held.symbol, repeat=True)]
