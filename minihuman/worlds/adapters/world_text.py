"""The observation of a grid world's agent in words, for language models, and drawn for people who get the same text.

The wording is the one that BabyAI-Text (Carta et al., 2023) introduced and BALROG (Paglieri et al., 2025) uses for
evaluation, composed here from the observation alone; ``tests/models/test_world_text.py`` compares it with BALROG's.

The format is theirs; the code is ours. BabyAI-Text: Copyright (c) 2023 Flowers Team, MIT licence
(github.com/flowersteam/Grounding_LLMs_with_online_RL); BALROG's copy of it: github.com/BartekCupial/Minigrid, Apache
License 2.0.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from minihuman.errors import WorldError
from minihuman.worlds.grid.layout import observation_to_text
from minihuman.worlds.grid.object_kinds import ObjectKind

_KINDS = ["unseen", "empty", "wall", "floor", "door", "key", "ball", "box", "goal", "lava", "agent"]
_COLOURS = ["red", "green", "blue", "purple", "yellow", "grey"]
_DOORS = ["open", "closed", "locked"]
_UNSEEN = 0
_EMPTY = 1
_WALL = 2
_DOOR = 4


_FONT = Path(__file__).parents[2] / "display" / "fonts" / "DejaVuSans.ttf"
_PAPER = (16, 16, 16)
_INK = (232, 232, 232)
_LINES = 18  # the least number of lines for which a picture has space
_FONT_SHARE = 0.78  # the size of the font, as a share of the height of a line


def describe_observation(observation: Any, kinds: Sequence[ObjectKind] = ()) -> str:
    """Return an observation of a grid world as a diagram and, after an empty line, as sentences.

    Raises:
        WorldError: if it is not a grid observation.
    """
    if isinstance(observation, Mapping):
        image = observation.get("image")
    else:
        image = None
    if not isinstance(image, np.ndarray) or image.ndim != 3 or image.shape[2] != 3:
        raise WorldError(
            "the world has no grid observation to describe in words; use another view, or modality = 'picture'"
        )
    lines = list(describe_view(image))
    return "\n".join([observation_to_text(image, kinds), "", *(lines or ["nothing in sight"])])


def draw_text(text: str, size_px: tuple[int, int]) -> NDArray[np.uint8]:
    """Return a picture uint8[H, W, 3] of a text of `describe_observation`, with the diagram's characters in columns."""
    diagram, _, sentences = text.partition("\n\n")
    rows = diagram.split("\n")
    lines = sentences.split("\n")
    width, height = size_px
    font = ImageFont.truetype(str(_FONT), 100, layout_engine=ImageFont.Layout.BASIC)
    longest = max(font.getlength(line) for line in lines) / 100  # in em
    line_px = min(height / max(_LINES, len(rows) + len(lines) + 3), 0.88 * width / longest / _FONT_SHARE)
    font = font.font_variant(size=max(6, int(_FONT_SHARE * line_px)))
    image = Image.new("RGB", (width, height), _PAPER)
    draw = ImageDraw.Draw(image)
    left = 0.06 * width
    top = line_px
    for number, row in enumerate(rows):
        for column, character in enumerate(row):
            at = left + (0.75 * column + 0.4) * line_px, top + number * line_px
            draw.text(at, character, _INK, font, anchor="ma")
    for number, line in enumerate(lines, len(rows) + 1):
        draw.text((left, top + number * line_px), line, _INK, font)
    return np.asarray(image)


def describe_view(image: NDArray[np.integer[Any]]) -> Iterator[str]:
    """Yield a line for each wall ahead or at the sides and for each visible object, as in BALROG's BabyAI prompts.

    Args:
        image: an array int[columns, rows, 3] with the kind, colour and state of each cell. The agent is at the middle
            of the bottom row and looks up; its cell contains the object that it carries
    """
    kinds = image[..., 0]
    columns, rows = kinds.shape
    x = columns // 2
    y = rows - 1
    if kinds[x, y] not in (_UNSEEN, _EMPTY):
        yield f"You carry a {_name_cell(image[x, y])}"
    sight = {"forward": kinds[x, :y][::-1], "left": kinds[:x, y][::-1], "right": kinds[x + 1 :, y]}
    for direction, line in sight.items():
        blocked = np.flatnonzero(line > _EMPTY)
        if len(blocked) and line[blocked[0]] == _WALL:
            yield f"a wall {_steps(int(blocked[0]) + 1, direction)}"
    for column, row in np.argwhere(kinds > _WALL).tolist():
        if (column, row) == (x, y):
            continue
        steps = []
        if column != x:
            steps.append(_steps(abs(column - x), "right" if column > x else "left"))
        if row != y:
            steps.append(_steps(y - row, "forward"))
        way = " and ".join(steps)
        yield f"a {_name_cell(image[column, row])} {way}"


def _name_cell(cell: NDArray[np.integer[Any]]) -> str:
    """Return a cell's colour and kind in words, and a door's state."""
    kind, colour, state = map(int, cell)
    kind_name = f"thing {kind}"
    if kind < len(_KINDS):
        kind_name = _KINDS[kind]
    colour_name = "colourless"
    if colour < len(_COLOURS):
        colour_name = _COLOURS[colour]
    name = f"{colour_name} {kind_name}"
    if kind == _DOOR:
        return f"{_DOORS[state]} {name}"
    return name


def _steps(count: int, direction: str) -> str:
    return f"{count} step{'s' if count > 1 else ''} {direction}"
