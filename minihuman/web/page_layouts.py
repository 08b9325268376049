"""Describes to pages how grid worlds are laid out from seeds; `page/layouts.js` lays them out with compiled layouts.

What it needs to know of a world is the name of its layout with its numbers or its program, the header of its empty row,
and the words of its missions.
"""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from minihuman.errors import WorldError
from minihuman.worlds.colours import COLOURS
from minihuman.worlds.grid.babyai import encoding
from minihuman.worlds.grid.babyai.encoding import JOINS, VERBS
from minihuman.worlds.grid.babyai.language import PLACE_WORDS, After, Before, PutNext
from minihuman.worlds.grid.babyai.level_builder import LevelRecipe
from minihuman.worlds.grid.core.cells import KINDS
from minihuman.worlds.grid.core.state import HEADER
from minihuman.worlds.grid.engine import GridEngine
from minihuman.worlds.grid.layout import Recipe
from minihuman.worlds.grid.missions import MissionSpace
from minihuman.worlds.source_digest import layouts_digest

MANIFEST = Path(__file__).with_name("page") / "worlds" / "layouts.json"
_MOST_EXACT = 2**53  # a page reads larger whole numbers from text
_BLOCK = ("JOIN", "LEFT", "RIGHT", "CLAUSES", "CLAUSE", "VERB", "THING", "OTHER", "KIND", "COLOUR", "PLACE", "PLURAL")


def read_layout_modules() -> dict[str, Any]:
    """Return the manifest's entry for each compiled module of layouts, by name; it lists the files and the functions.

    Raises:
        WorldError: if the modules were compiled from other sources than the present ones.
    """
    manifest = json.loads(MANIFEST.read_text(encoding="utf-8"))
    if manifest["sources"] != layouts_digest():
        raise WorldError(f"{MANIFEST.name} is of other layouts than these; run: python -m kernel_build")
    modules: dict[str, Any] = manifest["modules"]
    return modules


def find_layout_module(env: GridEngine, modules: Mapping[str, Any]) -> str | None:
    """Return the name of the compiled module that has a world's layout; None if no module has it.

    Args:
        env: the world.
        modules: as `read_layout_modules` returns them.
    """
    recipe = getattr(env, "recipe", None)
    if not isinstance(recipe, Recipe):
        return None
    return next((name for name, module in modules.items() if _name_layout(recipe) in module["functions"]), None)


def _name_layout(recipe: Recipe) -> str:
    return f"layout_{recipe.layout.__name__}"


def describe_layout(env: Any) -> dict[str, Any]:
    """Return what a page needs to lay out a world from a seed, as JSON values.

    These are the layout's name, its numbers and its program, the header of the world's row, and the mission's words.

    Args:
        env: a grid world whose layout is in a compiled module (see `find_layout_module`), before its first reset.
    """
    recipe: Recipe = env.recipe
    program: list[list[int | str]] = []
    if isinstance(recipe, LevelRecipe):
        program = [[_encode_number(number) for number in line] for line in recipe.program.tolist()]
    mission = None
    if isinstance(recipe.mission, MissionSpace):
        mission = {"template": recipe.mission.template, "choices": recipe.mission.choices}
    header = env.state.row[:HEADER].tolist()
    layout = {"layout": _name_layout(recipe), "numbers": recipe.numbers, "program": program}
    return layout | {"header": header, "mission": mission}


def _encode_number(number: int) -> int | str:
    """Return a number as it is or, if a page's numbers cannot hold it exactly, as text."""
    if abs(number) > _MOST_EXACT:
        return str(number)
    return number


def describe_language() -> dict[str, Any]:
    """Return the positions of the parts of an encoded instruction, and the words for their codes."""
    verbs = [""] * (max(VERBS.values()) + 1)
    for clause, number in VERBS.items():
        verbs[number] = f"{clause.words} {{}}"
        if clause is PutNext:
            verbs[number] += " next to {}"
    joins = [""] * (max(JOINS.values()) + 1)
    for instruction, words in ((Before, ", then "), (After, " after you ")):
        joins[JOINS[instruction]] = words
    return {
        "places": {name: getattr(encoding, name) for name in _BLOCK},
        "verbs": verbs,
        "joins": joins,
        "colours": COLOURS,
        "kinds": KINDS,
        "sides": PLACE_WORDS,
    }
