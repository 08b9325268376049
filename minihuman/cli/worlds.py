"""Commands about worlds: worlds."""

import typer


def add_to(app: typer.Typer) -> None:
    """Add these commands."""
