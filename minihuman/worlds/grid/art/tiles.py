"""Tiles: how each thing is drawn, at any size. Our own art: flat, soft-cornered, told apart by shape before colour."""

from collections.abc import Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

from minihuman.worlds.contract import Palette
from minihuman.worlds.grid.art.palettes import AGENT_COLOURS, GRID_LINE, RGB, UNSEEN, colour_rgb
from minihuman.worlds.grid.art.palettes import FLOOR as FLOOR_COLOUR
from minihuman.worlds.grid.art.palettes import WALL as WALL_COLOUR
from minihuman.worlds.grid.art.shapes import Canvas, Plane
from minihuman.worlds.grid.core.cells import (
    BALL,
    BOX,
    DOOR,
    DOOR_STATES,
    EMPTY,
    FLOOR,
    GOAL,
    KEY,
    LAVA,
    LOCKED,
    OPEN,
    WALL,
    kind_of,
    state_of,
)
from minihuman.worlds.grid.core.own import OWN

if TYPE_CHECKING:
    from minihuman.worlds.grid.kinds import Kind

Colour = tuple[float, float, float]


def shade(colour: RGB, amount: float) -> Colour:
    """A colour made lighter (above 0) or darker (below 0); -1 is black, 1 is white."""
    target = 255 if amount > 0 else 0
    red, green, blue = (part + (target - part) * abs(amount) for part in colour)
    return red, green, blue


def tile(code: int, size_px: int, palette: Palette, kinds: "Sequence[Kind]" = ()) -> Canvas:
    """A cell with what lies in it, opaque."""
    canvas = Canvas(size_px)
    kind = kind_of(code)
    colour = colour_rgb(code, palette)
    if kind == WALL:
        _wall(canvas, colour)
        return canvas
    if kind == LAVA:
        _lava(canvas, colour)
        return canvas
    canvas.fill(canvas.everywhere(), GRID_LINE)
    line = max(0.5 / size_px, 0.012)
    canvas.fill(canvas.box(line, line, 1 - line, 1 - line), FLOOR_COLOUR)
    if kind == FLOOR:
        canvas.fill(canvas.box(line, line, 1 - line, 1 - line), shade(colour, -0.55))
    elif kind != EMPTY:
        paint(canvas, code, palette, kinds)
    return canvas


def unseen(size_px: int) -> Canvas:
    """A cell the agent cannot see."""
    canvas = Canvas(size_px)
    canvas.fill(canvas.everywhere(), UNSEEN)
    return canvas


def in_hand(code: int, size_px: int, palette: Palette, kinds: "Sequence[Kind]" = ()) -> Canvas:
    """A carried object on a dark plate, the corners transparent."""
    canvas = Canvas(size_px)
    canvas.fill(canvas.disc(0.5, 0.5, 0.5), UNSEEN, opacity=0.85)
    paint(canvas, code, palette, kinds)
    return canvas


def agent(direction: int, size_px: int, palette: Palette) -> Canvas:
    """The agent, an arrowhead, its surroundings transparent; 0 right, 1 down, 2 left, 3 up."""
    canvas = Canvas(size_px)
    for _ in range(direction):
        canvas.u, canvas.v = canvas.v, 1 - canvas.u
    colour = AGENT_COLOURS[palette]
    corners = ((0.22, 0.24), (0.80, 0.50), (0.22, 0.76), (0.34, 0.50))
    canvas.fill(canvas.polygon(*corners, rounding=0.085), shade(colour, -0.75))
    canvas.fill(canvas.polygon(*corners, rounding=0.045), colour)
    return canvas


def paint(canvas: Canvas, code: int, palette: Palette, kinds: "Sequence[Kind]" = ()) -> None:
    """Paint an object on a canvas."""
    colour = colour_rgb(code, palette)
    match kind_of(code):
        case k if k >= OWN:
            kinds[k - OWN].draw(canvas, colour, DOOR_STATES[state_of(code)])
        case k if k == GOAL:
            canvas.fill(canvas.box(0.04, 0.04, 0.96, 0.96, 0.08), shade(colour, -0.25))
            canvas.fill(canvas.box(0.12, 0.12, 0.88, 0.88, 0.06), colour)
            canvas.fill(canvas.box(0.30, 0.30, 0.70, 0.70, 0.06), shade(colour, 0.45))
        case k if k == DOOR:
            _door(canvas, colour, state_of(code))
        case k if k == KEY:
            _key(canvas, colour)
        case k if k == BALL:
            canvas.fill(canvas.disc(0.5, 0.5, 0.32), shade(colour, -0.35))
            canvas.fill(canvas.disc(0.49, 0.485, 0.285), colour)
            canvas.fill(canvas.disc(0.40, 0.38, 0.075), shade(colour, 0.6))
        case k if k == BOX:
            canvas.fill(canvas.box(0.15, 0.17, 0.85, 0.85, 0.06), shade(colour, -0.35))
            canvas.fill(canvas.box(0.20, 0.44, 0.80, 0.80, 0.03), colour)
            canvas.fill(canvas.box(0.20, 0.22, 0.80, 0.38, 0.03), shade(colour, 0.25))
            canvas.fill(canvas.box(0.43, 0.34, 0.57, 0.54, 0.03), shade(colour, -0.6))


