"""Pictures for the cards of worlds and templates: a built-in world, and what participants of a template see.

    python -m minihuman.builder.card_pictures TEMPLATE     # writes a PNG to standard output

A template with Python files is drawn in another process, so that its modules are not imported for other protocols.
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
from minihuman.builder.shipped_studies import ShippedStudy, list_shipped_studies
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
_BLANK_GREY = 96
_LEAST_COLOURS = 12  # of a world's first picture; one with fewer shows a fixation cross or nothing
_STIMULUS_PHASE = "playing"  # the end of the phase's name on screens that show a stimulus
_DRAWING_TIMEOUT_S = 120.0  # of the other process


def _encode_png(pixels: NDArray[np.uint8]) -> bytes:
    png = io.BytesIO()
    Image.fromarray(pixels).save(png, "PNG")
    return png.getvalue()


BLANK_PNG = _encode_png(np.full((THUMB_PX[1], THUMB_PX[0], 3), _BLANK_GREY, np.uint8))


@cache
def draw_world(world_id: str, options: str = "{}", seed: int = 1) -> bytes:
    """Draw the picture of a world after its reset as a PNG; a blank one if the world cannot be created or drawn.

    Args:
        world_id: the id of the world.
        options: the world's options, as the text of a JSON object.
        seed: the seed of the world's layout.
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
    """Draw one cell of a level's diagram ("Ky", ">>") as a PNG; a blank one if its two characters mean nothing."""
    # a level needs one agent; it faces away from the cell, as the cells that it sees are drawn brighter
    corner = "WW" if cell in AGENT_CELLS else "^^"
    diagram = f"{corner}WWWW\nWW{cell}WW\nWWWWWW"
    try:
        with closing(World(LEVEL_WORLD, {"diagram": diagram})) as world:
            world.reset(1)
            picture = world.frame("full", (3 * CELL_PX, 3 * CELL_PX))
    except (MinihumanError, ValueError):
        return BLANK_PNG
    middle = slice(CELL_PX, 2 * CELL_PX)  # of the diagram's three cells
    return _encode_png(picture[middle, middle])


@cache
def draw_template(name: str) -> bytes:
    """Draw the picture for a template's card as a PNG; a blank one if the template cannot be drawn.

    The picture shows the world of the first participant's first episode after its reset. If that picture has few
    colours, it shows the stimulus screen of the session with the most pixels that differ from the background.
    """
    for study in list_shipped_studies():
        if study.name == name and study.modules:
            return _draw_in_other_process(study)
    return _draw_in_this_process(name)


def _draw_in_this_process(name: str) -> bytes:
    """Return the PNG for a template's card, drawn in this process; `BLANK_PNG` if the template cannot be drawn here.

    This process must be able to import the template's Python modules, if it has any.
    """
    try:
        protocol = read_template(name)
        plan = expand_protocol(protocol, enrol_participant(protocol, 0))
        episode = plan.episodes[0]
        picture = draw_world(episode.world, json.dumps(episode.options), episode.seed)
        if _count_colours(picture) >= _LEAST_COLOURS:
            return picture
        return _draw_fullest_screen(plan) or picture
    except (MinihumanError, OSError, IndexError):
        return BLANK_PNG


def _draw_in_other_process(study: ShippedStudy) -> bytes:
    """Return the PNG for a template with Python files, drawn in a process that can import and trusts these files.

    Return `BLANK_PNG` if the process fails or takes more than ``_DRAWING_TIMEOUT_S``.
    """
    search_path = os.pathsep.join(filter(None, (str(study.path.parent), os.environ.get("PYTHONPATH", ""))))
    modules = ",".join(path.stem for path in study.modules)
    try:
        process = subprocess.run(
            [sys.executable, "-m", "minihuman.builder.card_pictures", study.name],
            env={**os.environ, "PYTHONPATH": search_path, TRUST_VARIABLE: modules},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            timeout=_DRAWING_TIMEOUT_S,
            check=True,
        )
    except (subprocess.SubprocessError, OSError):
        return BLANK_PNG
    return process.stdout


def _draw_fullest_screen(plan: SessionPlan) -> bytes:
    """Return a PNG of the session's stimulus screen with the most pixels off the background; b"" if it has none."""
    screens, _ = render_screens([plan], THUMB_PX)
    pictures = [compose_screen(screen, THUMB_PX) for phase, screen in screens if phase.endswith(_STIMULUS_PHASE)]
    if not pictures:
        return b""
    return _encode_png(max(pictures, key=_count_drawn_pixels))


def _count_drawn_pixels(pixels: NDArray[np.uint8]) -> int:
    """Count the pixels whose colour differs from that of the top left corner, which is background."""
    return int((pixels != pixels[0, 0]).any(axis=-1).sum())


def _count_colours(png: bytes) -> int:
    """Count the colours of a PNG, up to ``_LEAST_COLOURS``, which is returned for any larger number, too."""
    colours = Image.open(io.BytesIO(png)).convert("RGB").getcolors(_LEAST_COLOURS)
    return _LEAST_COLOURS if colours is None else len(colours)


if __name__ == "__main__":
    sys.stdout.buffer.write(_draw_in_this_process(sys.argv[1]))
