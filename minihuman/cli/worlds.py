"""Commands about what there is: worlds, plugins."""

from typing import Annotated

import typer


def add_to(app: typer.Typer) -> None:
    """Add these commands."""
    app.command()(worlds)
    app.command()(plugins)


def worlds(json: Annotated[bool, typer.Option("--json", help="Print JSON instead of lines.")] = False) -> None:
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
