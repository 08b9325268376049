"""The commands that show data, as they are typed."""

import re
import struct

import pytest
from click.testing import CliRunner

from minihuman.cli.command_line import SECTIONS, make_command_line
from minihuman.dataset.annotations import read_annotations
from minihuman.errors import LogError
from tests.builders import session, write_log

pytestmark = pytest.mark.program


@pytest.fixture(scope="module")
def app():
    return make_command_line()


@pytest.fixture
def log(tmp_path):
    return write_log(session(blocks=("grid",), episodes=2), tmp_path / "data")


def run(app, *arguments):
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result


def test_replay_saves_a_recording_and_opens_nothing(app, log, tmp_path):
    from rerun.chunk import RrdReader

    result = run(app, "replay", log, "--out", tmp_path / "session.rrd")
    assert result.stdout.strip() == str(tmp_path / "session.rrd")
    assert len(RrdReader(tmp_path / "session.rrd").recordings()) == 1


def test_annotate_writes_beside_the_log_and_can_be_taken_back(app, log):
    result = run(app, "annotate", log, "--episode", 2, "--tag", "exclude", "--note", "phone rang")
    assert result.stdout.strip() == str(log.with_name("sub-01_ses-01.marks.jsonl"))
    (mark,) = read_annotations(log)
    assert (mark.episode, mark.tag, mark.note) == (2, "exclude", "phone rang")
    run(app, "annotate", log, "--episode", 2, "--tag", "exclude", "--take-back")
    assert read_annotations(log)[1].taken_back


def test_a_mark_on_an_episode_that_is_not_there_is_refused(app, log):
    with pytest.raises(LogError, match="has no episode 3; its episodes are 1 to 2"):
        run(app, "annotate", log, "--episode", 3, "--tag", "exclude")


def test_plot_draws_what_the_tags_leave(app, log, tmp_path):
    run(app, "annotate", log, "--tag", "pilot")
    result = run(app, "plot", log, "--out", tmp_path / "figures", "--without", "pilot")
    assert "0 episodes of 0 sessions included" in result.stderr
    assert "excluded: 2 episodes: tagged pilot" in result.stderr
    assert not (tmp_path / "figures").exists()
    result = run(app, "plot", log, "--out", tmp_path / "figures", "--only", "pilot")
    assert [line.rpartition("/")[2] for line in result.stdout.split()] == [
        "overview.png",
        "overview.pdf",
        "paths.png",
        "paths.pdf",
    ]


def test_a_damaged_log_is_named_and_the_rest_is_drawn(app, log, tmp_path):
    (log.parents[2] / "sub-09_ses-01.mcap").write_bytes(b"\x89MCAP0\r\n" + b"rubbish" * 20)
    result = run(app, "plot", log.parents[2], "--out", tmp_path / "figures")
    assert "sub-09_ses-01.mcap" in result.stderr
    assert (tmp_path / "figures" / "sub-01_ses-01" / "paths.png").exists()


@pytest.fixture(scope="module")
def spoiled(tmp_path_factory):
    """A study of two whole sessions among a damaged, an empty, a foreign and a half-written log."""
    data = tmp_path_factory.mktemp("data")
    for index in range(2):
        whole = write_log(session(participant=f"sub-0{index + 1}", index=index, blocks=("grid",), episodes=1), data)
    content = whole.read_bytes()
    (end,) = struct.unpack_from("<Q", content, len(content) - 8 - 20)  # the footer: where the index starts
    middle = end // 2
    bad = data / "transfer" / "bad"
    bad.mkdir()
    (bad / "damaged.mcap").write_bytes(content[:middle] + bytes([content[middle] ^ 0xFF]) + content[middle + 1 :])
    (bad / "empty.mcap").touch()
    (bad / "foreign.mcap").write_text("dear diary")
    (bad / "half.mcap").write_bytes(content[:middle])
    return data / "transfer"


@pytest.mark.parametrize("command", ["replay", "plot", "report", "export", "status"])
def test_every_command_names_what_it_cannot_read_does_the_rest_and_changes_no_log(spoiled, tmp_path, command):
    from rerun.chunk import RrdReader

    logs = {path: path.read_bytes() for path in spoiled.rglob("*.mcap")}
    out = tmp_path / "out"
    app = make_command_line()
    words, done = {
        "replay": ((spoiled, "--out", out), lambda _: len(RrdReader(out).recordings()) == 1),
        "plot": ((spoiled, "--out", out, "--each"), lambda _: len(list(out.glob("sub-0?_ses-01/paths.png"))) == 2),
        "report": (
            (spoiled, "--out", out),
            lambda _: "2 sessions read, 4 skipped" in (out / "report.html").read_text(),
        ),
        "export": (("parquet", spoiled, out), lambda _: "2 episodes" in (out / "README.md").read_text()),
        "status": ((spoiled,), lambda told: all(f"sub-0{number}" in told for number in (1, 2))),
    }[command]
    result = run(app, command, *words)
    assert result.exit_code == 0
    if command == "status":  # a glance at both ends: what is damaged between looks like the other copy of its session
        assert re.search(r"one of 2 logs of this session.*damaged\.mcap", result.output)
    for name in ("damaged", "empty", "foreign", "half")[command == "status" :]:
        assert re.search(rf"{name}\.mcap.*(damaged|is empty|not a session log|cut off|1 of sub-02)", result.output)
    assert done(result.output)
    assert {path: path.read_bytes() for path in spoiled.rglob("*.mcap")} == logs


def test_a_replay_of_nothing_that_can_be_read_is_an_error(app, spoiled, tmp_path):
    with pytest.raises(LogError, match=r"nothing to show|is empty|cut off"):
        run(app, "replay", spoiled / "bad" / "half.mcap", "--out", tmp_path / "none.rrd")


def test_a_report_names_the_figures_in_its_folder_that_it_did_not_draw(app, tmp_path):
    """Whose they are, nobody can see: those of another study, or of people who have withdrawn since."""
    data, out = tmp_path / "data", tmp_path / "out"
    write_log(session(blocks=("grid",), episodes=1), data)
    run(app, "report", data, "--out", out)
    assert "not this report's" not in run(app, "report", data, "--out", out).stderr
    for name in ("paths_gone.png", "paths_gone.pdf", "notes.txt"):
        (out / "figures" / name).write_bytes(b"")
    said = run(app, "report", data, "--out", out).stderr
    assert f"{out}/figures holds 2 files that are not this report's: paths_gone.pdf to paths_gone.png; remove" in said
    assert (out / "figures" / "notes.txt").exists()


ALONE = [name for names in SECTIONS.values() for name in names if name not in ("learn", "bench")]  # not in a group


@pytest.mark.parametrize("command", [*ALONE, "bench new", "bench run"])
def test_every_command_has_help_with_an_example(app, command):
    assert f"Example: minihuman {command}" in run(app, *command.split(), "--help").stdout
