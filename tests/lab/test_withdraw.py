import errno
import os
import shutil
from pathlib import Path

import pandas as pd
import pytest
from click.testing import CliRunner, Result

from minihuman.admin.enrolment_entries import ParticipantWithdrawn, read_enrolled, read_enrolment_log
from minihuman.admin.next_session import plan_next_session
from minihuman.admin.status import format_status
from minihuman.admin.unfinished_withdrawals import find_unfinished_withdrawals
from minihuman.admin.withdrawal import (
    ErasureError,
    replace_participant,
    withdraw_participant,
)
from minihuman.dataset.caches import list_caches
from minihuman.dataset.selection import Selection
from minihuman.errors import AllocationError, LogError
from minihuman.exporters.exporter import export_study
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.storage.remote_store import STORE_URL_FILE_NAME, RemoteStoreError
from minihuman.storage.study_journals import ENROLMENT_FILE_NAME
from minihuman.storage.system import FileSystem, System, use_system
from tests.disks import fill, small_disk
from tests.lab.test_next_session import PROTOCOL, play

STUDY = "corridor"


@pytest.fixture
def data(tmp_path: Path) -> Path:
    for _ in range(3):
        play(plan_next_session(PROTOCOL, tmp_path), tmp_path, episodes=3)
    return tmp_path


def everything_in(folder: Path) -> str:
    """All files below a folder as text; tables with it."""
    tables = [pd.read_parquet(path).to_csv() for path in folder.rglob("*.parquet")]
    return "\n".join([*tables, *(path.read_bytes().decode(errors="replace") for path in folder.rglob("*.*"))])


def typed(*words: object) -> Result:
    from minihuman.cli.command_line import make_command_line

    return CliRunner().invoke(make_command_line(), [str(word) for word in words])


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
            ("replay", study, "--out", out / "replay.rrd"),
        )
    }
    for command, told in outputs.items():
        assert told.exit_code == 0, (command, told.output, told.exception)
        assert "sub-02" not in told.output, command
    assert not [path for path in out.rglob("*") if "sub-02" in str(path)]
    assert "sub-01" in everything_in(out)
    assert "sub-02" not in everything_in(out)
    assert "1 withdrew and is excluded" in outputs["status"].stdout


def test_no_cache_remembers_who_withdrew(data: Path, tmp_path: Path) -> None:
    list(format_status(data / STUDY))
    export_study("parquet", data / STUDY, tmp_path / "out", Selection())
    for former in ("tables.files", "figures.files"):  # of earlier versions
        (data / STUDY / former).mkdir()
        (data / STUDY / former / "paths_sub-02.png").write_bytes(b"of an earlier version")
    for former in ("sessions.sqlite", "sessions.sqlite-journal"):
        (data / STUDY / former).write_bytes(b"of an earlier version")
    assert len(list(list_caches(data / STUDY))) == 6
    withdraw_participant(data / STUDY, "sub-02", seal=None)
    assert list(list_caches(data / STUDY)) == []


def test_erased_data_are_gone_and_the_tombstone_stays(data: Path) -> None:
    gone = withdraw_participant(data / STUDY, "sub-02", seal=None)
    assert gone.files == 1
    assert not (data / STUDY / "sub-02").exists()
    assert [line.withdrawn for line in read_enrolment_log(data / STUDY) if isinstance(line, ParticipantWithdrawn)] == [
        "sub-02"
    ]
    assert [line.participant for line in read_enrolled(data / STUDY)] == ["sub-01", "sub-03"]
    assert not any("sub-02" in line for line in format_status(data / STUDY))


@pytest.mark.parametrize("encoding", ["utf-8", "utf-16", "cp1252"])
def test_the_laboratorys_line_about_who_withdrew_is_named(data: Path, encoding: str) -> None:
    path = data / STUDY / "participants.csv"
    path.write_bytes("participant;town\nsub-02;K\u00f6ln\nsub-03;Rom\n".encode(encoding))
    line = f"{path} still has a line about sub-02; delete it"
    assert line in withdraw_participant(data / STUDY, "sub-02", seal=None).left
    path.write_bytes("participant;town\nsub-020;Rom\n".encode(encoding))
    assert withdraw_participant(data / STUDY, "sub-02", seal=None).left == ()


def test_sealed_data_are_in_one_archive_elsewhere(data: Path) -> None:
    log = next((data / STUDY / "sub-02").rglob("*.mcap")).read_bytes()
    archive = data / "sealed.zip"
    gone = withdraw_participant(data / STUDY, "sub-02", seal=archive)
    import zipfile

    with zipfile.ZipFile(archive) as sealed:
        assert sealed.read("sub-02/ses-01/sub-02_ses-01.mcap") == log
    assert gone.sha256 in gone.line()
    assert not (data / STUDY / "sub-02").exists()
    with pytest.raises(AllocationError, match="already exists"):
        withdraw_participant(data / STUDY, "sub-03", seal=archive)
    with pytest.raises(AllocationError, match="inside the study"):
        withdraw_participant(data / STUDY, "sub-03", seal=data / STUDY / "x.zip")


