"""The command line as one Click group: its commands, and how a declared function becomes a command.

The group's help is made from the table below, so that only the module of the requested command is imported.
"""

import inspect
from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from keyword import iskeyword
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import click

from minihuman import __version__
from minihuman.cli.options import Argument, Option

SECTIONS: Mapping[str, Mapping[str, str]] = {  # by module of this package: its commands, in the help's order
    "start": {
        "demo": "Play a short session, then look at its log, figures and replay.",
        "new": "Write a ready-to-run protocol after a few questions.",
        "check": "Check a protocol and its worlds, and print a session plan.",
        "doctor": "Check whether this machine can run sessions with participants.",
        "play": "Play a world by hand; nothing is recorded.",
        "worlds": "List the built-in worlds.",
    },
    "run": {
        "run": "Run a participant's session, or resume one.",
        "serve": "Serve a study to participants in a browser.",
        "simulate": "Run a study with simulated participants.",
        "watch": "Watch running sessions on a local web page.",
        "desk": "Run studies from a start page in a browser on this machine.",
        "deploy": "Write the files needed to deploy a study on a server.",
    },
    "look": {
        "status": "Print the progress of a study's sessions.",
        "info": "Describe a session's log.",
        "replay": "Replay sessions in the Rerun viewer.",
        "film": "Write a film of a session's episodes, or a contact sheet.",
        "plot": "Draw figures of a session or a study.",
        "report": "Write a study's report: tables, statistics and figures.",
        "query": "Query a study's tables with SQL.",
        "bots": "Weigh whether a person or a program pressed the keys.",
    },
    "keep": {
        "verify": "Replay logs from their seeds and inputs; report any difference.",
        "recover": "Complete interrupted logs and repair damaged ones.",
        "annotate": "Annotate an episode or a session.",
        "manifest": "Write a study's manifest and print its digest.",
        "withdraw": "Withdraw a participant and free their slot.",
        "replace": "Free the slot of a participant who dropped out; keep their data.",
        "import": "Import episodes that a web page recorded without a server.",
        "gather": "Synchronize a study's logs and tables with the remote stores.",
    },
    "publish": {
        "export": "Export a study as tables, demonstrations or an archive.",
        "publish": "Write the folder that an archive takes, ready to upload.",
        "power": "Estimate the power of a study by simulation.",
        "fit": "Fit simulated participants' reaction times to logged ones.",
        "score": "Score people, policies and models on the same levels.",
        "payments": "Print the payment for each session as CSV.",
        "pack": "Pack worlds for web pages that run without a server.",
        "site": "Write a static folder that runs a study on any web host.",
    },
    "agents": {
        "learn": "Train agents, on people's data or without.",
        "bench": "Make benchmark sets of levels and score players on them.",
    },
    "machine": {
        "plugins": "List the installed plug-ins.",
        "schema": "Print the JSON Schema for protocol files.",
    },
}
ALIASES = {"mark": "annotate", "seal": "manifest", "bonus": "payments"}  # earlier names, which work but are not listed
_MODULES = {name: module for module, names in SECTIONS.items() for name in names}
_NO_COMMAND_STATUS = 2  # the exit status if no command is given
_HELP_NAMES = {"help_option_names": ["-h", "--help"]}


class _Group(click.Group):
    """A group that prints its help if no command is given, with the exit status of an error."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        if not args and not ctx.resilient_parsing:
            click.echo(ctx.get_help(), err=True)
            ctx.exit(_NO_COMMAND_STATUS)
        return super().parse_args(ctx, args)


class CommandLine(_Group):
    """The group of all commands; a command's module is imported when that command is requested."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of the commands in the order of the help."""
        return list(_MODULES)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import and return a command by its current or earlier name; None if there is no such command."""
        name = ALIASES.get(cmd_name, cmd_name)
        if name not in _MODULES:
            return None
        function_name = name
        if iskeyword(name):
            function_name = f"{name}_"
        command = getattr(import_module(f"minihuman.cli.{_MODULES[name]}"), function_name)
        if isinstance(command, click.Command):
            return command
        return make_command(command)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the commands and their help by section to the formatter, without importing any command."""
        widest = max(map(len, _MODULES))  # aligns the help texts of all sections
        for section, helps in SECTIONS.items():
            with formatter.section(section.capitalize()):
                formatter.write_dl([(name.ljust(widest), help) for name, help in helps.items()])


def make_command_line() -> CommandLine:
    """Create the group of all commands."""
    group = CommandLine(
        "minihuman",
        help="Run experiments with people and agents in grid and first-person worlds; record every key press and "
        "verify every log.",
        context_settings=_HELP_NAMES,
    )
    texts = {"message": "%(prog)s %(version)s", "help": "Print the version and exit."}
    return click.version_option(__version__, prog_name="minihuman", **texts)(group)


