"""The command line is made of parts; asking for a command loads that part alone, and changes nothing that is seen."""

import subprocess
import sys

import pytest
from typer.core import TyperGroup
from typer.main import get_command

from minihuman.cli import PARTS, app


def commands(asked: str = "") -> list[str]:
    group = get_command(app(asked))
    assert isinstance(group, TyperGroup)
    return list(group.commands)


def test_every_part_has_the_commands_that_are_said_of_it() -> None:
    assert commands() == [name for names in PARTS.values() for name in names]
    for names in PARTS.values():
        for name in names:
            assert commands(name) == list(names)


def test_what_is_no_command_is_answered_by_the_whole_command_line() -> None:
    assert commands("--help") == commands("statsu") == commands()


@pytest.mark.program
def test_a_command_loads_no_other_part() -> None:
    code = "import sys; from minihuman.cli import app; app('status'); print([n for n in sys.modules if 'cli.' in n])"
    said = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert "minihuman.cli.session" in said
    assert "minihuman.cli.learn" not in said
