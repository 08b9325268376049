"""Declare the arguments and options of commands, including those that several commands share, and show progress.

A command is a plain function whose annotations declare its parameters on the command line. `cli.command_line` turns it
into a Click command. This module imports nothing large.
"""

import inspect
import os
import shutil
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import Annotated, Any

import click

from minihuman.errors import escape_control_characters, escape_line
from minihuman.trust import Permission


@dataclass(frozen=True, slots=True)
class Argument:
    """A positional parameter of a command."""

    help: str
    metavar: str


@dataclass(frozen=True, slots=True, init=False)
class Option:
    """A named parameter of a command, called by its declared names or, without any, by the parameter's own name."""

    names: tuple[str, ...]
    help: str
    min: int | None
    max: int | None
    panel: str  # the heading above it in the help

    def __init__(
        self, *names: str, help: str, min: int | None = None, max: int | None = None, panel: str = "Options"
    ) -> None:
        fields = {"names": names, "help": help, "min": min, "max": max, "panel": panel}
        for name, setting in fields.items():
            object.__setattr__(self, name, setting)  # the class is frozen


StudyFolder = Annotated[Path, Argument("A study's folder, such as sessions/fourrooms-transfer.", "STUDY")]
StudyOrLog = Annotated[Path, Argument("A study's folder, or one log.", "STUDY")]
LogFile = Annotated[Path, Argument("A session's log, its live file or its folder.", "LOG")]
ProtocolFile = Annotated[Path, Argument("A protocol's TOML file.", "PROTOCOL")]
DataFolder = Annotated[Path, Option(help="The folder that contains the studies' folders.")]
ReasonOption = Annotated[
    str,
    Option(
        "--reason",
        help="The reason to record in the audit trail; if omitted in an interactive terminal, you are prompted for it.",
    ),
]
ExperimenterOption = Annotated[
    str, Option("--experimenter", help="The experimenter's code to record in the audit trail.")
]
TrustOption = Annotated[
    bool, Option("--trust", help="Trust the protocol's folder from now on, so that Python code in it may run.")
]
IsolationOption = Annotated[
    bool, Option("--isolate-worlds", help="Run worlds that are not minihuman's own in processes of their own.")
]
EngineOption = Annotated[
    str,
    Option(help="Where many logs are worked on: `local`, or `ray`, a Ray cluster (RAY_ADDRESS) that sees the files."),
]
JsonOption = Annotated[bool, Option("--json", help="Print JSON instead of plain text.")]

_SELECTION_HELP = {  # by parameter of ``Selection``
    "outcome": "Include only episodes with this outcome: goal, timeout, failure or ended; repeatable.",
    "block": "Include only episodes of this block; repeatable.",
    "participant": "Include only this participant's episodes; repeatable.",
    "version": "Include only episodes recorded with this protocol version, given as a version number or the first "
    "digits of the protocol's SHA-256; repeatable.",
    "only": "Include only episodes annotated with this tag; repeatable.",
    "without": "Exclude episodes annotated with this tag; repeatable. Episodes tagged `exclude` are excluded by "
    "default.",
    "with_": "Also include episodes excluded by default: `exclude` (tagged `exclude`), `unfinished`, `rules` "
    "(excluded by the protocol's rules) or `answer-rules` (by those on answers); repeatable.",
}

_CLEAR_LINE = "\r\033[K"  # moves a terminal's cursor to the start of the line, and clears the line


def selection_options(**defaults: tuple[str, ...]) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator that adds the options that select episodes to a command.

    The command receives them as its last parameter, a ``Selection`` named ``selection``.

    Args:
        defaults: the values of options that are not given on the command line; () for any not named here.
    """

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        @wraps(command)
        def run_with_selection(*arguments: Any, **named: Any) -> None:
            from minihuman.dataset.selection import Selection

            choices = {name: tuple(named.pop(name) or ()) or defaults.get(name, ()) for name in _SELECTION_HELP}
            command(*arguments, **named, selection=Selection(**choices))

        signature = inspect.signature(command)
        options = {name: Annotated[list[str] | None, _make_selection_option(name)] for name in _SELECTION_HELP}
        parameters = [parameter for parameter in signature.parameters.values() if parameter.name != "selection"]
        parameters += [
            inspect.Parameter(name, inspect.Parameter.POSITIONAL_OR_KEYWORD, default=None, annotation=kind)
            for name, kind in options.items()
        ]
        annotations = {name: kind for name, kind in inspect.get_annotations(command).items() if name != "selection"}
        new_signature = signature.replace(parameters=parameters)
        run_with_selection.__signature__ = new_signature  # type: ignore[attr-defined] # which ``make_command`` reads
        run_with_selection.__annotations__ = annotations | options
        return run_with_selection

    return decorate


def _make_selection_option(name: str) -> Option:
    return Option(f"--{name.rstrip('_')}", help=_SELECTION_HELP[name], panel="Selection of episodes")


def ask_reason(reason: str) -> str:
    """Return ``reason`` or, if it is empty and the standard input is a terminal, the user's answer to a prompt."""
    if reason or not sys.stdin.isatty():
        return reason
    return str(click.prompt("Reason"))


def has_display() -> bool:
    """Return whether programs started here can open windows, such as a browser's."""
    return sys.platform in ("win32", "darwin") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def ask_trust(trust: bool) -> Permission:
    """Return a permission to run a protocol's Python code: the option ``--trust``, or a function that asks the user.

    The user is asked only if the option is not given and the standard input is a terminal.
    """
    if trust or not sys.stdin.isatty():
        return trust
    return lambda question: bool(click.confirm(escape_line(question), default=False, err=True))


def print_json(value: object) -> None:
    """Print a value as one line of JSON; paths and dates become text, and NumPy numbers become numbers."""
    import msgspec

    def convert(foreign: Any) -> Any:
        return foreign.item() if hasattr(foreign, "item") else str(foreign)  # NumPy's scalars have ``item``

    print(msgspec.json.encode(value, enc_hook=convert).decode(), flush=True)


def print_result(output: object, describe: Callable[[], str], *, json: bool) -> None:
    """Print a command's output as JSON or, if not ``json``, as the text that ``describe`` returns."""
    if json:
        print_json(output)
    else:
        print(escape_control_characters(describe()))


def print_account(lines: Iterable[str]) -> None:
    """Print lines about an output, such as the sessions that it excludes, to standard error."""
    for line in lines:
        print_note(line)


def print_note(line: str) -> None:
    """Print a line to standard error, with its control characters escaped."""
    print(escape_line(line), file=sys.stderr, flush=True)


@contextmanager
def show_progress(words: str) -> Iterator[Callable[[str], None]]:
    """Show a progress line on a terminal until the context ends, and yield a function that changes the line.

    Control characters are escaped, and a line that is wider than the terminal is cut off. If standard error is not a
    terminal, nothing is shown.

    Args:
        words: the first line to show; "" to show nothing at first.
    """
    is_terminal = sys.stderr.isatty()

    def show(line: str) -> None:
        if is_terminal:
            width = shutil.get_terminal_size().columns - 1
            print(f"{_CLEAR_LINE}{escape_control_characters(line)[:width]}", end="", file=sys.stderr, flush=True)

    show(words)
    try:
        yield show
    finally:
        show("")
