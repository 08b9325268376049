"""What is typed plainly is read without Typer, as Typer would read it."""

import subprocess
import sys
from collections.abc import Callable
from functools import wraps
from importlib import import_module
from inspect import Parameter, signature
from pathlib import Path
from typing import get_args

import pytest
from typer import Typer
from typer.main import get_command

from minihuman.cli import PARTS
from minihuman.cli.declared import Argument, Option
from minihuman.cli.plain import plain
from minihuman.cli.typed import typed

COMMANDS = [(part, name) for part, names in PARTS.items() for name in names if name != "learn"]


def command_of(part: str, name: str):
    return getattr(import_module(f"minihuman.cli.{part}"), name)


def words_of(parameter: Parameter) -> list[list[str]]:
    """Ways to give it."""
    kind, declared = get_args(parameter.annotation)[:2]
    if isinstance(declared, Argument):
        return [["a/b", "c d"]] if kind == list[Path] else [["a/b.toml"]]
    assert isinstance(declared, Option)
    names = declared.names or (f"--{parameter.name.replace('_', '-')}",)
    if kind in (bool, bool | None):
        names = declared.names or (f"{names[0]}/--no-{names[0][2:]}",)
        return [[one] for name in names for one in name.split("/")]
    return [[name, value] for name in names for value in ("12", "7" if kind in (int, int | None) else "a b=c")]


def by_typer(command: Callable[..., None], words: list[str]) -> dict[str, object]:
    """What Typer would call it with."""
    read: dict[str, object] = {}

    @wraps(command)
    def told(**named: object) -> None:
        read.update(named)

    app = Typer()
    app.command()(typed(told))
    get_command(app).main(list(words), standalone_mode=False)
    return read


def of_choosing(value: object) -> object:
    return value or None if isinstance(value, list | tuple) else value


@pytest.mark.parametrize(("part", "name"), COMMANDS)
def test_what_is_plain_is_read_as_typer_reads_it(part, name):
    command = command_of(part, name)
    parameters = signature(command).parameters.values()
    needed = [word for one in parameters if one.default is Parameter.empty for word in words_of(one)[0]]
    read = 0
    for more in [[]] + [words for one in parameters if one.default is not Parameter.empty for words in words_of(one)]:
        given = plain(command, [*needed, *more])
        if given is not None:
            read += 1
            theirs = by_typer(command, [*needed, *more])
            assert {key: of_choosing(value) for key, value in theirs.items()} == given
            assert plain(command, [*more, *needed]) in (given, None)
    assert read > 0


@pytest.mark.parametrize(
    "typed",
    [
        "status", "status --help", "status a b", "status a --deu", "status a --due --due", "status a --js", "status ''",
        "status -h", "status -- a", "status --due=1 a", "simulate a --participants x", "simulate a --participants 0",
        "simulate a --participants", "simulate a --seed -1", "export csv a b --outcome goal", "play a --view full",
    ],
)  # fmt: skip
def test_what_is_not_plain_is_left_to_typer(typed):
    name, *words = [word.strip("'") for word in typed.split()]
    part = next(part for part, names in PARTS.items() if name in names)
    assert plain(command_of(part, name), words) is None


@pytest.mark.program
def test_a_plain_command_starts_without_typer(tmp_path):
    code = (
        "import sys; sys.argv[1:] = ['status', sys.argv[1]]\n"
        "from minihuman.cli import main\n"
        "try: main()\n"
        "finally: print(sorted({'typer', 'pydantic', 'rich', 'numpy'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, "-c", code, tmp_path], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


@pytest.mark.program
def test_who_reads_only_the_first_line_hears_no_complaint(tmp_path):
    code = (
        "import os, sys; sys.argv[1:] = ['worlds']\n"
        "read, write = os.pipe(); os.close(read); os.dup2(write, 1)\n"
        "from minihuman.cli import main\n"
        "main()"
    )
    done = subprocess.run([sys.executable, "-c", code], stderr=subprocess.PIPE, text=True, check=False)
    assert (done.returncode, done.stderr) == (1, "")
