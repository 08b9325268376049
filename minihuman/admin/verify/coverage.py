"""Which logs are replayed: all of them, a sample, or those that no earlier run has verified as they are now.

A record of verified logs saves time and proves nothing to others: who can write the logs can write the record, too.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import msgspec
import numpy as np

import minihuman
from minihuman.dataset.annotations import annotations_path
from minihuman.dataset.caches import digest_sources
from minihuman.errors import LogError, MinihumanError
from minihuman.log.read.session_reader import list_session_files
from minihuman.storage.durable_files import hash_file


@dataclass(frozen=True, slots=True)
class Sample:
    """A random sample of sessions.

    Attributes:
        share: the share of the sessions, above 0 and at most 1; at least one session is drawn.
        seed: the seed of the draw.
    """

    share: float
    seed: int = 0

    @classmethod
    def parse(cls, text: str, *, seed: int = 0) -> "Sample":
        """Parse a share such as "5%" or "0.05", and return the sample of that share.

        Args:
            text: the share.
            seed: the seed of the draw, 0 or more.

        Raises:
            MinihumanError: if the text is not a share above 0 % and at most 100 %, or the seed is negative.
        """
        number = text.strip().removesuffix("%")
        try:
            share = float(number) / (100 if text.strip().endswith("%") else 1)
        except ValueError:
            share = math.nan
        if not 0 < share <= 1:
            raise MinihumanError(f"--sample is {text!r}; a share is above 0% and at most 100%, such as 5% or 0.05")
        if seed < 0:
            raise MinihumanError(f"--sample-seed is {seed}; a seed is 0 or more")
        return cls(share, seed)

    def draw(self, logs: Sequence[Path]) -> list[Path]:
        """Return the logs that are drawn, in the order of ``logs``."""
        n_exact = self.share * len(logs) - 1e-9  # so that no rounding error adds a log
        n_drawn = min(len(logs), max(1, math.ceil(n_exact)))
        indices = np.random.default_rng(self.seed).permutation(len(logs))[:n_drawn]
        return [logs[index] for index in sorted(indices.tolist())]

    def describe(self, n_drawn: int, n_logs: int) -> str:
        """Describe the sample in a phrase.

        Args:
            n_drawn: the number of sessions that were drawn.
            n_logs: the number of all sessions.
        """
        return f"a sample of {n_drawn} of {n_logs} sessions, {100 * self.share:g} %, seed {self.seed}"


class _VerifiedLog(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A line of the record: a log in which nothing differed."""

    log: str  # its absolute path
    digest: str  # of its files, of its annotations and of its chain heads in the enrolment log
    software: str  # the software that verified it
    at: str  # UTC
    lines: tuple[str, ...]


class VerificationRecord:
    """A file with a line for each log that was verified, to which each run appends.

    A run that is cut off is resumed by the next one; a line that was cut off counts for nothing.

    Args:
        file: the file, which need not exist.
        options: the settings on which a result depends besides the logs.

    Raises:
        LogError: if the file cannot be read, or is another file.
    """

    def __init__(self, file: Path, options: str = "") -> None:
        self._file = file
        self._software = f"{minihuman.__version__} {digest_sources()} {options}".strip()
        self._verified: dict[str, _VerifiedLog] = {}
        self._digests: dict[Path, str] = {}
        try:
            content = file.read_bytes() if file.exists() else b""
        except OSError as error:
            raise LogError(f"{file} cannot be read: {error.strerror}") from error
        *whole_lines, partial_line = content.split(b"\n")
        self._ends_with_newline = not partial_line  # an empty file, too, may be appended to as it is
        for number, line in enumerate(whole_lines, 1):
            self._read_line(line, number)

    def _read_line(self, line: bytes, number: int) -> None:
        """Read the line with a number; skip a line that a cut-off run left unfinished.

        Raises:
            LogError: if the line is of another kind.
        """
        try:
            verified = msgspec.json.decode(line, type=_VerifiedLog)
        except msgspec.DecodeError as error:
            if not line.startswith(b'{"log":'):
                raise LogError(
                    f"{self._file}:{number} is no line of verified logs ({error}); name another file with --record"
                ) from error
            return
        self._verified[verified.log] = verified

    def find(self, log: Path, heads: Iterable[tuple[str, str]]) -> tuple[str, ...] | None:
        """Return the lines about a log that this software verified in its present state; None if it must be verified.

        The log's state is remembered for a later ``add`` call.

        Args:
            log: the log, or a session's folder.
            heads: the numbers of the log's segments and their chain heads, as the enrolment log has them.
        """
        try:
            self._digests[log] = _digest_log(log, heads)
        except (LogError, OSError):  # verification reports the error
            return None
        verified = self._verified.get(str(log.absolute()))
        if verified is None or (verified.digest, verified.software) != (self._digests[log], self._software):
            return None
        return tuple(f"{line} (verified at {verified.at}, unchanged since)" for line in verified.lines)

    def add(self, log: Path, lines: Sequence[str]) -> None:
        """Append a log in which nothing differs, with its state at the preceding ``find`` call.

        Nothing is appended if ``find`` could not read the log.

        Args:
            log: the log, as in the ``find`` call.
            lines: the lines of the result.

        Raises:
            LogError: if the file cannot be written.
        """
        if log not in self._digests:
            return
        verified_at = datetime.now(UTC).isoformat(timespec="seconds")
        verified = _VerifiedLog(str(log.absolute()), self._digests[log], self._software, verified_at, tuple(lines))
        start = b"" if self._ends_with_newline else b"\n"
        try:
            with self._file.open("ab") as file:
                file.write(start + msgspec.json.encode(verified) + b"\n")
        except OSError as error:
            raise LogError(f"{self._file} cannot be written: {error.strerror}") from error
        self._ends_with_newline = True
        self._verified[verified.log] = verified


def _digest_log(log: Path, heads: Iterable[tuple[str, str]]) -> str:
    """Return a text that identifies the state of a log: the digests of its files and annotations, and its chain heads.

    Raises:
        LogError: if a folder holds no session.
        OSError: if a file cannot be read.
    """
    files = _list_files(log)
    return " ".join([*map(hash_file, files), *(f"{segment}:{chain}" for segment, chain in sorted(heads))])


def _list_files(log: Path) -> Iterator[Path]:
    """Yield the files of a session, and its file of annotations if there is one."""
    yield from list_session_files(log)
    annotations = annotations_path(log)
    if annotations.exists():
        yield annotations
