"""Stairs and ramps as sectors: a sector for each step, or one with a sloping floor."""

import math
from dataclasses import dataclass

from minihuman.errors import WorldError
from minihuman.worlds.first_person.heights.planes import Plane, slope_between
from minihuman.worlds.first_person.heights.sectors import Sector
from minihuman.worlds.first_person.rooms import WALL_HEIGHT, rectangle

Rectangle = tuple[float, float, float, float]  # min_x, max_x, min_z, max_z

STEP_M = 0.18  # the highest step of stairs whose number of steps is not given
_STEEPEST = 1.0  # the steepest ramp: a metre up for a metre ahead
_TOLERANCE = 1e-9  # by which rounding may exceed a limit, in steps or metres
_DIRECTIONS = {"east": (0, 1), "west": (0, -1), "south": (1, 1), "north": (1, -1)}  # axis x (0) or z (1), and sign


@dataclass(frozen=True, slots=True, kw_only=True)
class FlightLooks:
    """The looks of stairs or a ramp.

    Args:
        height: from the floor to the ceiling above it, metres.
        floor: the name of a texture.
        wall: the name of a texture.
        ceiling: the name of a texture; None if they are open to the sky.
    """

    height: float = WALL_HEIGHT
    floor: str = "concrete"
    wall: str = "concrete"
    ceiling: str | None = "concrete_tiles"


def build_stairs(
    sides: Rectangle,
    up: str,
    heights: tuple[float, float],
    *,
    steps: int | None,
    step_height: float,
    looks: FlightLooks,
) -> tuple[Sector, ...]:
    """Return the treads of stairs, from below.

    Args:
        sides: the rectangle in which they lie, min_x, max_x, min_z, max_z.
        up: the direction in which they rise.
        heights: at their foot and at their head.
        steps: the number of steps up; there is one tread less. None for the fewest that are at most `STEP_M` high.
        step_height: the highest step that a body climbs.
        looks: textures, and the height of the ceiling.

    Raises:
        WorldError: if the stairs do not rise, or a step is higher than a body climbs.
    """
    low, high = _read_heights(heights, "stairs")
    n_treads = _count_steps(low, high, steps, step_height) - 1
    rise = (high - low) / (n_treads + 1)
    ceiling = Plane(high + looks.height)
    if n_treads > 1:
        ceiling = _slope(sides, up, (low + rise + looks.height, high - rise + looks.height))
    axis, sign = _find_direction(up)
    start, end = sides[2 * axis : 2 * axis + 2]
    sectors = []
    for number in range(n_treads):
        shares = (number / n_treads, (number + 1) / n_treads)
        ends = [start + share * (end - start) if sign > 0 else end - share * (end - start) for share in shares]
        tread = list(sides)
        tread[2 * axis : 2 * axis + 2] = sorted(ends)
        floor = Plane(low + (number + 1) * rise)
        sectors.append(_build_sector((tread[0], tread[1], tread[2], tread[3]), floor, ceiling, looks, (low, high)))
    return tuple(sectors)


def _count_steps(low: float, high: float, steps: int | None, step_height: float) -> int:
    """Return the number of steps of stairs from one height to another, in metres.

    Args:
        low: the lower height.
        high: the upper height.
        steps: the number that the author wants; None for the fewest steps, at least 2, that a body climbs and that are
            at most `STEP_M` high.
        step_height: the highest step that a body climbs.

    Raises:
        WorldError: if there are fewer than 2 steps, or a step is higher than a body climbs.
    """
    if steps is None:
        return max(math.ceil((high - low) / min(STEP_M, step_height) - _TOLERANCE), 2)
    if steps < 2:
        raise WorldError(f"stairs have steps={steps}; give 2 or more, or none for steps of at most {STEP_M} m")
    rise = (high - low) / steps
    if rise > step_height + _TOLERANCE:
        raise WorldError(
            f"stairs from {low:g} to {high:g} m in {steps} steps have steps of {rise:.3g} m, but a body climbs at "
            f"most step_height = {step_height:g} m; give steps="
            f"{math.ceil((high - low) / step_height - _TOLERANCE)} or more"
        )
    return steps


def build_ramp(sides: Rectangle, up: str, heights: tuple[float, float], *, looks: FlightLooks) -> Sector:
    """Return a ramp; the arguments are those of `build_stairs`.

    Raises:
        WorldError: if the ramp does not rise, or is steeper than 45 degrees.
    """
    low, high = _read_heights(heights, "a ramp")
    axis, _ = _find_direction(up)
    length = sides[2 * axis + 1] - sides[2 * axis]
    if high - low > _STEEPEST * length + _TOLERANCE:
        raise WorldError(
            f"a ramp from {low:g} to {high:g} m that is {length:g} m long is steeper than 45 degrees; make it at least "
            f"{(high - low) / _STEEPEST:g} m long, or use add_stairs()"
        )
    floor = _slope(sides, up, (low, high))
    return _build_sector(sides, floor, floor.raised(looks.height), looks, (low, high))


def _read_heights(heights: tuple[float, float], structure: str) -> tuple[float, float]:
    """Return heights as floats; raise a WorldError unless they are finite and rise."""
    low, high = (float(height) + 0.0 for height in heights)  # the sum turns -0.0 into 0.0
    if not (math.isfinite(low) and math.isfinite(high) and low < high):
        raise WorldError(f"{structure} from floor_y = {low:g} to top_y = {high:g} m do not rise; give a higher top_y")
    return low, high


def _find_direction(up: str) -> tuple[int, int]:
    """Return the axis (0 for x, 1 for z) and sign (1 or -1) of a direction; raise a WorldError for an unknown one."""
    if up not in _DIRECTIONS:
        raise WorldError(f"up is {up!r}; use {', '.join(map(repr, _DIRECTIONS))}")
    return _DIRECTIONS[up]


def _slope(sides: Rectangle, up: str, heights: tuple[float, float]) -> Plane:
    """Return the plane that rises in a direction from the first height to the second within a rectangle.

    Raises:
        WorldError: if the direction is unknown, or the sides make no rectangle.
    """
    axis, sign = _find_direction(up)
    start, end = sides[2 * axis : 2 * axis + 2]
    rectangle(*sides)  # raises an error if the sides make no rectangle
    if sign > 0:
        return slope_between(axis, start, end, *heights)
    return slope_between(axis, end, start, *heights)


def _build_sector(
    sides: Rectangle, floor: Plane, ceiling: Plane, looks: FlightLooks, levels: tuple[float, float]
) -> Sector:
    """Return the sector of a tread or a ramp, between the heights ``levels`` of the flight's foot and head."""
    return Sector(
        rectangle(*(float(side) for side in sides)),
        float(looks.height),
        looks.floor,
        looks.wall,
        looks.ceiling,
        floor_plane=floor,
        ceiling_plane=ceiling,
        levels=levels,
    )
