"""info, verify and recover, as typed."""

import hashlib
import json
import re
from dataclasses import replace
from pathlib import Path

import click
import msgspec
import pytest
from click.testing import CliRunner

from minihuman.admin.manifest import StudyManifest, record_log_end, write_manifest
from minihuman.admin.status import format_status
from minihuman.admin.verify import log as proofs
from minihuman.admin.verify.log import find_log_differences
from minihuman.cli.command_line import make_command_line
from minihuman.dataset.caches import TABLE_CACHE
from minihuman.dataset.selection import Selection
from minihuman.errors import ExportError, LogError
from minihuman.experiment.machine.events import Stepped
from minihuman.exporters.exporter import export_study
from minihuman.log.read.session_reader import read_events
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.runtime.simulated_session import simulate
from minihuman.worlds.source_digest import rules_digest
from tests.golden.make import segment, study as golden
from tests.log.played import played_events, record
from tests.log.samples import STARTED_NS, session_events, session_plan
from tests.promises.sessions import play, study

PLAN = session_plan(episodes=2)


@pytest.fixture
def app() -> click.Group:
    return make_command_line()


def test_info_tells_a_session_in_lines(app: click.Group, tmp_path: Path) -> None:
    log = record(tmp_path, PLAN, session_events(PLAN))
    result = CliRunner().invoke(app, ["info", str(log)])
    assert result.exit_code == 0
    assert "sub-07, group transfer, session 1" in result.stdout
    assert "complete, clean" in result.stdout
    assert len([line for line in result.stdout.splitlines() if " goal " in line]) == 2


def test_info_tells_a_session_as_json(app: click.Group, tmp_path: Path) -> None:
    log = record(tmp_path, PLAN, session_events(PLAN))
    told = json.loads(CliRunner().invoke(app, ["info", "--json", str(log)]).stdout)
    assert (told["participant"], told["end_reason"], told["clean"]) == ("sub-07", "complete", True)
    assert [(episode["steps"], episode["median_rt_ms"]) for episode in told["episodes"]] == [(20, 290.5)] * 2


def test_verify_says_that_a_log_replays_and_exits_0(app: click.Group, tmp_path: Path) -> None:
    log = play(tmp_path, study(episodes=2))
    result = CliRunner().invoke(app, ["verify", str(log)])
    assert result.exit_code == 0, result.stdout
    assert re.fullmatch(rf"{log}: 2 episodes, \d+ steps, all as logged\n", result.stdout)


def test_verify_says_first_that_other_rules_recorded_a_log(app: click.Group, tmp_path: Path) -> None:
    log = play(tmp_path, study(episodes=2), facts={"rules": "0123456789abcdef"})
    result = CliRunner().invoke(app, ["verify", str(log)])
    assert result.exit_code == 0, result.stdout
    said, proven = result.stdout.splitlines()
    assert said == f"{log}: recorded by rules 0123456789abcdef, checked by rules {rules_digest()}"
    assert proven.endswith("all as logged")


def test_a_sealed_study_says_what_was_changed_since(app: click.Group, tmp_path: Path) -> None:
    log = play(tmp_path, study(episodes=1))
    folder = log.parents[2]
    digest = CliRunner().invoke(app, ["seal", str(folder)]).stdout.strip()
    for given in (digest, str(folder / "seal.json")):
        whole = CliRunner().invoke(app, ["verify", str(folder), "--manifest", given])
        assert (whole.exit_code, whole.stdout) == (0, f"{folder}: every file is as it was sealed\n")
    log.write_bytes(log.read_bytes() + b"x")
    (folder / "note.txt").write_text("hello")
    for given in (digest, str(folder / "seal.json")):
        changed = CliRunner().invoke(app, ["verify", str(folder), "--manifest", given])
        assert changed.exit_code == 1
        assert f"{log.relative_to(folder)} was changed" in changed.stdout
        assert "note.txt was not there" in changed.stdout
    sealed_anew = CliRunner().invoke(app, ["seal", str(folder)]).stdout.strip()
    assert sealed_anew != digest
    assert CliRunner().invoke(app, ["verify", str(folder), "--manifest", digest]).exit_code == 1


