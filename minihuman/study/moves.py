"""Tables of moves: what leads from phase to phase, and on which condition. A move that no row allows is impossible."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Generic, TypeVar

Subject = TypeVar("Subject")


@dataclass(frozen=True, slots=True)
class Move(Generic[Subject]):
    """A row: from ``start``, for a ``cause``, to ``end`` (None: back to where the cause before came from)."""

    start: StrEnum
    cause: StrEnum
    end: StrEnum | None
    when: Callable[[Subject], bool] | None = None  # None: always; its name is what the diagram says


class Moves(Generic[Subject]):
    """Rows, of which the first whose condition holds counts."""

    def __init__(self, rows: Sequence[Move[Subject]]) -> None:
        self.rows = tuple(rows)

    def find(self, start: StrEnum, cause: StrEnum, subject: Subject) -> Move[Subject] | None:
        """The move to make; None where there is none: then nothing changes."""
        for row in self.rows:
            if row.start is start and row.cause is cause and (row.when is None or row.when(subject)):
                return row
        return None

    def causes(self, start: StrEnum) -> frozenset[StrEnum]:
        """What can lead away from a phase."""
        return frozenset(row.cause for row in self.rows if row.start is start)

    def mermaid(self, first: StrEnum, last: StrEnum, *, noted: frozenset[StrEnum] = frozenset()) -> str:
        """The table as a Mermaid state diagram; causes that many phases share are said in notes."""
        lines = ["stateDiagram-v2", f"    [*] --> {first}"]
        lines += [f"    {row.start} --> {row.end}: {_said(row)}" for row in self.rows if row.cause not in noted]
        lines += [f"    note right of {last}: {note}" for note in self._notes(noted)]
        return "\n".join([*lines, f"    {last} --> [*]"])

    def _notes(self, noted: frozenset[StrEnum]) -> Iterator[str]:
        for cause in dict.fromkeys(row.cause for row in self.rows if row.cause in noted):
            rows = [row for row in self.rows if row.cause is cause]
            ends = ", ".join(dict.fromkeys("back" if row.end is None else row.end for row in rows))
            yield f"{cause} from {', '.join(dict.fromkeys(row.start for row in rows))} to {ends}"


def _said(row: Move[Subject]) -> str:
    return row.cause if row.when is None else f"{row.cause}, if {row.when.__name__.strip('_').replace('_', ' ')}"
