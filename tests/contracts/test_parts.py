"""Kinds of questions and of activities: the built-in ones and a lab's keep their contracts, broken ones do not."""

import json

import pytest
from click.testing import CliRunner

import minihuman
from minihuman.admin.verify.log import find_log_differences
from minihuman.cli.command_line import make_command_line
from minihuman.experiment.machine.activity import GROUP
from minihuman.experiment.machine.events import Answered
from minihuman.log.read.session_reader import read_log
from minihuman.plugins import QUESTION_GROUP, list_plugin_names
from minihuman.testing import ContractError, check_activity, check_question
from minihuman.worlds.adapters.world import World
from tests.lab_package import PARTS, STUDY, example, install_lab as install_lab

BLOCK = {
    "world": "minihuman/MiniGrid-Empty-5x5-v0",
    "actions": ["left", "right", "forward"],
    "episodes": 2,
    "max_steps": 9,
}


@pytest.mark.parametrize("kind", list_plugin_names(QUESTION_GROUP, built_in=True))
def test_our_questions_keep_the_contract(kind):
    check_question(kind)


@pytest.mark.parametrize("kind", ["play", "rating", "takeover"])
def test_our_blocks_keep_the_contract(kind):
    check_activity(kind, block=BLOCK)


@pytest.mark.parametrize(
    ("kind", "settings"),
    [
        ("page", {"title": "T", "pages": ["One.", "Two."]}),
        ("questions", {"title": "T", "items": [{"name": "a", "kind": "likert", "ask": "How?"}]}),
        ("keyboard_check", {"keys": ["1", "2"]}),
    ],
)
def test_our_activities_keep_the_contract(kind, settings):
    check_activity(kind, block=BLOCK, **settings)


@pytest.mark.parametrize(
    ("sound", "broken", "error"),
    [
        ('Click(f"cell:{choose(size)}:{choose(size)}")', 'Click("nowhere")', "clicks on 'nowhere'"),
        ("self.cell = (int(x), int(y))", "pass", "changes nothing on the screen"),
        ("    cell = None", "    cell = None\n    counts = {}", "shares its state"),
        ("""f"{number or ''}\"""", '""', "has no display_text"),
        ('AffectGrid, "number"', 'AffectGrid, "text"', "is not a text"),
        ('"affect_grid", AffectGrid', '"grid", AffectGrid', "calls itself 'grid'"),
        ("else Click(", "and self.value[0] > 9 else Click(", "did not come to its end"),
    ],
)
def test_a_broken_question_is_found(install_lab, sound, broken, error):
    code = example("question")
    assert sound in code
    if error == "shares its state":
        code = code.replace("self.cell = (int(x), int(y))", "self.counts[0] = (int(x), int(y))")
        code = code.replace("== self.cell", "== self.counts.get(0)")
    install_lab("a-lab", code.replace(sound, broken), questions=PARTS["questions"])
    with pytest.raises(ContractError, match=error):
        check_question("affect_grid", settings={"size": 5})


@pytest.mark.parametrize(
    ("sound", "broken", "error"),
    [
        ('return "space"', 'return "a"', "did not come to its end"),
        ("Sheet(size_px, screen.locale)", "Sheet((10, 10), screen.locale)", "drawn in 10 x 10 px"),
        ('f"{seconds:.3f} s per tap"', "str(__import__('time').perf_counter_ns())", "other events"),
        ('ActivityKind("tapping"', 'ActivityKind("taps"', "calls itself 'taps'"),
    ],
)
def test_a_broken_activity_is_found(install_lab, sound, broken, error):
    assert sound in example("activity")
    install_lab("a-lab", example("activity").replace(sound, broken), activities=PARTS["activities"])
    with pytest.raises(ContractError, match=error):
        check_activity("tapping", taps=3)


def test_a_lab_s_parts_are_checked_simulated_verified_and_tabulated(install_lab, tmp_path):
    install_lab("a-lab", example("question") + example("activity"), **PARTS)
    path = tmp_path / "lab.toml"
    path.write_text(STUDY)

    def call(*words: object) -> str:
        result = CliRunner().invoke(make_command_line(), [str(word) for word in words])
        assert result.exit_code == 0, result.output
        return result.output

    call("check", path)
    call("simulate", path, "--participants", 2, "--player", "random", "--data", tmp_path)
    logs = sorted(tmp_path.rglob("*.mcap"))
    assert len(logs) == 2
    call("verify", *logs)
    assert [list(find_log_differences(log, World)) for log in logs] == [[], []]
    events = [event for log in logs for event in read_log(log).part_events]
    answers = [(event.item, json.loads(event.value)) for event in events if isinstance(event, Answered)]
    assert [name for name, _ in answers] == ["feeling_pleasure", "feeling_arousal"] * 2
    assert all(1 <= number <= 5 for _, number in answers)
    table = minihuman.open_study(tmp_path / "lab").table("answers")
    assert list(zip(table["item"], table["number"], strict=True)) == answers
    notes = minihuman.open_study(tmp_path / "lab").table("notes")
    assert list(notes["kind"]).count("tapping") == 2
    assert "affect_grid" in call("plugins")


def test_a_protocol_s_mistake_in_a_lab_s_question_is_named(install_lab, tmp_path):
    install_lab("a-lab", example("question") + example("activity"), **PARTS)
    path = tmp_path / "lab.toml"
    for wrong, error in (
        ("size = 99", "settings.size (questions 'mood') is 99; use 3 to 15"),
        ("colour = 1", "colour"),
    ):
        path.write_text(STUDY.replace("size = 5", wrong))
        result = CliRunner().invoke(make_command_line(), ["check", str(path)])
        assert result.exit_code != 0
        assert error in str(result.exception)


def test_correction_is_a_plug_in_like_the_others():
    assert "correction" in list_plugin_names(GROUP, built_in=True)