def test_what_looking_at_a_sealed_study_leaves_there_breaks_no_seal(app: click.Group, tmp_path: Path) -> None:
    log = play(tmp_path / "data", study(episodes=1))
    folder = log.parents[2]
    digest = CliRunner().invoke(app, ["seal", str(folder)]).stdout.strip()
    list(format_status(folder))
    export_study("parquet", folder, tmp_path / "out", Selection())
    assert (folder / TABLE_CACHE).exists()
    for former in ("tables.files", "figures.files"):  # of earlier versions
        (folder / former).mkdir()
        (folder / former / "episodes.parquet").write_bytes(b"of an earlier version")
    (folder / "sessions.sqlite").write_bytes(b"of an earlier version")
    assert CliRunner().invoke(app, ["verify", str(folder), "--manifest", digest]).exit_code == 0


@pytest.mark.parametrize("is_empty", [True, False])
def test_an_export_into_the_current_folder_is_refused_and_writes_nothing(
    app: click.Group, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_empty: bool
) -> None:
    source = play(tmp_path / "data", study(episodes=1)).parents[2]
    (here := tmp_path / "here").mkdir()
    if not is_empty:
        (here / "notes.txt").touch()
    monkeypatch.chdir(here)
    result = CliRunner().invoke(app, ["export", "csv", str(source), "."])
    assert isinstance(result.exception, ExportError)
    assert re.search("choose a(nother| new) folder", str(result.exception))
    assert [path.name for path in here.iterdir()] == ["notes.txt"] * (not is_empty)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["data", "here"]


@pytest.mark.parametrize("name", ["seal.json.txt", "sub-01/seal.json", "sub-01/tables.duckdb", "sessions.sqlite.mcap"])
def test_only_the_caches_themselves_are_outside_of_a_seal(app: click.Group, tmp_path: Path, name: str) -> None:
    log = play(tmp_path, study(episodes=1))
    folder = log.parents[2]
    digest = CliRunner().invoke(app, ["seal", str(folder)]).stdout.strip()
    (folder / name).parent.mkdir(exist_ok=True)
    (folder / name).write_text("smuggled in")
    result = CliRunner().invoke(app, ["verify", str(folder), "--manifest", digest])
    assert result.exit_code == 1
    assert f"{name} was not there" in result.stdout


def test_a_seal_that_holds_a_cache_is_believed_without_it(app: click.Group, tmp_path: Path) -> None:
    folder = play(tmp_path, study(episodes=1)).parents[2]
    files = write_manifest(folder).files | {TABLE_CACHE: "0" * 64}
    lines = "".join(f"{of_file}  {name}\n" for name, of_file in sorted(files.items()))
    digest = hashlib.sha256(lines.encode()).hexdigest()
    (folder / "seal.json").write_bytes(msgspec.json.encode(StudyManifest(digest, files)))
    for given in (digest, str(folder / "seal.json")):
        assert CliRunner().invoke(app, ["verify", str(folder), "--manifest", given]).exit_code == 0


def test_a_log_that_was_made_anew_is_not_the_one_in_the_register(app: click.Group, tmp_path: Path) -> None:
    (log,) = simulate(study(episodes=1), tmp_path, participants=1, seed=1, player="random")
    assert "sealed" in (log.parents[2] / "register.jsonl").read_text()
    assert CliRunner().invoke(app, ["verify", str(log)]).exit_code == 0
    (other,) = simulate(study(episodes=1), tmp_path / "other", participants=1, seed=2, player="random")
    log.write_bytes(other.read_bytes())
    for given in (log, log.parent, log.parents[2]):  # a session's folder and a study's are proven as whole as the log
        result = CliRunner().invoke(app, ["verify", str(given)])
        assert result.exit_code == 1
        assert f"{log}: segment 1 ended with chain" in result.stdout
        assert "the enrolment log says" in result.stdout


@pytest.mark.parametrize(("inside", "given"), [(1, "{log.name}"), (2, "ses-01"), (2, "."), (1, ".")])
def test_the_register_is_asked_of_a_log_that_is_named_from_inside_its_study(
    app: click.Group, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, inside: int, given: str
) -> None:
    (log,) = simulate(study(episodes=1), tmp_path, participants=1, seed=1, player="random")
    (other,) = simulate(study(episodes=1), tmp_path / "other", participants=1, seed=2, player="random")
    log.write_bytes(other.read_bytes())
    monkeypatch.chdir(log.parents[inside - 1])
    result = CliRunner().invoke(app, ["verify", given.format(log=log)])
    assert result.exit_code == 1
    assert "the enrolment log says" in result.stdout


