"""What a command takes, said once beside its parameters: Typer reads it, and so does `cli.plain`, without Typer.

Importing Typer, and what it checks types with, takes longer than many a command does.
"""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Argument:
    """A parameter that is told by its place."""

    help: str
    metavar: str | None = None


@dataclass(frozen=True, slots=True, init=False)
class Option:
    """A parameter that is told by a name: the names given, or the parameter's own."""

    names: tuple[str, ...]
    help: str
    min: int | None
    max: int | None
    panel: str | None  # in the help

    def __init__(
        self, *names: str, help: str, min: int | None = None, max: int | None = None, panel: str | None = None
    ) -> None:
        for name, value in (("names", names), ("help", help), ("min", min), ("max", max), ("panel", panel)):
            object.__setattr__(self, name, value)
