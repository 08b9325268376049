"""A participant is withdrawn, a manifest and a policy file are written, and the disk fails: one run, from a seed.

The data folder, its remote stores and the archive are on one disk, which is full, read-only, failing or torn for a
while, or whose process is killed between two calls, now and then with a power cut behind it. The same command is given
again, until it is given on a disk that works. What is on the disk is looked at after every attempt.
"""

import shutil
import tempfile
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import msgspec

from minihuman.admin import manifest
from minihuman.admin.enrolment_entries import SlotTaken, open_enrolment_log
from minihuman.admin.manifest import MANIFEST_FILE_NAME, write_manifest
from minihuman.admin.policies import PolicyStore
from minihuman.admin.recruitment import IDS_FILE_NAME
from minihuman.admin.unfinished_withdrawals import find_unfinished_withdrawals
from minihuman.admin.withdrawal import withdraw_participant
from minihuman.dataset.withdrawn_codes import read_withdrawn_codes
from minihuman.errors import MinihumanError
from minihuman.storage import study_journals
from minihuman.storage.durable_files import write_atomically
from minihuman.storage.remote_store import STORE_URL_FILE_NAME, TABLES_URL_FILE_NAME
from minihuman.storage.study_journals import ARRIVALS_FILE_NAME, ENROLMENT_FILE_NAME
from minihuman.storage.system import System, use_system
from tests.fault_simulation.schedule import MachineClock, ProcessKilled, Schedule
from tests.fault_simulation.volume import ProcessDisk, Volume

CODE, OTHER = "sub-02", "sub-01"
SECRET = b"what sub-02 did, and nobody else"
KEPT = b"what sub-01 did, who stays"
HAZARDS = ("kill", "kill", "full", "failing", "read-only", "unsynced", "short")
MAX_ATTEMPTS = 4  # that may fail
_MEMORY = Path("/dev/shm")


class FailingDisk(ProcessDisk):
    """A disk that fails from one operation to another.

    Args:
        volume: what is on it.
        hazard: how it fails; "" where it does not.
        begin: the operation at which it begins to.
        count: for so many operations; a killed process does no more.
    """

    def __init__(self, volume: Volume, hazard: str = "", begin: int = 0, count: int = 0) -> None:
        super().__init__(volume, ops_left=begin if hazard == "kill" else None)
        self._hazard = hazard
        self._window = range(begin, begin + count)
        self._operations = 0

    def unlink(self, path: Path) -> None:
        """Remove it, where the disk can be written."""
        self._require_writable(path)
        super().unlink(path)

    def remove_folder(self, folder: Path) -> None:
        """Remove it, where the disk can be written."""
        self._require_writable(folder)
        super().remove_folder(folder)

    def _operation(self, what: str, *, dies: bool = True) -> bool:
        fails = self._operations in self._window
        self._operations += 1
        self.full = fails and self._hazard == "full"
        self.failing = fails and self._hazard in ("failing", "read-only")
        self.unsynced = fails and self._hazard == "unsynced"
        self.short = 0.7 if fails and self._hazard == "short" else 0.0
        return super()._operation(what, dies=dies)

    def _require_writable(self, path: Path) -> None:
        if self._operations in self._window and self._hazard in ("failing", "read-only"):
            self._operations += 1
            raise OSError(30 if self._hazard == "read-only" else 5, "the disk does not remove anything", str(path))


@dataclass
class Outcome:
    """What a run showed."""

    seed: int
    failures: list[str] = field(default_factory=list)
    happened: Counter[str] = field(default_factory=Counter)


@dataclass(frozen=True)
class Commands:
    """What is run on the disk; a planted fault replaces one of them."""

    withdraw: Callable[..., object] = withdraw_participant
    write_manifest: Callable[[Path], object] = write_manifest
    keep_policy: Callable[[Path, bytes], object] = lambda study, content: PolicyStore(study).keep(content)
    disk: type[FailingDisk] = FailingDisk


