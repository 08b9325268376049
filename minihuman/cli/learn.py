"""Commands that train agents (extra `learn`): learn transfer, learn clone."""

import typer


def add_to(app: typer.Typer) -> None:
    """Add these commands."""
