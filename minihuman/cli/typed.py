"""What Typer is told of a command, from what the command says itself."""

import inspect
from collections.abc import Callable
from functools import wraps
from typing import Annotated, Any, get_args, get_origin

import typer

from minihuman.cli.declared import Argument, Option


def add(app: typer.Typer, *commands: Callable[..., None]) -> None:
    """Add commands to a command line."""
    for command in commands:
        app.command()(typed(command))


def typed(command: Callable[..., None]) -> Callable[..., None]:
    """Make what Typer can read of a command."""

    @wraps(command)
    def told(*arguments: Any, **named: Any) -> None:
        command(*arguments, **named)

    own = inspect.signature(command)
    parameters = [one.replace(annotation=_typed(one.annotation)) for one in own.parameters.values()]
    told.__signature__ = own.replace(parameters=parameters)  # type: ignore[attr-defined] # what Typer reads
    told.__annotations__ = {one.name: one.annotation for one in parameters} | {"return": None}
    return told


def _typed(annotation: Any) -> Any:
    if get_origin(annotation) is not Annotated:
        return annotation
    kind, declared = get_args(annotation)[:2]
    match declared:
        case Argument(help, metavar):
            return Annotated[kind, typer.Argument(help=help, metavar=metavar)]
        case Option(names, help, least, most, panel):
            return Annotated[kind, typer.Option(*names, help=help, min=least, max=most, rich_help_panel=panel)]
    return annotation


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
