"""How fast somebody presses keys, by the latest of them. No clock."""

from collections import deque

_LATEST = 8
_USUAL_HZ = 3.0
_PAUSE_NS = 2_000_000_000  # somebody who thinks for longer is as quick as before


class KeyRate:
    """Takes when keys were pressed."""

    def __init__(self) -> None:
        self._last_ns: int | None = None
        self._between_ns: deque[int] = deque(maxlen=_LATEST)

    def pressed(self, t_ns: int) -> None:
        """A key was."""
        if self._last_ns is not None and 0 < t_ns - self._last_ns < _PAUSE_NS:
            self._between_ns.append(t_ns - self._last_ns)
        self._last_ns = t_ns

    @property
    def hz(self) -> float:
        """Keys a second, of the quicker half."""
        if not self._between_ns:
            return _USUAL_HZ
        return 1e9 / sorted(self._between_ns)[len(self._between_ns) // 4]