def test_the_slot_is_offered_again_under_a_code_that_was_nobodys(data: Path) -> None:
    before = next(line for line in read_enrolled(data / STUDY) if line.participant == "sub-02")
    withdraw_participant(data / STUDY, "sub-02", seal=None)
    plan = plan_next_session(PROTOCOL, data)
    assert (plan.participant.id, plan.participant.index) == ("sub-100002", before.index)
    assert plan.participant.group == before.group
    assert plan_next_session(PROTOCOL, data).participant.id == "sub-04"
    with pytest.raises(AllocationError, match="has withdrawn"):
        plan_next_session(PROTOCOL, data, participant="sub-02")
    assert plan_next_session(PROTOCOL, data, participant="sub-100002").participant.index == before.index


def test_somebody_who_does_not_come_back_is_replaced_and_still_counts(data: Path) -> None:
    replace_participant(data / STUDY, "sub-01")
    assert plan_next_session(PROTOCOL, data).participant.id == "sub-100001"
    assert any(line.startswith("sub-01 ") and "complete" in line for line in format_status(data / STUDY))
    assert any("sub-01" in line and "does not come back" in line for line in format_status(data / STUDY))


def test_what_was_cut_short_is_done_the_second_time(data: Path) -> None:
    withdraw_participant(data / STUDY, "sub-02", seal=None)
    (data / STUDY / "sub-02" / "ses-01").mkdir(parents=True)
    (data / STUDY / "sub-02" / "ses-01" / "left").write_text("over")
    assert withdraw_participant(data / STUDY, "sub-02", seal=None).files == 1
    assert not (data / STUDY / "sub-02").exists()


def test_a_running_session_is_not_pulled_from_under_anybody(data: Path) -> None:
    plan = plan_next_session(PROTOCOL, data)
    recorder = McapRecorder(data, plan, started_ns=1)
    with pytest.raises(AllocationError, match="is running"):
        withdraw_participant(data / STUDY, plan.participant.id, seal=None)
    recorder.close()


def test_nobody_of_that_code_and_nothing_said_of_the_data_are_errors(data: Path) -> None:
    with pytest.raises(AllocationError, match=r"'sub-77' has no slot in .*sub-01, sub-02, sub-03"):
        withdraw_participant(data / STUDY, "sub-77", seal=None)
    told = typed("withdraw", "sub-02", "--study", data / STUDY)
    assert isinstance(told.exception, AllocationError)
    assert "--erase" in str(told.exception)


@pytest.mark.parametrize("code", [".", "..", "", "policies", "sub-02/ses-01"])
def test_what_is_no_code_takes_nothing_out(data: Path, code: str) -> None:
    (data / STUDY / "policies").mkdir()
    (data / STUDY / "policies" / "kept.pt").write_text("an agent's")
    (data / "another-study").mkdir()
    before = sorted(data.rglob("*"))
    with pytest.raises(AllocationError, match="is not a participant code"):
        withdraw_participant(data / STUDY, code, seal=None)
    assert sorted(data.rglob("*")) == before


def test_a_session_is_refused_before_the_one_before_it_is_complete(data: Path) -> None:
    assert plan_next_session(PROTOCOL, data, participant="sub-01", session=2).session == 2
    with pytest.raises(AllocationError, match="has not begun session 2; run it first"):
        plan_next_session(PROTOCOL, data, participant="sub-01", session=3)
    plan = plan_next_session(PROTOCOL, data)
    play(plan, data, episodes=1)
    with pytest.raises(AllocationError, match="sub-04 has 2 episodes of session 1 left"):
        plan_next_session(PROTOCOL, data, participant="sub-04", session=2)
    with pytest.raises(AllocationError, match="--participant"):
        plan_next_session(PROTOCOL, data, session=2)


def test_an_archive_for_which_the_disk_has_no_room_leaves_everything_as_it_was(data: Path, tmp_path: Path) -> None:
    (data / STUDY / "sub-02" / "scan").write_bytes(os.urandom(1 << 20))
    (small := tmp_path / "small").mkdir()
    before = {path: path.read_bytes() for path in (data / STUDY).rglob("*") if path.is_file()}
    with small_disk(small, 1 << 16):
        archive = small / "sub-02.zip"
        with pytest.raises(OSError, match="No space left") as refused:
            withdraw_participant(data / STUDY, "sub-02", seal=archive)
        assert refused.value.filename == str(archive)
        assert list(small.iterdir()) == []
    assert {path: path.read_bytes() for path in (data / STUDY).rglob("*") if path.is_file()} == before
    withdraw_participant(data / STUDY, "sub-02", seal=tmp_path / "sub-02.zip")
    assert not (data / STUDY / "sub-02").exists()