class Run:
    """One run.

    Args:
        seed: of all that happens.
        commands: what is run.
    """

    def __init__(self, seed: int, commands: Commands) -> None:
        self.outcome = Outcome(seed)
        self.schedule = Schedule(seed)
        self.rng = self.schedule.rng
        self.clock = MachineClock(self.schedule)
        self.commands = commands
        self.root = Path(tempfile.mkdtemp(prefix="erasure-", dir=_MEMORY if _MEMORY.is_dir() else None))
        self.volume = Volume(self.root, self.schedule, self.clock)
        self.data = self.root / "data"
        self.study = self.data / "study"
        self.archive = self.root / "elsewhere" / f"{CODE}.zip"

    def attempt(self, do: Callable[[], object], hazard: str, begin: int, count: int) -> Exception | str | None:
        """Run a command in a process of its own, on a disk that may fail.

        Returns:
            None where it returned, its error, or "killed".
        """
        study_journals._open_in_file.cache_clear()
        disk = self.commands.disk(self.volume, hazard, begin, count)
        try:
            with use_system(System(disk=disk, clock=self.clock)):
                do()
        except ProcessKilled:
            return "killed"
        except (OSError, MinihumanError) as error:
            return error
        finally:
            disk.kill()
        return None

    def try_until_done(self, do: Callable[[], object], longest: int) -> Iterator[tuple[Exception | str | None, bool]]:
        """Run a command on a failing disk a few times, and then on one that works.

        Yields:
            How each attempt ended, and whether there was a power cut behind it.
        """
        for _ in range(self.rng.randint(1, MAX_ATTEMPTS)):
            hazard = self.rng.choice(HAZARDS)
            begin = self.rng.randint(0, longest)
            end = self.attempt(do, hazard, begin, self.rng.choice((1, 2, 5, 30, 1_000)))
            self.outcome.happened[f"{hazard}: {'returned' if end is None else 'stopped'}"] += 1
            yield end, False
            if self.schedule.chance(0.5):
                self.volume.power_cut()
                yield end, True
        end = self.attempt(do, "", 0, 0)
        yield end, False
        if end is not None:
            self.fail(f"on a disk that works: {end!r}")
        self.volume.power_cut()
        yield end, True

    def fail(self, what: str) -> None:
        """Note what must not be."""
        self.outcome.failures.append(what)

    def write(self, path: Path, content: bytes) -> None:
        """Have a file on the disk from the beginning."""
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(content)

    def files(self) -> dict[Path, bytes]:
        """Everything on the disk, by path."""
        return {path: path.read_bytes() for path in sorted(self.root.rglob("*")) if path.is_file()}


class Withdrawal(Run):
    """The withdrawal of one of two participants."""

    def run(self) -> None:
        """Withdraw them, on a disk that fails first."""
        self._fill()
        self.volume.adopt()
        before = self.files()
        seal = self.archive if self.schedule.chance(0.4) else None
        last: Exception | str | None = None
        for end, after_cut in self.try_until_done(
            lambda: self.commands.withdraw(self.study, CODE, seal=seal), longest=90
        ):
            self._check(before, end, after_cut)
            last = end
        if last is None:
            self._check_end(before, seal)

    def _fill(self) -> None:
        for code, text in ((OTHER, KEPT), (CODE, SECRET)):
            for name in (f"ses-01/{code}_ses-01.mcap", f"ses-01/{code}_ses-01.annotations.jsonl", "scan.nii"):
                if name.endswith("mcap") or self.schedule.chance(0.5):
                    self.write(self.study / code / name, text * self.rng.randint(1, 600))
            self.write(self.data.with_name("store") / "study" / code / "ses-01" / f"{code}_ses-01.mcap", text * 5)
            for table in ("episodes", "steps"):
                folder = self.data.with_name("tables") / table / "study=study" / f"participant={code}"
                self.write(folder / f"ses-01-{self.rng.getrandbits(64):016x}.parquet", text)
        if self.schedule.chance(0.3):
            self.write(self.data.with_name("store") / ".unfinished", SECRET)  # of an upload that was cut short
        if self.schedule.chance(0.5):
            self.write(self.study / "tables.duckdb", KEPT + SECRET)
            self.write(self.study / "tables.files" / "steps.parquet", SECRET + KEPT)
        if self.schedule.chance(0.6):
            self.write(self.data / STORE_URL_FILE_NAME, bytes(self.data.with_name("store")))
        else:
            shutil.rmtree(self.data.with_name("store"))
        if self.schedule.chance(0.6):
            self.write(self.data / TABLES_URL_FILE_NAME, bytes(self.data.with_name("tables")))
        else:
            shutil.rmtree(self.data.with_name("tables"))
        study_journals._open_in_file.cache_clear()
        with use_system(System(clock=self.clock)), open_enrolment_log(self.study).hold() as register:
            register.append(
                *(SlotTaken("0" * 64, 2, index, code, "a", False) for index, code in enumerate((OTHER, CODE)))
            )
        if self.schedule.chance(0.7):
            came = [{"came": f"link:{text.decode()}", "participant": code, "at": ""} for code, text in _PEOPLE]
            ids = [{"participant": code, "platform": "prolific", "id": text.decode()} for code, text in _PEOPLE]
            self.write(self.study / ARRIVALS_FILE_NAME, b"".join(msgspec.json.encode(line) + b"\n" for line in came))
            self.write(self.study / IDS_FILE_NAME, b"".join(msgspec.json.encode(line) + b"\n" for line in ids))
        self.archive.parent.mkdir()
        self.write(self.archive.with_name("another file"), KEPT)

    def _check(self, before: dict[Path, bytes], end: Exception | str | None, after_cut: bool) -> None:
        """Nothing is half erased without a word."""
        study_journals._open_in_file.cache_clear()
        here = self.files()
        where = "after a power cut" if after_cut else "after an attempt"
        for path, content in before.items():
            if SECRET not in content and path.name != ENROLMENT_FILE_NAME and here.get(path) != content:
                self.fail(f"{where}: {path.name} was changed")
        with use_system(System(clock=self.clock)):
            has_withdrawn = CODE in read_withdrawn_codes(self.study)
            words = list(find_unfinished_withdrawals(self.study))
        archives = (self.archive, self.archive.with_name(self.archive.name + ".part"))
        left = [path for path, content in here.items() if SECRET in content and path not in archives]
        if end is None:
            if not has_withdrawn or left or words:
                self.fail(f"{where}: the command returned, and left {[path.name for path in left]}, {words}")
        elif not has_withdrawn:
            for path, content in before.items():
                if SECRET in content and here.get(path) != content:
                    self.fail(f"{where}: {path.name} is gone, and nobody has withdrawn")
        elif left and not any(CODE in word for word in words):
            self.fail(f"{where}: half erased without a word: {[path.name for path in left]} are left")

    def _check_end(self, before: dict[Path, bytes], seal: Path | None) -> None:
        here = self.files()
        for name in (ARRIVALS_FILE_NAME, IDS_FILE_NAME):
            if self.study / name in before and KEPT not in here[self.study / name]:
                self.fail(f"{name} lacks who stays")
        theirs = {path: content for path, content in before.items() if path.is_relative_to(self.study / CODE)}
        if seal is None:
            if any(SECRET in content for content in here.values()):
                self.fail("data are left in an archive")
            return
        if seal.with_name(seal.name + ".part") in here:
            self.fail("a part of an archive is left")
        with zipfile.ZipFile(seal) as sealed:
            if {name: sealed.read(name) for name in sealed.namelist()} != {
                path.relative_to(self.study).as_posix(): content for path, content in theirs.items()
            }:
                self.fail("the archive lacks something")


