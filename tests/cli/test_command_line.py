"""The command line as a whole: its help, what it loads, its earlier names, and what it refuses."""

import inspect
import json
import subprocess
import sys
from importlib import import_module
from keyword import iskeyword
from pathlib import Path

import click
import pytest
from click.testing import CliRunner, Result

from minihuman.cli.command_line import ALIASES, SECTIONS, Subgroup, make_command_line
from minihuman.errors import MinihumanError
from tests.builders import session, write_log
from tests.counts import PATIENCE_S

PROTOCOL = Path(__file__).parents[2] / "protocols" / "demo.toml"
COMMANDS = [(module, name) for module, names in SECTIONS.items() for name in names]


def typed(*words: object) -> Result:
    return CliRunner().invoke(make_command_line(), [str(word) for word in words])


def run_main(*words: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "minihuman", *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE_S, check=False)


@pytest.fixture
def study(tmp_path: Path) -> Path:
    return write_log(session(blocks=("grid",), episodes=1), tmp_path / "data").parents[2]


@pytest.mark.parametrize(
    ("command", "arguments"),
    [("doctor", "[PROTOCOL]"), ("desk", "[FOLDER]"), ("export", "FORMAT STUDY [OUT]"), ("check", "PROTOCOL")],
)
def test_the_usage_of_a_command_brackets_the_arguments_that_may_be_left_out(command, arguments):
    assert typed(command, "--help").output.splitlines()[0].endswith(f"{command} [OPTIONS] {arguments}")


@pytest.mark.parametrize(("module", "name"), COMMANDS)
def test_the_help_of_all_commands_has_each_ones_first_line(module, name):
    function = f"{name}_" if iskeyword(name) else name
    command = getattr(import_module(f"minihuman.cli.{module}"), function)
    text = command.help if isinstance(command, Subgroup) else inspect.getdoc(command)
    assert text.splitlines()[0] == SECTIONS[module][name]


def test_the_help_lists_every_command_on_one_line_under_its_section():
    lines = typed("--help").stdout.splitlines()
    for section, helps in SECTIONS.items():
        assert f"{section.capitalize()}:" in lines
        for name, help in helps.items():
            assert [line for line in lines if line.split() == [name, *help.split()]]
    assert not [line for line in lines if line.split()[:1] in [[name] for name in ALIASES]]


@pytest.mark.parametrize(("module", "name"), COMMANDS)
def test_a_command_and_all_its_options_have_a_help_text(module, name):
    group = make_command_line()
    command = group.get_command(click.Context(group), name)
    for one in [command, *getattr(command, "commands", {}).values()]:
        for parameter in one.params:
            assert parameter.get_help_record(click.Context(one))[1]
            assert one.help


@pytest.mark.parametrize(("old", "new"), ALIASES.items())
def test_an_earlier_name_still_works(old, new):
    assert typed(old, "--help").stdout.split("\n\n")[1:] == typed(new, "--help").stdout.split("\n\n")[1:]


@pytest.mark.program
@pytest.mark.parametrize(("words", "loaded"), [(["--help"], []), (["status", "{study}"], ["minihuman.cli.look"])])
def test_only_the_module_of_the_command_is_imported(study, words, loaded):
    code = (
        "import sys\nfrom minihuman.cli import main\ntry: main()\nfinally: print(sorted(sys.modules), file=sys.stderr)"
    )
    argv = [word.format(study=study) for word in words]
    done = subprocess.run([sys.executable, "-c", code, *argv], capture_output=True, text=True, check=True)
    modules = {name.strip("' []\n") for name in done.stderr.split(",")}
    assert sorted(modules & {f"minihuman.cli.{module}" for module in SECTIONS}) == loaded
    assert not modules & {"typer", "pydantic", "rich", "numpy"}


@pytest.mark.program
def test_a_closed_pipe_is_no_error_message():
    code = (
        "import os, sys; sys.argv[1:] = ['worlds']\n"
        "read, write = os.pipe(); os.close(read); os.dup2(write, 1)\n"
        "from minihuman.cli import main\n"
        "main()"
    )
    done = subprocess.run([sys.executable, "-c", code], stderr=subprocess.PIPE, text=True, check=False)
    assert (done.returncode, done.stderr) == (1, "")


@pytest.mark.program
@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["statsu"], "No such command 'statsu'"),
        (["status"], "Missing argument 'STUDY'"),
        (["status", "a", "b"], "unexpected extra argument"),
        (["status", "a", "--deu"], "--due"),
        (["simulate", "a", "--participants", "0"], "--participants"),
        (["simulate", "a", "--seed", "x"], "--seed"),
        (["play", "a", "--view", "fulll"], "--view"),
        (["status", "/nowhere"], "/nowhere"),
        (["export", "csv", "a"], "--out"),
        (["export", "csv", "a", "b", "--out", "c"], "--out"),
        (["replay", "a", "--out", "b", "--web"], "--web"),
        (["verify", "a", "--manifest", "b", "--policies"], "--policies"),
        (["check", PROTOCOL, "--effect", "excess=0.7"], "add --preregistration"),
    ],
)
def test_a_mistake_is_one_line_and_exit_2(words, said):
    done = run_main(*words)
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert done.stderr.startswith("minihuman: ")
    assert said in done.stderr


@pytest.mark.program
def test_no_command_prints_the_help_and_exits_2():
    for words in ([], ["learn"]):
        done = run_main(*words)
        assert (done.returncode, done.stdout) == (2, "")
        assert "Usage: minihuman" in done.stderr


def test_status_prints_json_with_and_without_due(study):
    told = json.loads(typed("status", study, "--json").stdout)
    (row,) = told["sessions"]
    assert row["summary"]["participant"] == "sub-01"
    assert row["summary"]["complete"] is True
    assert Path(row["path"]).name == "sub-01_ses-01.mcap"
    assert told["withdrew"] == 0
    assert isinstance(json.loads(typed("status", study, "--due", "--json").stdout), list)


def test_an_effect_without_a_preregistration_is_refused():
    failed = typed("check", PROTOCOL, "--effect", "excess=0.7").exception
    assert isinstance(failed, MinihumanError)
    assert "add --preregistration FILE" in str(failed)


def test_both_values_of_a_switch_and_repeated_options_are_read(monkeypatch):
    read = {}

    def record(**values: object) -> None:
        read.update(values)

    import minihuman.cli.start as start

    record.__signature__ = inspect.signature(start.doctor)
    record.__name__ = "doctor"
    monkeypatch.setattr(start, "doctor", record)
    for words, fullscreen in (((), None), (("--fullscreen",), True), (("--windowed",), False)):
        assert typed("doctor", "x.toml", *words).exit_code == 0
        assert (read["fullscreen"], read["protocol"], read["data"]) == (fullscreen, Path("x.toml"), Path("sessions"))
