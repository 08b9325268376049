"""A disk that is full: one sentence that names the output, whatever library was writing."""

import os
import shutil
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from minihuman.cli import main
from minihuman.storage.remote_store import STORE_URL_FILE_NAME
from tests.counts import PATIENCE_S, count
from tests.disks import fill, small_disk

PLAIN = Path(__file__).parents[1] / "golden" / "v1" / "plain"
DEMO = Path(__file__).parents[2] / "protocols" / "demo.toml"
pytestmark = pytest.mark.program


@pytest.fixture
def study(tmp_path: Path) -> Path:
    return Path(shutil.copytree(PLAIN, tmp_path / "plain"))


def minihuman(*words: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "minihuman", *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, env=os.environ, check=False)


def said(done: subprocess.CompletedProcess[str]) -> list[str]:
    """What a command complained of; that kernels are compiled is said on a fresh machine, and no complaint."""
    return [line for line in done.stderr.splitlines() if not line.startswith("compiling ")]


@pytest.mark.parametrize("free_bytes", [12_000, 40_000, 70_000])
def test_minari_on_a_full_disk_is_one_sentence(free_bytes: int, tmp_path: Path) -> None:
    pytest.importorskip("minari")
    study = shutil.copytree(PLAIN, tmp_path / "plain")
    disk = tmp_path / "disk"
    disk.mkdir()
    with small_disk(disk, 2_000_000):
        fill(disk, but=free_bytes)
        done = minihuman("export", "minari", study, "--out", disk / "out")
    assert done.returncode == 2
    assert said(done) == [f"minihuman: {disk / 'out'}: No space left on device"]


@pytest.mark.nightly(by_day=["plot"])
@pytest.mark.parametrize("command", ["report", "plot"])
def test_a_report_and_figures_on_a_full_disk_are_one_sentence(command: str, tmp_path: Path) -> None:
    study = shutil.copytree(PLAIN, tmp_path / "plain")
    disk = tmp_path / "disk"
    disk.mkdir()
    with small_disk(disk, 2_000_000):
        fill(disk, but=40_000)
        done = minihuman(command, study, "--out", disk / "out")
    assert done.returncode == 2
    assert said(done) == [f"minihuman: {disk / 'out'}: No space left on device"]


def test_a_refusal_writes_a_line_break_of_a_name_as_an_escape(tmp_path: Path) -> None:
    done = minihuman("export", "csv", tmp_path / "a\nb", "--out", tmp_path / "out")
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "a\\nb" in done.stderr


@pytest.mark.parametrize("command", ["worlds", "status STUDY"])  # one that returns, one that exits
def test_a_terminal_that_takes_nothing_is_one_sentence(command: str, study: Path, tmp_path: Path) -> None:
    buffered = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    with Path("/dev/full").open("w") as full:
        words = [sys.executable, "-m", "minihuman", *filled(command, study, tmp_path / "out")]
        done = subprocess.run(words, stdout=full, stderr=subprocess.PIPE, text=True, check=False, env=buffered)
    assert done.returncode == 2
    assert said(done) == ["minihuman: No space left on device"]


def called(words: list[str], monkeypatch: pytest.MonkeyPatch) -> int:
    """The exit status of a command in this process; what is printed goes where the streams lead."""
    monkeypatch.setattr(sys, "argv", ["minihuman", *words])
    with pytest.raises(SystemExit) as ended:
        main()
    return int(ended.value.code or 0)


PRINTING = (
    *(
        "--help",
        "--version",
        "worlds",
        "plugins",
        "schema",
        "export --help",
        "status STUDY",
        "info LOG",
        "recover STUDY",
    ),
    *("verify LOG", "verify LOG --json", "query STUDY from_episodes", "query STUDY from_steps --csv", "manifest STUDY"),
    *("query STUDY from_steps --json", "export csv STUDY --out OUT", "replay LOG --out OUT.rrd", "check DEMO --json"),
)


