"""Pictures for cards: of a built-in world, and of what participants of a template see.

    python -m minihuman.builder.card_pictures TEMPLATE     # writes a PNG to standard output

A template with Python of its own is drawn in a process of its own, so that no other protocol meets its modules.
"""

import io
import json
import os
import subprocess
import sys
from contextlib import closing
from functools import cache

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from minihuman.builder.new_study import read_template
from minihuman.builder.shipped_studies import list_shipped_studies
from minihuman.display.drawing.screen import compose_screen
from minihuman.errors import MinihumanError
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.runtime.screenshots import render_screens
from minihuman.trust import TRUST_VARIABLE
from minihuman.worlds.adapters.world import World
from minihuman.worlds.catalogue import DRAWN_LEVEL, is_first_person
from minihuman.worlds.contract import View

THUMB_PX = (320, 180)
CELL_PX = 48  # a side of a level's cell
LEVEL_WORLD = DRAWN_LEVEL.id
AGENT_CELLS = (">>", "vv", "<<", "^^")
_LEAST_COLOURS = 12  # of a world's first picture; one with fewer shows a fixation cross or nothing
_PHASE = "playing"  # of the screens that show a stimulus
_PATIENCE_S = 120.0  # for a process that draws


def _encode_png(pixels: NDArray[np.uint8]) -> bytes:
    png = io.BytesIO()
    Image.fromarray(pixels).save(png, "PNG")
    return png.getvalue()


BLANK_PNG = _encode_png(np.full((THUMB_PX[1], THUMB_PX[0], 3), 96, np.uint8))


@cache
def draw_world(world_id: str, options: str = "{}", seed: int = 1) -> bytes:
    """Draw a world's first picture as a PNG; a blank one if it has none.

    Args:
        world_id: the world.
        options: its options as JSON.
        seed: of its layout.
    """
    try:
        with closing(World(world_id, json.loads(options))) as world:
            world.reset(seed)
            view: View = "partial" if is_first_person(world_id) else "full"
            return _encode_png(world.frame(view, THUMB_PX))
    except (MinihumanError, ValueError, TypeError):
        return BLANK_PNG


@cache
def draw_cell(cell: str) -> bytes:
    """Draw a cell of a level ("Ky", ">>") as a PNG; a blank one for characters that mean nothing."""
    agent = "WW" if cell in AGENT_CELLS else "^^"  # which looks away, as what it sees is lit
    diagram = f"{agent}WWWW\nWW{cell}WW\nWWWWWW"
    try:
        with closing(World(LEVEL_WORLD, {"diagram": diagram})) as world:
            world.reset(1)
            picture = world.frame("full", (3 * CELL_PX, 3 * CELL_PX))
    except (MinihumanError, ValueError):
        return BLANK_PNG
    middle = slice(CELL_PX, 2 * CELL_PX)
    return _encode_png(picture[middle, middle])


@cache
def draw_template(name: str) -> bytes:
    """Draw a picture of a template as a PNG: its first world, or the fullest stimulus; a blank one if none is drawn."""
    for study in list_shipped_studies():
        if study.name == name and study.modules:
            modules = ",".join(path.stem for path in study.modules)
            return _draw_elsewhere(name, {"PYTHONPATH": str(study.path.parent), TRUST_VARIABLE: modules})
    return _draw_here(name)


def _draw_here(name: str) -> bytes:
    """Draw a template whose modules this process can import."""
    try:
        protocol = read_template(name)
        plan = expand_protocol(protocol, enrol_participant(protocol, 0))
        first = plan.episodes[0]
        picture = draw_world(first.world, json.dumps(first.options), first.seed)
        if _count_colours(picture) >= _LEAST_COLOURS:
            return picture
        return _draw_fullest_screen(plan) or picture
    except (MinihumanError, OSError, IndexError):
        return BLANK_PNG


def _draw_elsewhere(name: str, environment: dict[str, str]) -> bytes:
    """Draw a template in a process with further variables in its environment."""
    search_path = os.pathsep.join(filter(None, (environment["PYTHONPATH"], os.environ.get("PYTHONPATH", ""))))
    try:
        process = subprocess.run(
            [sys.executable, "-m", "minihuman.builder.card_pictures", name],
            env={**os.environ, **environment, "PYTHONPATH": search_path},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            timeout=_PATIENCE_S,
            check=True,
        )
    except (subprocess.SubprocessError, OSError):
        return BLANK_PNG
    return process.stdout


def _draw_fullest_screen(plan: SessionPlan) -> bytes:
    """Draw the stimulus of a session that has the most to see; b"" if no screen shows one."""
    screens, _ = render_screens([plan], THUMB_PX)
    pictures = [compose_screen(screen, THUMB_PX) for phase, screen in screens if phase.endswith(_PHASE)]
    if not pictures:
        return b""
    return _encode_png(max(pictures, key=_count_drawn_pixels))


def _count_drawn_pixels(pixels: NDArray[np.uint8]) -> int:
    """Count the pixels that differ from the corner's."""
    return int((pixels != pixels[0, 0]).any(axis=-1).sum())


def _count_colours(png: bytes) -> int:
    colours = Image.open(io.BytesIO(png)).convert("RGB").getcolors(_LEAST_COLOURS)
    return _LEAST_COLOURS if colours is None else len(colours)


if __name__ == "__main__":
    sys.stdout.buffer.write(_draw_here(sys.argv[1]))
