from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner, Result

from minihuman.data.caches import caches_in
from minihuman.data.selection import Selection
from minihuman.errors import AllocationError
from minihuman.export.run import export
from minihuman.figures import drawings
from minihuman.figures.kept import KeptFigures
from minihuman.lab.next_session import next_session
from minihuman.lab.register_lines import Withdrawn, read_lines, read_register
from minihuman.lab.status import status_lines
from minihuman.lab.withdraw import replace, withdraw
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.statistics.survival import Waited
from tests.lab.test_next_session import PROTOCOL, play

STUDY = "corridor"


@pytest.fixture
def data(tmp_path: Path) -> Path:
    for _ in range(3):
        play(next_session(PROTOCOL, tmp_path), tmp_path, episodes=3)
    return tmp_path


def everything_in(folder: Path) -> str:
    """All files below a folder as text; tables with it."""
    tables = [pd.read_parquet(path).to_csv() for path in folder.rglob("*.parquet")]
    return "\n".join([*tables, *(path.read_bytes().decode(errors="replace") for path in folder.rglob("*.*"))])


def typed(*words: object) -> Result:
    import typer

    from minihuman.cli import desk, export, see, session

    app = typer.Typer()
    for part in (session, see, desk, export):
        part.add_to(app)
    return CliRunner().invoke(app, [str(word) for word in words])


@pytest.mark.program
def test_who_withdrew_occurs_in_no_output_made_afterwards(data: Path, tmp_path: Path) -> None:
    study, out = data / STUDY, tmp_path / "out"
    assert typed("status", study).stdout.count("sub-02") == 1
    assert typed("withdraw", "sub-02", "--study", study, "--erase").exit_code == 0
    outputs = {
        command: typed(command, *words)
        for command, *words in (
            ("status", study),
            ("report", study, "--out", out / "report"),
            ("plot", study, "--out", out / "figures"),
            ("export", "csv", study, out / "csv"),
            ("export", "parquet", study, out / "parquet"),
            ("replay", study, "--save", out / "replay.rrd"),
        )
    }
    for command, told in outputs.items():
        assert told.exit_code == 0, (command, told.output, told.exception)
        assert "sub-02" not in told.output, command
    assert not [path for path in out.rglob("*") if "sub-02" in str(path)]
    assert "sub-01" in everything_in(out)
    assert "sub-02" not in everything_in(out)
    assert "1 withdrew and is left out" in outputs["status"].stdout


def test_no_cache_remembers_who_withdrew(data: Path, tmp_path: Path) -> None:
    list(status_lines(data / STUDY))
    export("parquet", data / STUDY, tmp_path / "out", Selection())
    groups = {"a": Waited(np.array([1.0, 2.0]), np.array([True, False]))}
    KeptFigures(data / STUDY).save(tmp_path / "paths_sub-02", drawings.waiting, groups, label="s")
    assert len(list(caches_in(data / STUDY))) == 4
    withdraw(data / STUDY, "sub-02", seal=None)
    assert list(caches_in(data / STUDY)) == []


def test_erased_data_are_gone_and_the_tombstone_stays(data: Path) -> None:
    gone = withdraw(data / STUDY, "sub-02", seal=None)
    assert gone.files == 1
    assert not (data / STUDY / "sub-02").exists()
    assert [line.withdrawn for line in read_lines(data / STUDY) if isinstance(line, Withdrawn)] == ["sub-02"]
    assert [line.participant for line in read_register(data / STUDY)] == ["sub-01", "sub-03"]
    assert not any("sub-02" in line for line in status_lines(data / STUDY))


def test_sealed_data_are_in_one_archive_elsewhere(data: Path) -> None:
    log = next((data / STUDY / "sub-02").rglob("*.mcap")).read_bytes()
    archive = data / "sealed.zip"
    gone = withdraw(data / STUDY, "sub-02", seal=archive)
    import zipfile

    with zipfile.ZipFile(archive) as sealed:
        assert sealed.read("sub-02/ses-01/sub-02_ses-01.mcap") == log
    assert gone.sha256 in gone.line()
    assert not (data / STUDY / "sub-02").exists()
    with pytest.raises(AllocationError, match="already exists"):
        withdraw(data / STUDY, "sub-03", seal=archive)
    with pytest.raises(AllocationError, match="inside the study"):
        withdraw(data / STUDY, "sub-03", seal=data / STUDY / "x.zip")


