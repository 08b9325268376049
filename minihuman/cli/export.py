"""The command that writes other formats: export."""

import typer


def add_to(app: typer.Typer) -> None:
    """Add these commands."""
