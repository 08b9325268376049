"""The state of the keyboard: the keys that are down, the experimenter's chord, and the time Escape has been held."""

ABORT_CHORD = frozenset({"f9", "f12"})
HOLD_TO_END_NS = 2_000_000_000  # Escape, held over the question whether to end the session


class KeyState:
    """The keys that are down according to the focused window.

    Args:
        down: the dictionary in which to keep the keys, the latest last, with the time of each press in nanoseconds.
    """

    def __init__(self, down: dict[str, int]) -> None:
        self._down = down
        self._escape_since_ns: int | None = None  # held over the question

    def down(self, key: str, t_ns: int) -> None:
        """Record that a key went down; a repeat keeps the time of the press."""
        self._down.setdefault(key, t_ns)

    def up(self, key: str) -> None:
        """Record that a key came up."""
        self._down.pop(key, None)

    def forget(self) -> None:
        """Forget all keys, because another window has the keyboard and receives their releases."""
        self._down.clear()
        self._escape_since_ns = None

    def completes_chord(self, key: str) -> bool:
        """Return whether a key that has just gone down completes `ABORT_CHORD`, the experimenter's chord."""
        return key in ABORT_CHORD and self._down.keys() >= ABORT_CHORD

    def hold_escape(self, since_ns: int) -> None:
        """Record that Escape went down at ``since_ns``, while the question whether to end the session was shown."""
        self._escape_since_ns = since_ns

    def release_escape(self) -> bool:
        """Record that Escape came up or the question closed; return whether Escape was held on the question."""
        was_down = self._escape_since_ns is not None
        self._escape_since_ns = None
        return was_down

    @property
    def end_ns(self) -> int | None:
        """Return the time, ns, at which Escape will have been held long enough to end the session; None if it is up."""
        if self._escape_since_ns is None:
            return None
        return self._escape_since_ns + HOLD_TO_END_NS
