"""Commands about logs: info, verify, recover."""

import typer


def add_to(app: typer.Typer) -> None:
    """Add these commands."""
