"""The command line. Functions of ten lines: parse, call, print. Exit 0 done, 1 a check failed, 2 bad input."""

import sys

import typer

from minihuman.errors import MinihumanError

app = typer.Typer(
    name="minihuman",
    help="Run people and agents through grid and first-person worlds; keep every key, prove every log.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


def main() -> None:
    """Run the command line; what a user can put right (our errors, a file out of reach) is one line and exit 2."""
    from minihuman.cli import desk, export, learn, logs, see, session, station, worlds

    for part in (session, station, worlds, logs, see, desk, export, learn):
        part.add_to(app)
    try:
        app()
    except MinihumanError as error:
        _complain(str(error))
        sys.exit(error.exit_code)
    except OSError as error:
        if error.filename is None:
            raise
        _complain(f"{error.filename}: {error.strerror}")
        sys.exit(MinihumanError.exit_code)


def _complain(line: str) -> None:
    print(f"minihuman: {line}", file=sys.stderr)