def test_the_slot_is_offered_again_under_a_code_that_was_nobodys(data: Path) -> None:
    before = next(line for line in read_register(data / STUDY) if line.participant == "sub-02")
    withdraw(data / STUDY, "sub-02", seal=None)
    plan = next_session(PROTOCOL, data)
    assert (plan.participant.id, plan.participant.index) == ("sub-100002", before.index)
    assert plan.participant.group == before.group
    assert next_session(PROTOCOL, data).participant.id == "sub-04"
    with pytest.raises(AllocationError, match="has withdrawn"):
        next_session(PROTOCOL, data, participant="sub-02")
    assert next_session(PROTOCOL, data, participant="sub-100002").participant.index == before.index


def test_somebody_who_does_not_come_back_is_replaced_and_still_counts(data: Path) -> None:
    replace(data / STUDY, "sub-01")
    assert next_session(PROTOCOL, data).participant.id == "sub-100001"
    assert any(line.startswith("sub-01 ") and "complete" in line for line in status_lines(data / STUDY))
    assert any("sub-01" in line and "does not come back" in line for line in status_lines(data / STUDY))


def test_what_was_cut_short_is_done_the_second_time(data: Path) -> None:
    withdraw(data / STUDY, "sub-02", seal=None)
    (data / STUDY / "sub-02" / "ses-01").mkdir(parents=True)
    (data / STUDY / "sub-02" / "ses-01" / "left").write_text("over")
    assert withdraw(data / STUDY, "sub-02", seal=None).files == 1
    assert not (data / STUDY / "sub-02").exists()


def test_a_running_session_is_not_pulled_from_under_anybody(data: Path) -> None:
    plan = next_session(PROTOCOL, data)
    recorder = McapRecorder(data, plan, started_ns=1)
    with pytest.raises(AllocationError, match="is running"):
        withdraw(data / STUDY, plan.participant.id, seal=None)
    recorder.close()


def test_nobody_of_that_code_and_nothing_said_of_the_data_are_errors(data: Path) -> None:
    with pytest.raises(AllocationError, match=r"'sub-77' has no slot in .*sub-01, sub-02, sub-03"):
        withdraw(data / STUDY, "sub-77", seal=None)
    told = typed("withdraw", "sub-02", "--study", data / STUDY)
    assert isinstance(told.exception, AllocationError)
    assert "--erase" in str(told.exception)


@pytest.mark.parametrize("code", [".", "..", "", "policies", "sub-02/ses-01"])
def test_what_is_no_code_takes_nothing_out(data: Path, code: str) -> None:
    (data / STUDY / "policies").mkdir()
    (data / STUDY / "policies" / "kept.pt").write_text("an agent's")
    (data / "another-study").mkdir()
    before = sorted(data.rglob("*"))
    with pytest.raises(AllocationError, match="is no code"):
        withdraw(data / STUDY, code, seal=None)
    assert sorted(data.rglob("*")) == before


def test_a_session_is_refused_before_the_one_before_it_is_complete(data: Path) -> None:
    assert next_session(PROTOCOL, data, participant="sub-01", session=2).session == 2
    with pytest.raises(AllocationError, match="has not begun session 2; run it first"):
        next_session(PROTOCOL, data, participant="sub-01", session=3)
    plan = next_session(PROTOCOL, data)
    play(plan, data, episodes=1)
    with pytest.raises(AllocationError, match="sub-04 has 2 episodes of session 1 left"):
        next_session(PROTOCOL, data, participant="sub-04", session=2)
    with pytest.raises(AllocationError, match="--participant"):
        next_session(PROTOCOL, data, session=2)
