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
_MIN_LINES = 18  # for which a picture has space
_EMPTY_LINES = 3  # above the diagram, between diagram and sentences, and below
_FONT_SHARE = 0.78  # the size of the font, as a share of the height of a line
_MIN_FONT_PX = 6
_TEST_FONT_PX = 100  # in which the lengths of sentences are measured
_MARGIN_SHARE = 0.06  # of the picture's width, beside the text
_SENTENCE_SHARE = 0.88  # of the picture's width, for the longest sentence
_COLUMN_WIDTH = 0.75  # of the diagram, in heights of a line
_COLUMN_MIDDLE = 0.4  # of the diagram's first column, in heights of a line


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
    """Return a picture uint8[H, W, 3] of a text of `describe_observation`, with the diagram's characters in columns.

    The size ``size_px`` is (width, height).
    """
    diagram, _, sentences = text.partition("\n\n")
    rows = diagram.split("\n")
    lines = sentences.split("\n")
    width_px, height_px = size_px
    font = ImageFont.truetype(str(_FONT), _TEST_FONT_PX, layout_engine=ImageFont.Layout.BASIC)
    longest_em = max(font.getlength(line) for line in lines) / _TEST_FONT_PX
    n_lines = max(_MIN_LINES, len(rows) + len(lines) + _EMPTY_LINES)
    line_px = min(height_px / n_lines, _SENTENCE_SHARE * width_px / longest_em / _FONT_SHARE)
    font = font.font_variant(size=max(_MIN_FONT_PX, int(_FONT_SHARE * line_px)))
    image = Image.new("RGB", (width_px, height_px), _PAPER)
    draw = ImageDraw.Draw(image)
    margin_px = _MARGIN_SHARE * width_px
    top_px = line_px
    for number, row in enumerate(rows):
        for column, character in enumerate(row):
            x_px = margin_px + (_COLUMN_WIDTH * column + _COLUMN_MIDDLE) * line_px
            draw.text((x_px, top_px + number * line_px), character, _INK, font, anchor="ma")
    for number, line in enumerate(lines, len(rows) + 1):
        draw.text((margin_px, top_px + number * line_px), line, _INK, font)
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
    # the kinds of the cells in each direction, from the agent outwards
    sight = {"forward": kinds[x, :y][::-1], "left": kinds[:x, y][::-1], "right": kinds[x + 1 :, y]}
    for direction, cells in sight.items():
        blocked = np.flatnonzero(cells > _EMPTY)
        if len(blocked) and cells[blocked[0]] == _WALL:
            yield f"a wall {_format_steps(int(blocked[0]) + 1, direction)}"
    for column, row in np.argwhere(kinds > _WALL).tolist():
        if (column, row) == (x, y):
            continue
        steps = []
        if column != x:
            steps.append(_format_steps(abs(column - x), "right" if column > x else "left"))
        if row != y:
            steps.append(_format_steps(y - row, "forward"))
        directions = " and ".join(steps)
        yield f"a {_name_cell(image[column, row])} {directions}"


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


def _format_steps(count: int, direction: str) -> str:
    return f"{count} step{'s' if count > 1 else ''} {direction}"
