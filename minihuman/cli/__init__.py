"""The command line: parse, call, print. Exit status 0 is done, 1 a check failed, 2 bad input or an error that the user
can put right.
"""

import os
import re
import sys
import warnings
from importlib.metadata import requires

import click

from minihuman.cli.command_line import make_command_line
from minihuman.errors import MinihumanError, escape_control_characters, escape_line

_DISTRIBUTIONS = {"rerun": "rerun-sdk", "pygame": "pygame-ce", "PIL": "pillow", "fontTools": "fonttools"}  # by module
_INTERRUPTED = 130  # as shells say it of a program that Ctrl-C ended


def main() -> None:
    """Run the command line; what a user can put right (our errors, a file out of reach) is one line and exit 2."""
    warnings.formatwarning = _format_warning  # type: ignore[assignment] # the text alone is of use here
    try:
        code = make_command_line().main(prog_name="minihuman", standalone_mode=False)
        sys.stdout.flush()
        sys.exit(code if isinstance(code, int) else 0)
    except MinihumanError as error:
        for line in getattr(error, "mistakes", ()) or (str(error),):
            _complain(line)
        sys.exit(error.exit_code)
    except click.UsageError as error:
        _complain(_usage_line(error))
        sys.exit(error.exit_code)
    except click.Abort as error:  # also what Click makes of Ctrl-C
        sys.exit(_INTERRUPTED if isinstance(error.__cause__, KeyboardInterrupt) else 1)
    except KeyboardInterrupt:
        sys.exit(_INTERRUPTED)
    except ModuleNotFoundError as error:
        requirement = find_missing_requirement(error.name or "")
        if not requirement:
            raise
        _complain(f"this command needs {requirement}, which is not installed here; run: pip install '{requirement}'")
        sys.exit(MinihumanError.exit_code)
    except BrokenPipeError:  # the reader of our output has closed it; what is still to be written has nowhere to go
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(1)
    except OSError as error:
        named = "" if error.filename is None else f"{error.filename}: "
        _complain(f"{named}{error.strerror or error}")
        sys.exit(MinihumanError.exit_code)


def find_missing_requirement(module: str) -> str:
    """Find the requirement of this package that brings a module, extras included; "" if none does."""
    package = module.partition(".")[0]
    name = _DISTRIBUTIONS.get(package, package).lower()
    for line in requires("minihuman") or ():
        requirement = line.partition(";")[0].strip()
        if re.split(r"[^\w.-]", requirement)[0].lower() == name:
            return requirement
    return ""


def _usage_line(error: click.UsageError) -> str:
    said = " ".join(error.format_message().split()).removesuffix(".")
    return said if error.ctx is None else f"{said} (see {error.ctx.command_path} --help)"


def _format_warning(message: Warning | str, *_: object) -> str:
    return f"Warning: {escape_control_characters(str(message))}\n"


def _complain(line: str) -> None:
    print(f"minihuman: {escape_line(line)}", file=sys.stderr)
