"""What names in an author's source stand for, and how constants are written in translated rules."""

import ast
import inspect
import textwrap
from collections.abc import Callable
from dataclasses import dataclass
from types import FunctionType
from typing import Any

import numpy as np

from minihuman.errors import WorldError
from minihuman.worlds import rng
from minihuman.worlds.colours import COLOURS
from minihuman.worlds.grid.core import cells, state
from minihuman.worlds.grid.core.cells import DOOR_STATES, KINDS
from minihuman.worlds.grid.object_kinds import Item, ObjectKind, ball, box, door, floor, goal, key, lava, wall


class TranslationError(WorldError):
    """An error for source that cannot be translated; it states the line and what to write instead."""


@dataclass(frozen=True, slots=True)
class Symbol:
    """The meaning of a name or an attribute while rules are translated.

    Args:
        kind: "self", "grid", "state", "rng", "row", "kinds", "colours", "states", "identities", "super" or "constant".
        value: the constant; of "super", the class after which methods are looked up.
    """

    kind: str
    value: Any = None


SELF = Symbol("self")
GRID = Symbol("grid")
CELL_PARTS = {
    "kinds": "({} & 15)",
    "colours": "(({} >> 4) & 7)",
    "states": "(({} >> 7) & 3)",
    "identities": "({} >> 9)",
}

_MAX_ARRAY_NUMBERS = 4096  # of an array that is written as a constant
ITEM_FUNCTIONS = (wall, floor, lava, goal, door, key, ball, box)
# by the id of a function of ours that rules may call, its translation, with the arguments' places
CODE_FUNCTIONS: dict[int, str] = {
    id(cells.kind_of): "({0} & 15)",
    id(cells.colour_of): "(({0} >> 4) & 7)",
    id(cells.state_of): "(({0} >> 7) & 3)",
    id(cells.identity_of): "({0} >> 9)",
    id(cells.in_state): "({0} & -385 | {1} << 7)",
    id(cells.in_colour): "({0} & -113 | {1} << 4)",
    id(cells.ahead): "rt.ahead({0}, {1}, {2})",
    id(state.cell_at): "rt.code_at(c, {1}, {2})",
    id(state.put): "rt.put_code_checked(c, {place}, {1}, {2}, {3})",
    id(state.lift): "rt.remove(c, {1}, {2})",
    id(state.move): "rt.move_to_cell(c, {place}, {1}, {2})",
    id(rng.integer): "rt.draw(c, {place}, {1}, {2})",
}


def format_constant(constant: Any, texts: list[str], numbers_of_kinds: Callable[[Item], int]) -> str | None:
    """Return a constant as translated source, or None if rules cannot use it.

    Args:
        constant: the constant.
        texts: the program's texts, to which a new one is added; a text is written as a tuple of its number.
        numbers_of_kinds: a function that returns the number of an item's kind in the world.
    """
    if constant is None or isinstance(constant, bool | int | float | np.integer | np.floating):
        return _format_number(constant)
    if isinstance(constant, str):
        if constant not in texts:
            texts.append(constant)
        return f"({texts.index(constant)},)"
    if isinstance(constant, Item):
        return repr(item_numbers(constant, numbers_of_kinds))
    if isinstance(constant, np.ndarray) and constant.size <= _MAX_ARRAY_NUMBERS:
        return format_constant(constant.tolist(), texts, numbers_of_kinds)
    if isinstance(constant, tuple | list | frozenset | range):
        ordered = sorted(constant) if isinstance(constant, frozenset) else constant
        elements = [format_constant(element, texts, numbers_of_kinds) for element in ordered]
        if any(text is None for text in elements):
            return None
        return "(" + "".join(f"{text}, " for text in elements) + ")"
    return None


def _format_number(constant: Any) -> str | None:
    """Return a number, truth value or None as translated source; None for a number that is too large or not finite."""
    if constant is None or isinstance(constant, bool):
        return repr(constant)
    if isinstance(constant, int | np.integer):
        return f"({int(constant)})" if -(2**63) <= constant < 2**63 else None
    return f"({float(constant)!r})" if np.isfinite(constant) else None


def item_numbers(thing: Item, numbers_of_kinds: Callable[[Item], int]) -> tuple[int, ...]:
    """Return an item as eight numbers: kind, colour, state and whether it has an identity; likewise what it contains.

    Without contents, the last four are -1.
    """
    numbers = (
        numbers_of_kinds(thing),
        COLOURS.index(thing.colour),
        DOOR_STATES.index(thing.state),
        int(thing.has_identity),
    )
    if thing.contains is None:
        return (*numbers, -1, -1, -1, -1)
    return (*numbers, *item_numbers(thing.contains, numbers_of_kinds)[:4])


def number_kind(thing: Item, kinds: tuple[ObjectKind, ...]) -> int:
    """Return the number of an item's kind in a world whose own kinds are ``kinds``.

    Raises:
        WorldError: if the kind is none of the world's.
    """
    if thing.own is None:
        return KINDS.index(thing.kind)
    if thing.own not in kinds:
        raise WorldError(f"unknown kind {thing.kind!r}; add it to the world's kinds = (...)")
    return state.FIRST_OWN_KIND + kinds.index(thing.own)


@dataclass(frozen=True, slots=True)
class FunctionSource:
    """An author's function as a syntax tree.

    Args:
        node: its definition.
        path: the file.
        offset: what to add to the tree's line numbers.
    """

    node: ast.FunctionDef
    path: str
    offset: int


def read_function(function: FunctionType) -> FunctionSource:
    """Return the source of an author's function as a syntax tree.

    Raises:
        TranslationError: if there is no source, or it is no plain function.
    """
    path = function.__code__.co_filename
    try:
        lines, first = inspect.getsourcelines(function)
        tree = ast.parse(textwrap.dedent("".join(lines)))
    except (OSError, TypeError, SyntaxError) as error:
        raise TranslationError(
            f"{path}: the source of {function.__qualname__} cannot be read; write it in a file"
        ) from error
    node = tree.body[0]
    if not isinstance(node, ast.FunctionDef):
        raise TranslationError(f"{path}:{first}: {function.__qualname__} is no plain function; write it with def")
    return FunctionSource(node, path, first - 1)


def find_global(function: FunctionType, name: str) -> Any:
    """Return the object that a name refers to in a function that does not bind it: of a closure, module or built in.

    Raises:
        KeyError: if it refers to nothing.
    """
    free = function.__code__.co_freevars
    if name in free and function.__closure__ is not None:
        try:
            return function.__closure__[free.index(name)].cell_contents
        except ValueError as error:
            raise KeyError(name) from error
    if name in function.__globals__:
        return function.__globals__[name]
    builtins = function.__globals__["__builtins__"]
    return (builtins if isinstance(builtins, dict) else vars(builtins))[name]
