"""Commands about what there is: worlds, plugins."""

from typing import TYPE_CHECKING, Annotated

from minihuman.cli.declared import Option

if TYPE_CHECKING:
    from typer import Typer


def add_to(app: "Typer") -> None:
    """Add these commands."""
    from minihuman.cli.typed import add

    add(app, worlds, plugins)


def worlds(json: Annotated[bool, Option("--json", help="Print JSON instead of lines.")] = False) -> None:
    """List every world of ours.

    Example: minihuman worlds
    """
    import msgspec

    from minihuman.worlds.catalogue import ENTRIES

    if json:
        print(msgspec.json.encode([{"id": entry.id, "summary": entry.summary} for entry in ENTRIES]).decode())
        return
    for entry in ENTRIES:
        print(f"{entry.id:60} {entry.summary}")


def plugins() -> None:
    """List every player, window, exporter and other plug-in that is loaded by name, and the package it comes from.

    Example: minihuman plugins
    """
    from minihuman.plugins import plugins as installed

    for one in installed():
        print(f"{one.group:12} {one.name:14} {one.package:20} {one.where}")
