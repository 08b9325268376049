"""The disk of a session that nobody's picture waits for: whoever writes tells nobody before it is durable."""

from collections import deque
from collections.abc import Callable, Sequence

from minihuman.log.record.appended_file import AppendedFile
from minihuman.log.record.disk import BACKLOG, Disk, Job
from minihuman.log.record.live_file import Piece
from minihuman.log.record.rounds import Rounds


class SharedDisk(Disk):
    """No thread for its file: rounds write it, and many others, and make them durable.

    Args:
        rounds: do the work; the file's own ``sync`` is asked only where it was taken away and is written again.
    """

    def __init__(
        self,
        file: AppendedFile,
        rounds: Rounds,
        *,
        backlog: int = BACKLOG,
        at_sync: Callable[[], None] = lambda: None,
    ) -> None:
        super().__init__(file, backlog=backlog, at_sync=at_sync)
        self._rounds = rounds
        self._waiting: deque[Job] = deque()  # for a round
        self._in_round: list[Job] = []
        self._expected = False  # its round will come

    @property
    def fd(self) -> int:
        """The descriptor."""
        return self.file.fd

    def _take(self, pieces: Sequence[Piece], steps: int) -> None:
        self._waiting.append(Job(pieces, steps))
        if not self._expected:
            self._expected = True
            self._rounds.expect(self)

    def settle(self) -> None:
        """Return at once: what is shown waits for ``durable_writes``."""

    def drain(self) -> None:
        """Have a round at once, and wait until all that was written is durable, or never will be."""
        if self._settled < self._given:
            self._rounds.expect(self, at_once=True)
        super().drain()

    def close(self) -> None:
        """Make durable what is left, and be done with the file."""
        self.drain()

    def write_waiting(self) -> bool:
        """Write all that waits; whether there was any."""
        self._expected = False  # what comes from here on has another round
        while self._waiting:
            self._in_round.append(self._waiting.popleft())
        self._write(self._in_round)
        return bool(self._in_round)

    def written_is(self, failed: Exception | None) -> None:
        """What was written is durable, or never will be."""
        jobs, self._in_round = self._in_round, []

        def outcome() -> None:
            if failed is not None:
                raise failed

        self._make_durable(jobs, sync=outcome)
