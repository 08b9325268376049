"""The commands that show data, as they are typed."""

import pytest
import typer
from rerun.chunk import RrdReader
from typer.testing import CliRunner

from minihuman.cli import see
from minihuman.errors import LogError
from minihuman.marks import read_marks
from tests.builders import session, write_log


@pytest.fixture(scope="module")
def app():
    made = typer.Typer()
    see.add_to(made)
    return made


@pytest.fixture
def log(tmp_path):
    return write_log(session(blocks=("grid",), episodes=2), tmp_path / "data")


def run(app, *arguments):
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result


def test_replay_saves_a_recording_and_opens_nothing(app, log, tmp_path):
    result = run(app, "replay", log, "--save", tmp_path / "session.rrd")
    assert result.stdout.strip() == str(tmp_path / "session.rrd")
    assert len(RrdReader(tmp_path / "session.rrd").recordings()) == 1


def test_mark_writes_beside_the_log_and_can_be_taken_back(app, log):
    result = run(app, "mark", log, "--episode", 2, "--tag", "exclude", "--note", "phone rang")
    assert result.stdout.strip() == str(log.with_name("sub-01_ses-01.marks.jsonl"))
    (mark,) = read_marks(log)
    assert (mark.episode, mark.tag, mark.note) == (2, "exclude", "phone rang")
    run(app, "mark", log, "--episode", 2, "--tag", "exclude", "--take-back")
    assert read_marks(log)[1].taken_back


def test_a_mark_on_an_episode_that_is_not_there_is_refused(app, log):
    with pytest.raises(LogError, match="has no episode 3; it has 1 to 2"):
        run(app, "mark", log, "--episode", 3, "--tag", "exclude")


def test_plot_draws_what_the_tags_leave(app, log, tmp_path):
    run(app, "mark", log, "--tag", "pilot")
    result = run(app, "plot", log, "--out", tmp_path / "figures", "--without", "pilot")
    assert "no episode is left in it" in result.stderr
    assert not (tmp_path / "figures").exists()
    result = run(app, "plot", log, "--out", tmp_path / "figures", "--only", "pilot")
    assert [line.rpartition("/")[2] for line in result.stdout.split()] == [
        "overview.png",
        "overview.pdf",
        "paths.png",
        "paths.pdf",
    ]


def test_a_damaged_log_is_named_and_the_rest_is_drawn(app, log, tmp_path):
    (log.parents[2] / "damaged.mcap").write_bytes(b"\x89MCAP0\r\n" + b"rubbish" * 20)
    result = run(app, "plot", log.parents[2], "--out", tmp_path / "figures")
    assert "damaged.mcap" in result.stderr
    assert (tmp_path / "figures" / "sub-01_ses-01" / "paths.png").exists()


@pytest.mark.parametrize("command", ["replay", "plot", "mark", "report"])
def test_every_command_has_help_with_an_example(app, command):
    assert f"Example: minihuman {command}" in run(app, command, "--help").stdout
