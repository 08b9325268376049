"""Commands that run sessions: demo, run, simulate, play, check, status, doctor."""

import typer


def add_to(app: typer.Typer) -> None:
    """Add these commands."""
