"""Commands that show data: replay, plot, report, mark."""

import typer


def add_to(app: typer.Typer) -> None:
    """Add these commands."""
