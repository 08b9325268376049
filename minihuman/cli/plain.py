"""A command's words read without Typer, where they are plain: whole names, values that need no second look.

Anything else (help, a word that is not known, a value that is wrong or missing, a choice) is left to Typer, which says
what there is to say. What is plain is read as Typer reads it.
"""

import inspect
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, get_args

from minihuman.cli.declared import Argument, Option

Parameters = dict[str, inspect.Parameter]
_DIGITS = 9  # a longer number is looked at twice


def plain(command: Callable[..., None], words: Sequence[str]) -> dict[str, Any] | None:
    """What to call the command with; None where its words are not plain, or have wildcards for Typer to expand."""
    if os.name == "nt":
        return None
    parameters: Parameters = dict(inspect.signature(command).parameters)
    names = {told: where for name in parameters for told, where in _names(parameters[name])}
    places = [name for name, one in parameters.items() if isinstance(_declared(one), Argument)]
    given: dict[str, Any] = {}
    rest = iter(words)
    for word in rest:
        if word in names:
            name, switched = names[word]
            value = switched if switched is not None else _value(parameters[name], next(rest, ""))
        elif places and not word.startswith("-"):
            name = places[0]
            value = _value(parameters[name], word)
            if isinstance(value, list):
                value = [*given.pop(name, ()), *value]
            else:
                places.pop(0)
        else:
            return None
        if value is None or name in given:
            return None
        given[name] = value
    for name, one in parameters.items():
        if given.setdefault(name, one.default) is inspect.Parameter.empty:
            return None
    return given


def _declared(parameter: inspect.Parameter) -> object:
    return get_args(parameter.annotation)[1]


def _names(parameter: inspect.Parameter) -> list[tuple[str, tuple[str, bool | None]]]:
    """The names of an option, each with what it switches it to, or None where a value follows."""
    declared = _declared(parameter)
    if not isinstance(declared, Option):
        return []
    own = parameter.name.replace("_", "-")
    if get_args(parameter.annotation)[0] not in (bool, bool | None):
        return [(name, (parameter.name, None)) for name in declared.names or (f"--{own}",)]
    found: list[tuple[str, tuple[str, bool | None]]] = []
    for names in declared.names or (f"--{own}/--no-{own}",):
        on, _, off = names.partition("/")
        found += [(name, (parameter.name, value)) for name, value in ((on, True), (off, False)) if name]
    return found


def _value(parameter: inspect.Parameter, word: str) -> Any:
    """The value of a word; None if Typer is to look at it."""
    if word == "" or word.startswith("-"):
        return None
    kind, declared = get_args(parameter.annotation)[:2]
    if kind in (Path, Path | None):
        return Path(word)
    if kind in (str, str | None):
        return word
    if kind == list[Path]:
        return [Path(word)]
    if kind in (int, int | None) and isinstance(declared, Option) and word.isascii() and word.isdecimal():
        least = declared.min if declared.min is not None else 0
        value = int(word) if len(word) <= _DIGITS else least - 1
        return value if least <= value and (declared.max is None or value <= declared.max) else None
    return None
