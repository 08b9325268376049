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
_REPLAY_VIEWER = "rerun-sdk"
_INTERRUPTED = 130  # the exit status that shells use after Ctrl-C
_COLOURS = re.compile(r"\x1b\[[0-9;]*m")  # a terminal's colour codes, which Gymnasium puts into its warnings


def main() -> None:
    """Run the command line; an error that the user can correct is printed as one line, with exit status 2."""
    warnings.formatwarning = _format_warning
    os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")  # Arrow's pool keeps freed memory: 27 MiB
    sys.exit(_flush_output(_run()))


def _format_warning(
    message: Warning | str, category: type[Warning], filename: str, lineno: int, line: str | None = None
) -> str:
    """Format a warning as one line, without its place in the code and without colours."""
    return f"Warning: {escape_control_characters(_COLOURS.sub('', str(message)))}\n"


def _flush_output(code: int) -> int:
    """Flush the standard output at the end of a command, and return the exit status of the program.

    Args:
        code: the exit status of the command.

    Returns:
        ``code`` or, if the output cannot be written: 1 in place of 0 if its reader has closed it, and otherwise 2.
    """
    try:
        sys.stdout.flush()
    except OSError as error:
        # discard the remaining output, so that the interpreter, which flushes again at its end, does not fail, too
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if isinstance(error, BrokenPipeError):  # the reader has closed the pipe
            return code or 1
        if code != MinihumanError.exit_code:  # otherwise an error was printed already
            return _report_os_error(error)
    return code


def _run() -> int:
    """Run the command that the program's arguments name; print its errors, and return its exit status."""
    try:
        return _convert_exit_code(make_command_line().main(prog_name="minihuman", standalone_mode=False))
    except SystemExit as ended:
        return _convert_exit_code(ended.code)
    except MinihumanError as error:
        return _report_mistakes(error)
    except click.UsageError as error:
        return _report_usage_error(error)
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
        quoted = " ".join(f"'{requirement}'" for requirement in requirements)
        _print_error(f"this command needs {requirements[0]}, which is not installed here; run: pip install {quoted}")
        return MinihumanError.exit_code
    except BrokenPipeError:  # the reader has closed the pipe
        return 1
    except OSError as error:
        return _report_os_error(error)


def _convert_exit_code(code: object) -> int:
    """Return the exit status for a command's return value or the code of its ``SystemExit``; 0 if it is no number."""
    if isinstance(code, int):
        return code
    return 0


def _report_mistakes(error: MinihumanError) -> int:
    """Print each mistake that an error lists, or its message if it lists none; return its exit status."""
    for line in getattr(error, "mistakes", ()) or (str(error),):
        _print_error(line)
    return error.exit_code


def _report_usage_error(error: click.UsageError) -> int:
    """Print an error in the arguments as one line that names the command's help, if known; return its exit status."""
    message = " ".join(error.format_message().split()).removesuffix(".")
    if error.ctx is not None:
        message += f" (see {error.ctx.command_path} --help)"
    _print_error(message)
    return error.exit_code


def _report_os_error(error: OSError) -> int:
    """Print an error of the operating system with the file that it names; return the exit status."""
    message = f"{error.strerror or error}"
    if error.filename is not None:
        message = f"{error.filename}: {message}"
    _print_error(message)
    return MinihumanError.exit_code


def find_missing_requirements(module: str) -> list[str]:
    """Return the requirement of this package that provides a module, then the other missing requirements of its extra.

    The base requirements are treated like an extra, except for the replay viewer, which is larger than all others
    together. If several provide the module, the base requirements are used or, if they do not provide it, the extra
    with the fewest missing requirements. The list is empty if no requirement provides the module.
    """
    package = module.partition(".")[0]
    distribution = _DISTRIBUTIONS.get(package, package).lower()
    provider_by_extra: dict[str, str] = {}  # the requirement of the module's distribution; "" is no extra
    missing_by_extra: defaultdict[str, list[str]] = defaultdict(list)
    for line in requires(DISTRIBUTION) or ():
        requirement, _, marker = line.partition(";")
        extra = marker.partition("extra ==")[2].strip(" '\"")
        required = _parse_distribution(requirement)
        # a requirement for certain platforms only may be missing here
        is_optional = (not extra and required == _REPLAY_VIEWER) or "sys_platform" in marker
        if required == distribution:
            provider_by_extra[extra] = requirement.strip()
        elif distribution != "jinja2" and not is_optional and not _can_import(required):  # jinja2 needs no others
            missing_by_extra[extra].append(requirement.strip())
    if not provider_by_extra:
        return []
    smallest = min(provider_by_extra, key=lambda extra: (bool(extra), len(missing_by_extra[extra])))
    return [provider_by_extra[smallest], *missing_by_extra[smallest]]


def _parse_distribution(requirement: str) -> str:
    """Return the name of the distribution in a requirement, in lower case: ``pyarrow`` for ``pyarrow>=16``."""
    return re.split(r"[^\w.-]", requirement)[0].lower()


def _can_import(distribution: str) -> bool:
    """Return whether the module of a distribution is installed."""
    module = distribution.replace("-", "_")
    for module_name, distribution_name in _DISTRIBUTIONS.items():
        if distribution_name == distribution:
            module = module_name
    with suppress(ModuleNotFoundError):
        return find_spec(module) is not None
    return False


def _print_error(line: str) -> None:
    print(f"minihuman: {escape_line(line)}", file=sys.stderr)