def test_an_enrolment_log_that_cannot_be_written_leaves_no_archive(data: Path, tmp_path: Path) -> None:
    (small := tmp_path / "small").mkdir()
    with small_disk(small, 1 << 20):
        study = shutil.copytree(data / STUDY, small / STUDY)
        register = study / ENROLMENT_FILE_NAME
        with register.open("ab") as file:  # to the end of a page, so that the next line needs another
            file.write(b'{"padding":"%s"}\n' % (b"-" * ((-register.stat().st_size - 15) % 4096)))
        assert register.stat().st_size % 4096 == 0
        fill(small, but=0)
        before = {path: path.read_bytes() for path in study.rglob("*") if path.is_file()}
        with pytest.raises(OSError, match="No space left"):
            withdraw_participant(study, "sub-01", seal=tmp_path / "sub-01.zip")
        assert not (tmp_path / "sub-01.zip").exists()
        assert {path: path.read_bytes() for path in study.rglob("*") if path.is_file()} == before


@pytest.mark.parametrize("error", [FileExistsError, OSError])
def test_an_archive_is_taken_away_whatever_stops_the_withdrawal(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, error: type[OSError]
) -> None:
    def fail(*_: object) -> None:
        raise error("of the enrolment log")

    monkeypatch.setattr("minihuman.admin.withdrawal.record_departure", fail)
    with pytest.raises(error, match="of the enrolment log"):
        withdraw_participant(data / STUDY, "sub-01", seal=tmp_path / "sub-01.zip")
    assert not (tmp_path / "sub-01.zip").exists()


def test_a_damaged_enrolment_log_erases_nothing(data: Path) -> None:
    register = data / STUDY / ENROLMENT_FILE_NAME
    register.write_bytes(register.read_bytes().replace(b'"group":"one"', b'"group":"two"', 1))
    with pytest.raises(LogError, match="it was changed"):
        withdraw_participant(data / STUDY, "sub-02", seal=None)
    assert list((data / STUDY / "sub-02").rglob("*.mcap"))


class _UnwritableFile(FileSystem):
    """A disk that does not let go of one file."""

    def unlink(self, path: Path) -> None:
        if path.suffix == ".mcap":
            raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(path))
        super().unlink(path)


def test_what_cannot_be_erased_is_named_and_status_and_verify_name_the_participant_until_it_is(data: Path) -> None:
    (data / STUDY / "sub-02" / "scan").write_bytes(b"the rest")
    log = next((data / STUDY / "sub-02").rglob("*.mcap"))
    with use_system(System(disk=_UnwritableFile())), pytest.raises(ErasureError) as refused:
        withdraw_participant(data / STUDY, "sub-02", seal=None)
    assert "sub-02 has withdrawn, but not all of their data could be erased" in str(refused.value)
    assert str(log) in str(refused.value)
    assert [path for path in (data / STUDY / "sub-02").rglob("*") if path.is_file()] == [log]
    for command in ("status", "verify"):
        with use_system(System(disk=_UnwritableFile())):  # else the command erases the rest itself
            words = typed(command, data / STUDY)
        assert words.exit_code == 1
        assert "run `minihuman withdraw sub-02` again" in words.output, command
    withdraw_participant(data / STUDY, "sub-02", seal=None)
    assert "sub-02" not in typed("status", data / STUDY).output
    assert [path.name for path in (data / STUDY).iterdir() if "sub-02" in path.name] == []


def test_the_same_archive_is_taken_again_if_it_has_all_of_the_participant(data: Path) -> None:
    archive = data / "sealed.zip"
    with use_system(System(disk=_UnwritableFile())), pytest.raises(ErasureError):
        withdraw_participant(data / STUDY, "sub-02", seal=archive)
    sealed = archive.read_bytes()
    assert withdraw_participant(data / STUDY, "sub-02", seal=archive).sealed == archive
    assert archive.read_bytes() == sealed
    assert not (data / STUDY / "sub-02").exists()


def test_a_store_of_logs_that_is_not_mounted_is_not_taken_for_an_empty_one(data: Path, tmp_path: Path) -> None:
    (data / STORE_URL_FILE_NAME).write_text(f"{tmp_path / 'share'}\n")
    with pytest.raises(RemoteStoreError, match="share' cannot be used as a remote store: it is not a folder; mount"):
        withdraw_participant(data / STUDY, "sub-02", seal=None)
    assert not (tmp_path / "share").exists()
    assert list(find_unfinished_withdrawals(data / STUDY))
    (tmp_path / "share").mkdir()
    withdraw_participant(data / STUDY, "sub-02", seal=None)
    assert not list(find_unfinished_withdrawals(data / STUDY))
