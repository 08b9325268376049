"""The command line. Functions of ten lines: parse, call, print. Exit 0 done, 1 a check failed, 2 bad input."""

import sys
from typing import Annotated

import typer

from minihuman.errors import MinihumanError, printable

app = typer.Typer(
    name="minihuman",
    no_args_is_help=True,
    context_settings={"help_option_names": ["-h", "--help"]},
    pretty_exceptions_enable=False,
)


def _say_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        print(f"minihuman {version('minihuman')}")
        raise typer.Exit


@app.callback()
def about(
    version: Annotated[
        bool, typer.Option("--version", help="Say which version this is.", is_eager=True, callback=_say_version)
    ] = False,
) -> None:
    """Run people and agents through grid and first-person worlds; keep every key, prove every log."""


def main() -> None:
    """Run the command line; what a user can put right (our errors, a file out of reach) is one line and exit 2."""
    from minihuman.cli import authoring, desk, export, learn, logs, power, see, session, station, worlds

    for part in (authoring, session, station, worlds, logs, see, desk, power, export, learn):
        part.add_to(app)
    try:
        app()
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
