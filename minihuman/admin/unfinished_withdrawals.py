"""Find withdrawals after which data may be left.

The module imports nothing that erases, so that `status` starts quickly.
"""

from collections.abc import Iterator
from pathlib import Path

from minihuman.dataset.withdrawn_codes import read_withdrawn_codes

MARK_SUFFIX = ".withdrawing"  # after a participant's code, the name of a file that marks a begun erasure


def find_unfinished_withdrawals(study_dir: Path) -> Iterator[str]:
    """Yield a line for each participant who withdrew, but whose data may be left on this machine.

    Either the erasure was interrupted, or it was done on another machine.

    Raises:
        OSError: if the enrolment log is in a database that cannot be reached.
        LogError: if a line of the enrolment log is damaged.
    """
    for code in sorted(read_withdrawn_codes(study_dir)):
        if find_mark(study_dir, code).exists() or (study_dir / code).exists():
            yield f"{code} has withdrawn, but data of theirs may be left; run `minihuman withdraw {code}` again"


def find_mark(study_dir: Path, code: str) -> Path:
    """Return the path of the file that exists while the erasure of a participant is unfinished."""
    return study_dir / f"{code}{MARK_SUFFIX}"
