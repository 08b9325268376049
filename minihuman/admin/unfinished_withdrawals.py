"""Finds withdrawals of which data may be left. Imports nothing that erases, so that `status` starts quickly."""

from collections.abc import Iterator
from pathlib import Path

from minihuman.dataset.withdrawn_codes import read_withdrawn_codes

MARK_SUFFIX = ".withdrawing"  # behind a participant's code: the name of a file that says that erasing them has begun


def find_unfinished_withdrawals(study_dir: Path) -> Iterator[str]:
    """Say of whom data may be left, although they have withdrawn: an erasure was cut short, or done on another machine.

    Raises:
        OSError: if the enrolment log is in a database that cannot be asked.
        LogError: if one of its lines is damaged.
    """
    for code in sorted(read_withdrawn_codes(study_dir)):
        if find_mark(study_dir, code).exists() or (study_dir / code).exists():
            yield f"{code} has withdrawn, but data of theirs may be left; run `minihuman withdraw {code}` again"


def find_mark(study_dir: Path, code: str) -> Path:
    """Return the file that is there while the erasing of a participant is not finished."""
    return study_dir / f"{code}{MARK_SUFFIX}"
