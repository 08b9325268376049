"""What earlier programs do with a study of today: they refuse it in a sentence and change nothing.

Two earlier commits and the working tree are built into wheels, unpacked and used in turn on one study's folder, in
every order; those that came before today's are then used again.
"""

import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import permutations
from pathlib import Path
from zipfile import ZipFile

import pytest

from minihuman.log.names import PLAIN_SCHEMA_VERSION
from minihuman.log.read.reader import LogReader
from tests.golden.make import segment, study as frozen_study

ROOT = Path(__file__).parents[2]
FIRST, SECOND, NEW = "22b4c34", "e7fb9c2", "new"
ORDERS = tuple(permutations((FIRST, SECOND, NEW)))
PROTOCOL = """
[study]
name = "shared"
version = "1"
seed = 4
participants = 12
[[groups]]
name = "all"
blocks = ["walk"]
[[blocks]]
name = "walk"
world = "minihuman/MiniGrid-Empty-5x5-v0"
actions = ["left", "right", "forward"]
max_steps = 20
episodes = 2
"""
FORMAT_2 = b'"format":2'


@dataclass(frozen=True)
class Programs:
    """Unpacked wheels, by name."""

    folder: Path

    def run(self, name: str, arguments: list[str], at: Path) -> subprocess.CompletedProcess[str]:
        environment = os.environ | {"PYTHONPATH": str(self.folder / name), "PYTHONSAFEPATH": "1"}
        command = [sys.executable, "-m", "minihuman", *arguments]
        return subprocess.run(command, cwd=at, env=environment, capture_output=True, text=True, timeout=600)


@pytest.fixture(scope="module")
def programs(tmp_path_factory: pytest.TempPathFactory) -> Programs:
    folder = tmp_path_factory.mktemp("programs")
    for name in (FIRST, SECOND, NEW):
        source = folder / f"{name}.source"
        source.mkdir()
        archived = subprocess.run(["git", "archive", "HEAD" if name == NEW else name], cwd=ROOT, capture_output=True)
        if archived.returncode:
            pytest.skip(f"the commit {name} is missing: git fetch --unshallow")
        subprocess.run(["tar", "-x"], cwd=source, input=archived.stdout, check=True)
        if name == NEW:  # as it is now
            shutil.rmtree(source / "minihuman")
            shutil.copytree(ROOT / "minihuman", source / "minihuman", ignore=shutil.ignore_patterns("__pycache__"))
        pip = [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "-w", str(source / "wheel"), str(source)]
        subprocess.run(pip, check=True)
        [wheel] = (source / "wheel").glob("*.whl")
        with ZipFile(wheel) as packed:
            packed.extractall(folder / name)
    return Programs(folder)


def commands(name: str, number: int) -> Iterator[list[str]]:
    """What a lab does with a study; what an earlier program lacks is left out.

    So is ``withdraw``, which erases what it is told to erase (docs/log-format.md).
    """
    yield ["simulate", "protocol.toml", "--participants", "1", "--data", "data"]
    yield ["status", "data/shared"]
    yield ["verify", "LOGS" if name == FIRST else "data/shared"]
    yield ["report", "data/shared", "--out", f"report-{number}"]
    yield ["export", "parquet", "data/shared", f"export-{number}"]
    yield ["recover", "data/shared"]
    if name == SECOND:
        yield ["mark", "LOG", "--tag", "exclude"]
        yield ["replace", "sub-01", "--study", "data/shared"]


def contents(folder: Path) -> dict[str, bytes]:
    """What a study's logs, enrolment log and annotations hold; caches are no data."""
    kept = (path for path in folder.rglob("*") if path.suffix in (".mcap", ".part", ".jsonl"))
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(kept)}


def is_new(path: Path) -> bool:
    reading = LogReader(path)
    for _ in reading.messages():
        pass
    return any(int(start["schema_version"]) >= PLAIN_SCHEMA_VERSION for start in reading.starts)


def leave_live_file(at: Path) -> None:
    """A session of today that was killed."""
    log = segment(at / "killed", frozen_study("cut-off"), after_steps=4, part=at / "as-killed")
    folder = at / "data" / "shared" / "sub-99" / "ses-01"
    folder.mkdir(parents=True)
    shutil.move(at / "as-killed", folder / f"{log.name.replace('sub-01', 'sub-99')}.part")


@pytest.mark.nightly
@pytest.mark.program
@pytest.mark.parametrize("order", ORDERS, ids="-".join)
def test_in_every_order_the_new_program_reads_all_and_earlier_ones_change_nothing_new(
    programs: Programs, order: tuple[str, ...], tmp_path: Path
) -> None:
    study = tmp_path / "data" / "shared"
    (tmp_path / "protocol.toml").write_text(PROTOCOL)
    table = []
    for number, name in enumerate((*order, *order[: order.index(NEW)])):
        for arguments in commands(name, number):
            before = contents(study)
            logs = sorted(map(str, study.rglob("*.mcap")))
            filled = [one for word in arguments for one in {"LOGS": logs, "LOG": logs[-1:]}.get(word, [word])]
            done = programs.run(name, filled, tmp_path)
            said = done.stdout + done.stderr
            assert "Traceback" not in said, (order, name, arguments, said)
            if name == NEW:
                assert done.returncode == 0, (order, arguments, said)
            elif FORMAT_2 in before.get("register.jsonl", b""):
                changed = {path for path, data in before.items() if contents(study).get(path) != data}
                assert not changed, (order, name, arguments, said)
                refused = done.returncode == 2 or "newer minihuman" in said or "has log schema version 2" in said
                assert refused or arguments[0] == "recover", (order, name, arguments, said)
            table.append(f"{name} {arguments[0]}: exit {done.returncode}")
        if name == NEW:
            leave_live_file(tmp_path)
            parts = list(study.rglob("*.part"))
            for older in (FIRST, SECOND):
                before = contents(study)
                done = programs.run(older, ["recover", *map(str, parts)], tmp_path)
                assert done.returncode == 2, done.stderr
                assert contents(study) == before
                table.append(f"{older} recover of a live file: exit {done.returncode}")
            shutil.move(parts[0], tmp_path / "taken-out.part")
            shutil.rmtree(study / "sub-99")
    print("\n" + " > ".join(order), *table, sep="\n  ")
    logs = sorted(study.rglob("*.mcap"))
    assert sum(map(is_new, logs)) == 1