@pytest.mark.parametrize("command", PRINTING)
def test_a_command_whose_output_nobody_takes_says_so_in_a_sentence(
    command: str, study: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    full = Path("/dev/full").open("w")  # noqa: SIM115  (closing it fails)
    monkeypatch.setattr(sys, "stdout", full)
    code = called(filled(command, study, tmp_path / "out"), monkeypatch)
    monkeypatch.undo()
    with suppress(OSError):
        full.close()
    errors = [line for line in capsys.readouterr().err.splitlines() if line.startswith("minihuman: ")]
    assert (code, errors) == (2, ["minihuman: No space left on device"])


WRITING = (
    *("new OUT --yes", "replay LOG --out OUT.rrd", "withdraw sub-01 --study STUDY --archive OUT.zip --reason asked"),
    *("simulate DEMO --participants 1 --player optimal --data OUT", "gather STUDY"),
    *("deploy DEMO --address https://study.example.org --out OUT", "check DEMO --preregistration OUT.md"),
    *("export parquet STUDY --out OUT", "export lerobot STUDY --out OUT", "export imitation STUDY --out OUT"),
    *("export bids STUDY --out OUT", "export psych-ds STUDY --out OUT", "export frictionless STUDY --out OUT"),
    *("export croissant STUDY --out OUT", "check DEMO --pictures OUT"),
    "power DEMO --effect none --groups 4 --studies 10 --people 4 --out OUT",
)


@pytest.mark.nightly(sample=True)
@pytest.mark.parametrize("free_bytes", count((0,), (0, 8_000, 30_000)))
@pytest.mark.parametrize("command", count(WRITING[:5], WRITING))
def test_a_command_whose_disk_is_full_names_what_it_was_to_write(
    command: str,
    free_bytes: int,
    study: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (tmp_path / STORE_URL_FILE_NAME).write_text(f"{tmp_path / 'disk'}\n")
    before = {path: path.read_bytes() for path in study.rglob("*.mcap")}
    (disk := tmp_path / "disk").mkdir()
    with small_disk(disk, 2_000_000):
        fill(disk, but=free_bytes)
        code = called(filled(command, study, disk / "out"), monkeypatch)
        left = [path.name for path in disk.rglob("*") if path.is_file() and path.name != "ballast"]
    if code == 0:
        assert free_bytes, "nothing had to be written"
        return
    [error] = [line for line in capsys.readouterr().err.splitlines() if line.startswith("minihuman: ")]
    assert (code, str(disk) in error, "No space left on device" in error) == (2, True, True), error
    assert not {"out.md", "out.md.part", "out.rrd", "out.zip"} & {*left}
    assert {path: path.read_bytes() for path in study.rglob("*.mcap")} == before


def test_a_server_whose_disk_is_full_says_so_and_ends(tmp_path: Path) -> None:
    with small_disk(tmp_path, 65_536):
        fill(tmp_path, but=0)
        command = [sys.executable, "-m", "minihuman", "serve", DEMO, "--port", "0", "--data", tmp_path]
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=PATIENCE_S)
    [error] = [line for line in said(done) if line.startswith("minihuman: ")]
    assert (done.returncode, str(tmp_path) in error, "No space left on device" in error) == (2, True, True), error


def filled(command: str, study: Path, out: Path) -> list[str]:
    """A command's words, with names for what is written in capitals."""
    log = next(study.rglob("*.mcap"))
    names = {"STUDY": study, "LOG": log, "DEMO": DEMO}
    return [str(names.get(word, word.replace("from_", "from ").replace("OUT", str(out)))) for word in command.split()]


def test_a_test_that_fails_with_a_file_open_leaves_no_disk_mounted(tmp_path: Path) -> None:
    with small_disk(tmp_path, 65_536):
        held = (tmp_path / "held").open("w")
    assert not tmp_path.is_mount()
    held.close()
