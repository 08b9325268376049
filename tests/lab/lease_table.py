"""The leases of sessions in memory, on a clock that a test sets."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from minihuman.storage.lease import TTL_S, LeaseGrant, LeaseRenewal, LeaseTable


class Clock:
    """Seconds that a test lets pass."""

    def __init__(self) -> None:
        self.now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


@dataclass
class _Row:
    fence: int = 0
    until_s: float = float("-inf")
    wanted: bool = False
    ended: str = ""
    copied_s: float | None = None
    files: dict[str, bytes] = field(default_factory=dict)


class MemoryLeaseTable(LeaseTable):
    """One database, that can be away."""

    def __init__(self, clock: Clock) -> None:
        self.is_away = False
        self._clock = clock
        self._rows: dict[str, _Row] = {}

    def acquire(self, session: str) -> LeaseGrant | None:
        row = self._row(session)
        if row.until_s > self._clock() and not row.ended:
            row.wanted = True
            return None
        if not row.ended:
            row.fence, row.until_s, row.wanted = row.fence + 1, self._clock() + TTL_S, False
        idle_s = 0.0 if row.copied_s is None else self._clock() - row.copied_s
        return LeaseGrant(row.fence, f"name-of-{session}", row.ended, row.copied_s is not None, idle_s)

    def renew(self, renewals: Sequence[LeaseRenewal]) -> dict[str, bool]:
        held = {}
        for each in renewals:
            row = self._row(each.session)
            if row.fence != each.fence or row.ended:
                continue
            held[each.session], row.until_s = row.wanted, self._clock() + TTL_S
            if each.piece is not None:
                before = row.files.get(each.piece.file, b"")[: each.piece.start]
                row.files[each.piece.file] = before + each.piece.data
                row.copied_s = self._clock()
        return held

    def store(self, session: str, fence: int, files: Mapping[str, bytes]) -> bool:
        row = self._row(session)
        if row.fence == fence:
            row.files, row.copied_s = dict(files), self._clock()
        return row.fence == fence

    def read_files(self, session: str) -> dict[str, bytes]:
        return dict(self._row(session).files)

    def release(self, session: str, fence: int, *, ended: str = "") -> bool:
        row = self._row(session)
        if row.fence != fence or row.ended not in ("", ended):
            return False
        row.until_s, row.wanted, row.ended = float("-inf"), False, ended
        return True

    def forget(self, prefix: str) -> None:
        for session, row in self._rows.items():
            if session.startswith(prefix):
                self._rows[session] = _Row(fence=row.fence + 1)

    def _row(self, session: str) -> _Row:
        if self.is_away:
            raise OSError("the database is away")
        return self._rows.setdefault(session, _Row())
