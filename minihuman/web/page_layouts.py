"""Says for pages how grid worlds are laid out from seeds: `page/layouts.js` draws them with the compiled layouts.

What it needs to know of a world is the name of its layout with its numbers or its program, the header of its empty row,
and the words of its missions.
"""

import json
from collections.abc import Container
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


def read_layouts_module() -> dict[str, Any]:
    """Return what the manifest says of the module of layouts: its file, and its functions by name.

    Raises:
        WorldError: if it was compiled from other sources than these.
    """
    manifest = json.loads(MANIFEST.read_text(encoding="utf-8"))
    if manifest["sources"] != layouts_digest():
        raise WorldError(f"{MANIFEST.name} is of other layouts than these; run: python -m kernel_build")
    module: dict[str, Any] = manifest["modules"]["layouts"]
    return module


def describe_layout(env: GridEngine, layouts: Container[str]) -> dict[str, Any] | None:
    """Return how a page lays a world out; None if its layout is Python, or is not compiled for pages.

    Args:
        env: the world, before its first reset.
        layouts: the names of the layouts that pages have.
    """
    recipe = getattr(env, "recipe", None)
    if not isinstance(recipe, Recipe):
        return None
    name = f"layout_{recipe.layout.__name__}"
    if name not in layouts:
        return None
    program: list[list[int | str]] = []
    if isinstance(recipe, LevelRecipe):
        program = [[_write_exactly(number) for number in line] for line in recipe.program.tolist()]
    mission = None
    if isinstance(recipe.mission, MissionSpace):
        mission = {"template": recipe.mission.template, "choices": recipe.mission.choices}
    header = env.state.row[:HEADER].tolist()
    return {"layout": name, "numbers": recipe.numbers, "program": program, "header": header, "mission": mission}


def _write_exactly(number: int) -> int | str:
    if abs(number) > _MOST_EXACT:
        return str(number)
    return number


def describe_language() -> dict[str, Any]:
    """Return where in an instruction's block its parts are, and the words for their numbers."""
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