def _wall(canvas: Canvas, colour: RGB) -> None:
    # a coloured wall is the plain one with a hint of its colour; grey is the plain one
    red, green, blue = (
        (3 * a + b) / 4 if colour[0] != colour[2] else a for a, b in zip(WALL_COLOUR, colour, strict=True)
    )
    body = (int(red), int(green), int(blue))
    edge = max(1 / canvas.size_px, 0.05)
    canvas.fill(canvas.everywhere(), shade(body, -0.38))
    canvas.fill(canvas.box(-1, -1, 1 - edge, 1 - edge), shade(body, 0.18))
    canvas.fill(canvas.box(edge, edge, 1 - edge, 1 - edge), body)


def _lava(canvas: Canvas, colour: RGB) -> None:
    canvas.fill(canvas.everywhere(), colour)
    for v in (0.30, 0.55, 0.80):
        _wave(canvas, v, shade(colour, -0.45))
    for v in (0.24, 0.49, 0.74):
        _wave(canvas, v, shade(colour, 0.45))


def _wave(canvas: Canvas, v: float, colour: Colour) -> None:
    points = [(0.08 + 0.21 * i, v + (0.05 if i % 2 else -0.05)) for i in range(5)]
    for (u0, v0), (u1, v1) in pairwise(points):
        canvas.fill(canvas.bar(u0, v0, u1, v1, 0.022), colour)


def _door(canvas: Canvas, colour: RGB, state: int) -> None:
    dark = shade(colour, -0.62)
    if state == OPEN:
        canvas.fill(canvas.box(0.0, 0.0, 1.0, 0.10), dark)
        canvas.fill(canvas.box(0.0, 0.90, 1.0, 1.0), dark)
        canvas.fill(canvas.box(0.04, 0.04, 0.20, 0.96, 0.02), colour)
        return
    canvas.fill(canvas.box(0.0, 0.0, 1.0, 1.0), dark)
    canvas.fill(canvas.box(0.09, 0.09, 0.91, 0.91, 0.04), colour)
    if state == LOCKED:
        canvas.fill(canvas.box(0.17, 0.17, 0.83, 0.83, 0.03), shade(colour, -0.45))
        canvas.fill(canvas.disc(0.5, 0.42, 0.11), shade(colour, 0.55))
        canvas.fill(canvas.polygon((0.46, 0.44), (0.54, 0.44), (0.59, 0.70), (0.41, 0.70)), shade(colour, 0.55))
    else:
        canvas.fill(canvas.box(0.18, 0.18, 0.82, 0.46, 0.03), shade(colour, -0.28))
        canvas.fill(canvas.box(0.18, 0.54, 0.82, 0.82, 0.03), shade(colour, -0.28))
        canvas.fill(canvas.disc(0.79, 0.50, 0.065), shade(colour, 0.7))


def _key(canvas: Canvas, colour: RGB) -> None:
    for grow, tint in ((0.035, shade(colour, -0.6)), (0.0, colour)):
        canvas.fill(_ring(canvas, 0.5, 0.29, 0.145, 0.055 + grow), tint)
        canvas.fill(canvas.bar(0.5, 0.44, 0.5, 0.82, 0.05 + grow), tint)
        canvas.fill(canvas.bar(0.5, 0.66, 0.655, 0.66, 0.042 + grow), tint)
        canvas.fill(canvas.bar(0.5, 0.80, 0.655, 0.80, 0.042 + grow), tint)


def _ring(canvas: Canvas, u: float, v: float, radius: float, thickness: float) -> Plane:
    return abs(canvas.disc(u, v, radius)) - thickness