class Subgroup(_Group):
    """A command with subcommands, which its help lists in the given order.

    Args:
        name: the command's name.
        help: the command's help text.
        commands: the functions that become the subcommands, as with ``make_command``.
    """

    def __init__(self, name: str, help: str, commands: Sequence[Callable[..., None]]) -> None:
        commands_by_name = {command.__name__: make_command(command) for command in commands}
        super().__init__(name, commands_by_name, help=help, context_settings=_HELP_NAMES)

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names of the subcommands in the order of the help."""
        return list(self.commands)


def make_command(function: Callable[..., None]) -> click.Command:
    """Convert a function whose parameters are annotated with `Argument` or `Option` into a command of its name."""
    parameters = inspect.signature(function).parameters.values()
    list_names = {parameter.name for parameter in parameters if _is_list(get_args(parameter.annotation)[0])}

    def call(**arguments: Any) -> None:
        for name in list_names & arguments.keys():
            arguments[name] = list(arguments[name])  # Click passes a tuple
        function(**arguments)

    return _Command(
        function.__name__.removesuffix("_"),
        callback=call,
        params=[_make_parameter(parameter) for parameter in parameters],
        help=_protect_examples(inspect.getdoc(function) or ""),
        context_settings=_HELP_NAMES,
    )


class _Argument(click.Argument):
    """An argument with a help text, which Click's own lacks."""

    def __init__(self, name: str, declared: Argument, **settings: Any) -> None:
        metavar = declared.metavar
        if not settings["required"]:
            metavar = f"[{metavar}]"
        super().__init__([name], metavar=metavar, **settings)
        self.text = declared.help

    def get_help_record(self, ctx: click.Context) -> tuple[str, str]:
        return self.human_readable_name, self.text


class _Option(click.Option):
    """An option with the heading under which the help lists it."""

    def __init__(self, names: Sequence[str], declared: Option, **settings: Any) -> None:
        super().__init__(names, help=declared.help, **settings)
        self.panel = declared.panel


class _Command(click.Command):
    """A command whose help lists its arguments, and its options under their headings."""

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        panels: dict[str, list[tuple[str, str]]] = {"Arguments": [], "Options": []}
        for parameter in self.get_params(ctx):
            if isinstance(parameter, click.Argument):
                heading = "Arguments"
            else:
                heading = getattr(parameter, "panel", "Options")
            record = parameter.get_help_record(ctx)
            if record is not None:
                panels.setdefault(heading, []).append(record)
        for heading, records in panels.items():
            if records:
                with formatter.section(heading):
                    formatter.write_dl(records)


def _make_parameter(parameter: inspect.Parameter) -> click.Parameter:
    """Convert an annotated parameter of a function into an argument or an option of its command."""
    annotation, declared = get_args(parameter.annotation)[:2]
    kind = _get_bare_type(annotation)
    many = _is_list(annotation)
    default = None
    settings: dict[str, Any] = {"required": parameter.default is inspect.Parameter.empty}
    if not settings["required"]:
        default = parameter.default
        settings["default"] = default
    if isinstance(declared, Argument):
        settings["type"] = _choose_click_type(kind, declared)
        return _Argument(parameter.name, declared, nargs=-1 if many else 1, **settings)
    assert isinstance(declared, Option)
    names = _list_option_names(parameter.name, declared, is_flag=kind is bool)
    if kind is bool:
        settings["is_flag"] = True
        show_default = any("/" in name for name in names) and default is not None
    else:
        settings["type"] = _choose_click_type(kind, declared)
        settings["multiple"] = many
        show_default = default not in (None, "")
    return _Option([*names, parameter.name], declared, show_default=show_default, **settings)


def _list_option_names(parameter_name: str, declared: Option, *, is_flag: bool) -> list[str]:
    """Return an option's names on the command line: the declared ones or, without any, one made of its parameter's.

    The name of a flag then contains that of its negation, as in ``--web/--no-web``.
    """
    if declared.names:
        return list(declared.names)
    dashed_name = parameter_name.replace("_", "-")
    if is_flag:
        return [f"--{dashed_name}/--no-{dashed_name}"]
    return [f"--{dashed_name}"]


def _get_bare_type(annotation: Any) -> Any:
    """Return the type of a single value of an annotation, e.g. int for ``int | None`` and Path for ``list[Path]``."""
    inner_types = [part for part in get_args(annotation) if part is not type(None)]
    if inner_types and get_origin(annotation) is not Literal:
        return _get_bare_type(inner_types[0])
    return annotation


def _is_list(annotation: Any) -> bool:
    """Return whether an annotation is of the form ``list[...]`` or ``list[...] | None``."""
    return str(annotation).startswith("list[")


def _choose_click_type(kind: Any, declared: Argument | Option) -> Any:  # a ParamType, generic only in newer Clicks
    """Return Click's type for an argument or option whose single values have the type ``kind``."""
    if get_origin(kind) is Literal:
        return click.Choice(get_args(kind))
    if kind is Path:
        return click.Path(path_type=Path)
    if kind is int and isinstance(declared, Option) and (declared.min is not None or declared.max is not None):
        return click.IntRange(declared.min, declared.max)
    return click.types.convert_type(kind)


def _protect_examples(text: str) -> str:
    """Mark the paragraphs of a help text that begin with "Example:", so that Click does not wrap them."""
    paragraphs = text.split("\n\n")
    for index, paragraph in enumerate(paragraphs):
        if paragraph.startswith("Example:"):
            paragraphs[index] = f"\b\n{paragraph}"  # Click's mark of text that is not wrapped
    return "\n\n".join(paragraphs)
