"""Which episodes a command takes: the same options everywhere."""

import inspect
import sys
from collections.abc import Callable, Iterable
from functools import wraps
from typing import Annotated, Any

from minihuman.cli.declared import Option

_WORDS = {
    "outcome": "Only episodes that ended so: goal, timeout, failure; may be repeated.",
    "block": "Only this block; may be repeated.",
    "participant": "Only this participant; may be repeated.",
    "version": "Only sessions by this version of the protocol, or by the start of its SHA-256; may be repeated.",
    "only": "Only episodes marked with this tag; may be repeated.",
    "without": "Leave out episodes marked with this tag, as those marked exclude are; may be repeated.",
    "with_": "Count what is left out by default: exclude (so marked), unfinished, rules (the protocol's exclusions).",
}


def choosing(**defaults: tuple[str, ...]) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Give a command the options that choose episodes; it gets them as ``selection``, its last parameter.

    ``defaults`` are what an option is where it is not given.
    """

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        @wraps(command)
        def chosen(*arguments: Any, **named: Any) -> None:
            from minihuman.data.selection import Selection

            given = {name: tuple(named.pop(name) or ()) or defaults.get(name, ()) for name in _WORDS}
            command(*arguments, **named, selection=Selection(**given))

        own = inspect.signature(command)
        options = {name: Annotated[list[str] | None, _option(name)] for name in _WORDS}
        parameters = [one for one in own.parameters.values() if one.name != "selection"]
        parameters += [
            inspect.Parameter(name, inspect.Parameter.POSITIONAL_OR_KEYWORD, default=None, annotation=kind)
            for name, kind in options.items()
        ]
        kept = {name: kind for name, kind in inspect.get_annotations(command).items() if name != "selection"}
        chosen.__signature__ = own.replace(parameters=parameters)  # type: ignore[attr-defined] # what Typer reads
        chosen.__annotations__ = kept | options
        return chosen

    return decorate


def _option(name: str) -> Any:
    return Option(f"--{name.rstrip('_')}", help=_WORDS[name], panel="Which episodes")


def say(lines: Iterable[str]) -> None:
    """Print what an output is made of, and what was left out and why, apart from what it prints itself."""
    for line in lines:
        print(line, file=sys.stderr, flush=True)
