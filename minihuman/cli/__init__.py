"""The command line. Functions of ten lines: parse, call, print. Exit 0 done, 1 a check failed, 2 bad input."""

import os
import sys
from collections.abc import Sequence
from importlib import import_module
from inspect import isfunction
from typing import TYPE_CHECKING

from minihuman.cli.plain import plain
from minihuman.errors import MinihumanError, printable

if TYPE_CHECKING:
    from typer import Typer

PARTS = {  # the commands of each module, so that asking for one loads no other; in the order of the help
    "authoring": ("new", "schema"),
    "session": ("run", "simulate", "check", "status"),
    "serve": ("serve",),
    "station": ("demo", "play", "doctor"),
    "worlds": ("worlds", "plugins"),
    "logs": ("info", "verify", "recover", "seal"),
    "see": ("replay", "plot", "mark", "report", "query"),
    "desk": ("watch", "withdraw", "replace", "bonus", "gather"),
    "power": ("power", "fit"),
    "export": ("export",),
    "learn": ("learn",),
}
_INTERRUPTED = 130  # as shells say it of a program that Ctrl-C ended


def app(command: str = "") -> "Typer":
    """Make the command line: with one part of it if that has the command asked for, else with all."""
    from typer import Typer

    from minihuman.cli.typed import about

    made = Typer(
        name="minihuman",
        no_args_is_help=True,
        context_settings={"help_option_names": ["-h", "--help"]},
        pretty_exceptions_enable=False,
    )
    made.callback()(about)
    for part in _parts(command) or PARTS:
        import_module(f"minihuman.cli.{part}").add_to(made)
    return made


def _parts(command: str) -> list[str]:
    return [part for part, commands in PARTS.items() if command in commands]


def _run(words: Sequence[str]) -> None:
    """Run what was typed: at once where it is plain, as importing Typer alone can take longer; else by Typer."""
    for part in _parts(words[0]) if words else ():
        command = getattr(import_module(f"minihuman.cli.{part}"), words[0])
        given = plain(command, words[1:]) if isfunction(command) else None
        if given is not None:
            command(**given)
            sys.stdout.flush()
            sys.exit(0)
    app(*words[:1])()


def main() -> None:
    """Run the command line; what a user can put right (our errors, a file out of reach) is one line and exit 2."""
    try:
        _run(sys.argv[1:])
    except MinihumanError as error:
        for line in getattr(error, "mistakes", ()) or (str(error),):
            _complain(line)
        sys.exit(error.exit_code)
    except KeyboardInterrupt:
        sys.exit(_INTERRUPTED)
    except BrokenPipeError:  # whoever read has read enough; what is still to be written has nowhere to go
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except OSError as error:
        named = "" if error.filename is None else f"{error.filename}: "
        _complain(f"{named}{error.strerror or error}")
        sys.exit(MinihumanError.exit_code)


def _complain(line: str) -> None:
    print(f"minihuman: {printable(line)}", file=sys.stderr)