def test_verify_names_the_first_difference_and_exits_1(app: click.Group, tmp_path: Path) -> None:
    events = [
        replace(event, state_hash=0) if isinstance(event, Stepped) and event.step == 3 else event
        for event in played_events(PLAN, steps=5)
    ]
    log = record(tmp_path, PLAN, events)
    result = CliRunner().invoke(app, ["verify", str(log)])
    assert result.exit_code == 1
    assert result.stdout.startswith(f"{log}: episode 1 step 3: state hash 0000000000000000 in the log, now ")
    said = CliRunner().invoke(app, ["verify", "--json", str(log)])
    told = [json.loads(line) for line in said.stdout.splitlines()]
    assert (said.exit_code, told[0]["log"], told[0]["fine"]) == (1, str(log), False)
    assert [f"{one['log']}: {one['said']}" for one in told] == result.stdout.splitlines()


def test_recover_says_how_many_steps_it_kept(app: click.Group, tmp_path: Path) -> None:
    part = _cut_off(tmp_path)
    result = CliRunner().invoke(app, ["recover", str(part)])
    log = part.with_suffix("")
    assert (result.exit_code, result.stdout) == (0, f"{log}: kept 7 steps of 1 episodes; ended: cut_off\n")
    assert len(list(read_events(log))) == 30


def test_recover_looks_through_a_folder(app: click.Group, tmp_path: Path) -> None:
    _cut_off(tmp_path)
    assert "kept 7 steps" in CliRunner().invoke(app, ["recover", str(tmp_path)]).stdout
    assert CliRunner().invoke(app, ["recover", str(tmp_path)]).stdout == "no cut-off logs\n"


def test_a_file_that_is_no_log_is_an_error_for_one_line(app: click.Group, tmp_path: Path) -> None:
    text = tmp_path / "notes.mcap"
    text.write_text("dear diary")
    error = CliRunner().invoke(app, ["info", str(text)]).exception
    assert isinstance(error, LogError)
    assert "notes.mcap is not a session log" in str(error)


def test_verify_goes_through_a_study_and_a_log_that_cannot_be_read_holds_up_none_behind_it(
    app: click.Group, tmp_path: Path
) -> None:
    log = play(tmp_path, study(episodes=1))
    record_log_end(log)
    bad = log.parents[2] / "sub-00" / "ses-01" / "sub-00_ses-01.mcap"
    bad.parent.mkdir(parents=True)
    bad.write_text("dear diary")
    for given in ([bad, log], [log.parents[2]]):
        result = CliRunner().invoke(app, ["verify", *map(str, given)])
        assert result.exit_code == 2
        assert re.fullmatch(rf"{log}: 1 episodes, \d+ steps, all as logged\n", result.stdout)
        assert re.fullmatch(rf"minihuman: {bad} is not a session log.*\n", result.stderr)
    assert json.loads(CliRunner().invoke(app, ["verify", "--json", str(bad)]).stdout)["fine"] is False
    (tmp_path / "empty").mkdir()
    nothing = CliRunner().invoke(app, ["verify", str(tmp_path / "empty")]).exception
    assert isinstance(nothing, LogError)
    assert "name a log or a study's folder" in str(nothing)


def test_verify_proves_every_file_of_a_session_that_was_cut_off_again(
    app: click.Group, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    log = segment(tmp_path, golden("resumed"), after_steps=6, key="escape")
    first, part = log.read_bytes(), log.with_name(f"{log.stem}_seg-02.mcap.part")
    segment(tmp_path, golden("resumed"), after_steps=3, part=tmp_path / "kept")
    log.write_bytes(first)
    (tmp_path / "kept").rename(part)
    record_log_end(log)
    proven = []
    monkeypatch.setattr(
        proofs,
        "find_log_differences",
        lambda file, make_world: (proven.append(file), find_log_differences(file, make_world))[1],
    )
    result = CliRunner().invoke(app, ["verify", str(tmp_path)])
    assert (result.exit_code, proven) == (0, [log, part]), result.stdout
    assert re.fullmatch(rf"{log.parent}: \d+ episodes, \d+ steps, all as logged\n", result.stdout)


def _cut_off(data: Path) -> Path:
    recorder = McapRecorder(data, PLAN, started_ns=STARTED_NS)
    recorder.write(session_events(PLAN)[:30])
    recorder.drain()
    content = recorder.segment_path.part.read_bytes()
    recorder.close()
    recorder.segment_path.log.unlink()
    recorder.segment_path.part.write_bytes(content)
    return recorder.segment_path.part