_PEOPLE = ((OTHER, KEPT), (CODE, SECRET))


class Writing(Run):
    """A manifest, a policy file and a text are written."""

    def run(self) -> None:
        """Write each, on a disk that fails first."""
        self.write(self.study / ENROLMENT_FILE_NAME, KEPT)
        text = self.study / "facts.json"
        for path in (self.study / MANIFEST_FILE_NAME, text):
            if self.schedule.chance(0.5):
                self.write(path, b"the old one")
        self.volume.adopt()
        content = self.rng.randbytes(self.rng.randint(1, 20_000))
        new_text = "the new one " * self.rng.randint(1, 2_000)
        self._write(self.study / "policies", lambda: self.commands.keep_policy(self.study, content), content)
        self._write(text, lambda: write_atomically(new_text, text), new_text.encode())
        sealed = {
            path.relative_to(self.study).as_posix(): manifest.hash_file(path)
            for path in self.files()
            if path.name != MANIFEST_FILE_NAME and path.is_relative_to(self.study) and not path.name.startswith(".")
        }
        self._write(self.study / MANIFEST_FILE_NAME, lambda: self.commands.write_manifest(self.study), sealed)

    def _write(self, path: Path, do: Callable[[], object], wanted: bytes | dict[str, str]) -> None:
        old = path.read_bytes() if path.is_file() else None
        for end, after_cut in self.try_until_done(do, longest=8):
            file = next(path.glob("*.pt"), path) if path.is_dir() else path
            here = file.read_bytes() if file.is_file() else None
            is_new = here is not None and _holds(here, wanted)
            if end is None and not is_new:
                self.fail(f"{file.name} was said to be written and is not{' after a power cut' * after_cut}")
            elif here != old and not is_new:
                self.fail(f"{file.name} is neither the old nor the new one")


def _holds(content: bytes, wanted: bytes | dict[str, str]) -> bool:
    if isinstance(wanted, bytes):
        return content == wanted
    try:
        files = msgspec.json.decode(content)["files"]
    except (msgspec.DecodeError, TypeError):
        return False
    return wanted.items() <= files.items()


def simulate_erasure(seed: int, commands: Commands = Commands()) -> Outcome:
    """Run a seed: a withdrawal or, every fourth time, what is written beside."""
    run = Writing(seed, commands) if seed % 4 == 3 else Withdrawal(seed, commands)
    try:
        run.run()
    finally:
        shutil.rmtree(run.root, ignore_errors=True)
    return run.outcome
