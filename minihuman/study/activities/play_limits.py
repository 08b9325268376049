"""Time limits of an episode and of its block: playing time only, pauses left out."""

from minihuman.study.events import EndCause

NS_PER_S = 1_000_000_000


class Limits:
    """Two clocks that run while an episode is played; 0 s is no limit."""

    def __init__(self, episode_s: float, block_s: float) -> None:
        self._episode_ns = round(episode_s * NS_PER_S)
        self._block_ns = round(block_s * NS_PER_S)
        self._played_ns = 0  # of the episode, when the clock last stood
        self._block_played_ns = 0
        self._running_since_ns: int | None = None

    def begin(self, now_ns: int) -> None:
        """An episode starts."""
        self._played_ns = 0
        self._running_since_ns = now_ns

    def run(self, now_ns: int) -> None:
        """It goes on."""
        self._running_since_ns = now_ns

    def stop(self, now_ns: int) -> None:
        """It pauses or is over."""
        if self._running_since_ns is not None:
            ran_ns = now_ns - self._running_since_ns
            self._played_ns += ran_ns
            self._block_played_ns += ran_ns
            self._running_since_ns = None

    @property
    def due_ns(self) -> int | None:
        """When the next limit is reached; None: there is none, or the clocks stand."""
        if self._running_since_ns is None:
            return None
        left = [limit - played for limit, played in self._pairs if limit]
        return self._running_since_ns + max(0, min(left)) if left else None

    def over(self, now_ns: int) -> EndCause:
        """Which limit has been reached; "" for none."""
        due_ns = self.due_ns
        if due_ns is None or now_ns < due_ns:
            return ""
        return "block_max_s" if self.block_is_over(now_ns) else "max_s"

    def block_is_over(self, now_ns: int) -> bool:
        """Whether the block's time has been played."""
        running_ns = 0 if self._running_since_ns is None else now_ns - self._running_since_ns
        return bool(self._block_ns) and self._block_played_ns + running_ns >= self._block_ns

    @property
    def _pairs(self) -> tuple[tuple[int, int], tuple[int, int]]:
        return (self._episode_ns, self._played_ns), (self._block_ns, self._block_played_ns)
