"""The command line. Functions of ten lines: parse, call, print. Exit 0 done, 1 a check failed, 2 bad input."""

import sys
from importlib import import_module
from typing import Annotated

import typer

from minihuman.errors import MinihumanError, printable

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


def _say_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        print(f"minihuman {version('minihuman')}")
        raise typer.Exit


def about(
    version: Annotated[
        bool, typer.Option("--version", help="Say which version this is.", is_eager=True, callback=_say_version)
    ] = False,
) -> None:
    """Run people and agents through grid and first-person worlds; keep every key, prove every log."""


def app(command: str = "") -> typer.Typer:
    """Make the command line: with one part of it if that has the command asked for, else with all."""
    made = typer.Typer(
        name="minihuman",
        no_args_is_help=True,
        context_settings={"help_option_names": ["-h", "--help"]},
        pretty_exceptions_enable=False,
    )
    made.callback()(about)
    for part in [part for part, commands in PARTS.items() if command in commands] or PARTS:
        import_module(f"minihuman.cli.{part}").add_to(made)
    return made


def main() -> None:
    """Run the command line; what a user can put right (our errors, a file out of reach) is one line and exit 2."""
    try:
        app(*sys.argv[1:2])()
    except MinihumanError as error:
        for line in getattr(error, "mistakes", ()) or (str(error),):
            _complain(line)
        sys.exit(error.exit_code)
    except OSError as error:
        named = "" if error.filename is None else f"{error.filename}: "
        _complain(f"{named}{error.strerror or error}")
        sys.exit(MinihumanError.exit_code)


def _complain(line: str) -> None:
    print(f"minihuman: {printable(line)}", file=sys.stderr)
