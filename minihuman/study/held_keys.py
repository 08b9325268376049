"""The keys that are down: the experimenter's chord, and how long Escape is held over the question to end."""

ABORT_CHORD = frozenset({"f9", "f12"})
HOLD_TO_END_NS = 2_000_000_000  # Escape, held over the question whether to end the session


class HeldKeys:
    """What is down, as far as the window that has the keyboard can know."""

    def __init__(self) -> None:
        self._down: set[str] = set()
        self._escape_since_ns: int | None = None  # held over the question

    def down(self, key: str) -> None:
        """A key went down."""
        self._down.add(key)

    def up(self, key: str) -> None:
        """A key came up."""
        self._down.discard(key)

    def forget(self) -> None:
        """The keyboard is another window's: releases go there."""
        self._down.clear()
        self._escape_since_ns = None

    def completes_chord(self, key: str) -> bool:
        """Whether a key that has just gone down makes the experimenter's chord whole."""
        return key in ABORT_CHORD and self._down >= ABORT_CHORD

    def hold_escape(self, since_ns: int) -> None:
        """Escape went down over the question."""
        self._escape_since_ns = since_ns

    def let_escape_go(self) -> bool:
        """Escape came up, or the question is gone; whether it was held over the question."""
        held, self._escape_since_ns = self._escape_since_ns is not None, None
        return held

    @property
    def end_ns(self) -> int | None:
        """When Escape has been held long enough to end the session; None while it is not held over the question."""
        return None if self._escape_since_ns is None else self._escape_since_ns + HOLD_TO_END_NS
