"""Commands that run sessions: run, simulate, check, status."""

import typer


def add_to(app: typer.Typer) -> None:
    """Add these commands."""
