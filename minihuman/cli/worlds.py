"""Commands about worlds: worlds."""

import typer

from minihuman.worlds.catalogue import ENTRIES


def add_to(app: typer.Typer) -> None:
    """Add these commands."""
    app.command()(worlds)


def worlds() -> None:
    """List every world of ours.

    Example: minihuman worlds
    """
    for entry in ENTRIES:
        print(f"{entry.id:60} {entry.summary}")
