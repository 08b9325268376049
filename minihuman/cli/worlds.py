"""Commands about what there is: worlds, plugins."""

import typer

from minihuman.worlds.catalogue import ENTRIES


def add_to(app: typer.Typer) -> None:
    """Add these commands."""
    app.command()(worlds)
    app.command()(plugins)


def worlds() -> None:
    """List every world of ours.

    Example: minihuman worlds
    """
    for entry in ENTRIES:
        print(f"{entry.id:60} {entry.summary}")


def plugins() -> None:
    """List every player, window, exporter and other plug-in that is loaded by name, and the package it comes from.

    Example: minihuman plugins
    """
    from minihuman.plugins import plugins as installed

    for one in installed():
        print(f"{one.group:12} {one.name:14} {one.package:20} {one.where}")
