"""Commands for the machine in front of you: demo, play, doctor."""

import typer


def add_to(app: typer.Typer) -> None:
    """Add these commands."""
