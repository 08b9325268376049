"""The command line: parse the arguments, call the package, and print the result.

The exit status is 0 for success, 1 for a failed check, and 2 for invalid input or an error that the user can correct.
"""

import os
import re
import sys
import warnings
from collections import defaultdict
from contextlib import suppress
from importlib.metadata import requires
from importlib.util import find_spec

import click

from minihuman.cli.command_line import make_command_line
from minihuman.errors import MinihumanError, escape_control_characters, escape_line
from minihuman.plugins import DISTRIBUTION

_DISTRIBUTIONS = {  # by module, if their names differ
    "rerun": "rerun-sdk",
    "pygame": "pygame-ce",
    "PIL": "pillow",
    "bidi": "python-bidi",
    "freetype": "freetype-py",
    "google": "protobuf",
}
_INTERRUPTED = 130  # the exit status that shells use after Ctrl-C
_COLOURS = re.compile(r"\x1b\[[0-9;]*m")  # a terminal's colour codes, which Gymnasium puts into its warnings


def main() -> None:
    """Run the command line; an error that the user can correct is printed as one line, with exit status 2."""
    warnings.formatwarning = lambda message, *_: (  # without the place in the code
        f"Warning: {escape_control_characters(_COLOURS.sub('', str(message)))}\n"
    )
    os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")  # Arrow's pool keeps freed memory: 27 MiB
    code = _run()
    try:
        sys.stdout.flush()
    except OSError as error:  # discard the rest of the output, so that the interpreter's end does not raise, too
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if isinstance(error, BrokenPipeError):  # the reader has closed the pipe
            code = code or 1
        elif code != MinihumanError.exit_code:  # otherwise an error was printed already
            code = _refuse(error)
    sys.exit(code)


def _run() -> int:
    """Run a command and return its exit status."""
    try:
        return _exit_status(make_command_line().main(prog_name="minihuman", standalone_mode=False))
    except SystemExit as ended:
        return _exit_status(ended.code)
    except MinihumanError as error:
        return _refuse_mistakes(error)
    except click.UsageError as error:
        return _refuse_usage(error)
    except click.Abort as error:  # Click raises it after Ctrl-C, too
        if isinstance(error.__cause__, KeyboardInterrupt):
            return _INTERRUPTED
        return 1
    except KeyboardInterrupt:
        return _INTERRUPTED
    except ModuleNotFoundError as error:
        requirements = find_missing_requirements(error.name or "")
        if not requirements:
            raise
        needed = " ".join(f"'{requirement}'" for requirement in requirements)
        _complain(f"this command needs {requirements[0]}, which is not installed here; run: pip install {needed}")
        return MinihumanError.exit_code
    except BrokenPipeError:  # the reader has closed the pipe
        return 1
    except OSError as error:
        return _refuse(error)


def _exit_status(code: object) -> int:
    """Return the exit status that a command requested; 0 if it requested none."""
    if isinstance(code, int):
        return code
    return 0


def _refuse_mistakes(error: MinihumanError) -> int:
    for line in getattr(error, "mistakes", ()) or (str(error),):
        _complain(line)
    return error.exit_code


def _refuse_usage(error: click.UsageError) -> int:
    message = " ".join(error.format_message().split()).removesuffix(".")
    if error.ctx is not None:
        message += f" (see {error.ctx.command_path} --help)"
    _complain(message)
    return error.exit_code


def _refuse(error: OSError) -> int:
    message = f"{error.strerror or error}"
    if error.filename is not None:
        message = f"{error.filename}: {message}"
    _complain(message)
    return MinihumanError.exit_code


def find_missing_requirements(module: str) -> list[str]:
    """Return the requirement of this package that provides a module, then the other missing requirements of its extra.

    The list is empty if no requirement provides the module. The base requirements are treated like an extra, except for
    the replay viewer, which is larger than all others together.
    """
    package = module.partition(".")[0]
    name = _DISTRIBUTIONS.get(package, package).lower()
    extras: defaultdict[str, list[str]] = defaultdict(list)
    for line in requires(DISTRIBUTION) or ():
        requirement, _, marker = line.partition(";")
        extra = marker.partition("extra ==")[2].strip(" '\"")
        required = _name_requirement(requirement)
        is_replay_viewer = not extra and required == "rerun-sdk"
        is_optional = is_replay_viewer or "sys_platform" in marker
        if required == name:
            extras[extra].insert(0, requirement.strip())
        elif name != "jinja2" and not is_optional and not _can_import(required):  # jinja2 needs no others
            extras[extra].append(requirement.strip())
    providing_extras = [extra for extra, missing in extras.items() if _name_requirement(missing[0]) == name]
    if not providing_extras:
        return []
    smallest = min(providing_extras, key=lambda extra: (bool(extra), len(extras[extra])))
    return extras[smallest]


def _name_requirement(requirement: str) -> str:
    return re.split(r"[^\w.-]", requirement)[0].lower()


def _can_import(distribution: str) -> bool:
    with suppress(ModuleNotFoundError):
        modules = [module for module, name in _DISTRIBUTIONS.items() if name == distribution]
        return find_spec(*modules or [distribution.replace("-", "_")]) is not None
    return False


def _complain(line: str) -> None:
    print(f"minihuman: {escape_line(line)}", file=sys.stderr)
