"""Motion of the agent's body beyond the eight actions: moves that slide along what they meet, and continuous actions.

A move is made in parts shorter than the body, so that nothing is passed through. Where a part would overlap walls or
entities, the body is pushed out of them along their normals: what remains is the component along them. All numbers are
sums, products, quotients and square roots of doubles, so a path is the same on every machine if
headings are turned by our own sine (`trig`).
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.first_person.entities import Entity, Position
from minihuman.worlds.first_person.rules import ACTIONS, MOVE_BACK
from minihuman.worlds.first_person.state import WorldState

CONTROLS = ("discrete", "discrete-strafe", "continuous", "continuous-strafe")
STRAFES = ("strafe_left", "strafe_right")
RESOLUTION = 1024  # of a continuous action: a component is a whole number of these parts
NO_USE = "rest"  # the value 0 of "use": the hands do nothing

RADIANS = math.pi / 180  # of a degree, as the eight actions have it

_MOST_PUSHES = 4  # out of walls and entities, for one part of a move
_CLEARANCE_M = 1e-9  # between the body and what pushed it out, so that rounding leaves no overlap
_PART = 0.5  # of the body's radius: the length of a part of a move
_ELEMENT_NAMES = ("move_back", "move_forward", "turn_right", "turn_left", *STRAFES)  # to the ends of each component


@dataclass(frozen=True, slots=True)
class Command:
    """What a continuous action asks for.

    Args:
        ahead: -1 to 1 of the longest step.
        turn: to the left, -1 to 1 of the widest turn.
        right: -1 to 1 of the longest step.
        use: what the hands do, one of the world's other actions; "" for nothing.
    """

    ahead: float
    turn: float
    right: float = 0.0
    use: str = ""


class ContinuousControl:
    """The action space of a world with continuous motion, and how its actions are read.

    The space is a Box of speed, turn and, with strafing, strafe, each from -1 to 1. In a world with other actions than
    moves, it is a Dict of that Box ("move") and the number of another action ("use"), 0 for none.

    Args:
        action_names: the names of the world's discrete actions, out of `rules.ACTIONS`.
        strafes: whether the body can move sideways.
    """

    def __init__(self, action_names: Sequence[str], *, strafes: bool) -> None:
        self.uses = tuple(name for name in action_names if ACTIONS.index(name) > MOVE_BACK)
        n_axes = 3 if strafes else 2
        box = gymnasium.spaces.Box(-1.0, 1.0, (n_axes,), np.float32)
        self.space: gymnasium.Space[Any] = box
        if self.uses:
            self.space = gymnasium.spaces.Dict({"move": box, "use": gymnasium.spaces.Discrete(1 + len(self.uses))})
        self.element_names = _ELEMENT_NAMES[: 2 * n_axes] + self.uses

    def read(self, action: Any) -> Command:
        """Return what an action asks for, with components rounded to 1/`RESOLUTION`.

        Raises:
            WorldError: if the action is not in the space.
        """
        move, use = action, 0
        if self.uses and isinstance(action, Mapping) and action.keys() == {"move", "use"}:
            move, use = action["move"], action["use"]
        components = np.asarray(move, np.float64) if isinstance(move, np.ndarray | list | tuple) else np.zeros(0)
        box = self.space["move"] if isinstance(self.space, gymnasium.spaces.Dict) else self.space
        is_inside = components.shape == box.shape and bool((np.abs(components) <= 1.0).all())
        if not is_inside or use not in range(1 + len(self.uses)):
            raise WorldError(f"action is {action!r}; it must be in {self.space}")
        ahead, turn, *sideways = (np.round(components * RESOLUTION) / RESOLUTION).tolist()
        return Command(ahead, turn, sideways[0] if sideways else 0.0, ("", *self.uses)[int(use)])


def approach(velocity: tuple[float, float], wanted: tuple[float, float], most: float) -> tuple[float, float]:
    """Return a velocity that has come nearer to the wanted one, by at most ``most`` in length."""
    change_x = wanted[0] - velocity[0]
    change_z = wanted[1] - velocity[1]
    length = math.sqrt(change_x * change_x + change_z * change_z)
    if length <= most:
        return wanted
    share = most / length
    return velocity[0] + share * change_x, velocity[1] + share * change_z


def limit_length(x: float, z: float) -> tuple[float, float]:
    """Return a vector, shortened to length 1 if it is longer: who goes ahead and sideways is no faster."""
    length = math.sqrt(x * x + z * z)
    if length <= 1.0:
        return x, z
    return x / length, z / length


def turn_body(stage: WorldState, angle_rad: float) -> bool:
    """Turn the agent to the left by an angle; return whether it turned.

    It does not turn if what it carries would then overlap something.
    """
    agent = stage.agent
    before = agent.dir
    agent.dir = before + angle_rad
    if not _load_fits(stage):
        agent.dir = before
        return False
    _bring_load(stage)
    return angle_rad != 0.0


def walk(stage: WorldState, ahead_m: float, right_m: float) -> bool:
    """Move the agent by metres ahead and to the right of its heading, as `slide` does; return whether it moved."""
    ahead_x, ahead_z = stage.agent.forward
    return slide(stage, ahead_x * ahead_m - ahead_z * right_m, ahead_z * ahead_m + ahead_x * right_m)


def slide(stage: WorldState, dx: float, dz: float) -> bool:
    """Move the agent by metres in the plan, along what stands in its way; return whether it moved."""
    agent = stage.agent
    x0, _, z0 = agent.pos
    distance = math.sqrt(dx * dx + dz * dz)
    n_parts = max(1, math.ceil(distance / (_PART * float(agent.radius))))
    for _ in range(n_parts):
        before = agent.pos
        place = _find_free_place(stage, before[0] + dx / n_parts, before[2] + dz / n_parts)
        if place is None:
            break
        agent.pos = place
        if not _load_fits(stage):
            agent.pos = before
            break
    _bring_load(stage)
    return (agent.pos[0], agent.pos[2]) != (x0, z0)


def _find_free_place(stage: WorldState, x: float, z: float) -> Position | None:
    """Return the position nearest to a point at which the agent overlaps nothing, as far as pushes find one."""
    for _ in range(_MOST_PUSHES):
        place = stage.find_place(stage.agent, x, z)
        if place is not None:
            return place
        x, z = _push_out(stage, x, z)
    return stage.find_place(stage.agent, x, z)


def _push_out(stage: WorldState, x: float, z: float) -> tuple[float, float]:
    """Return a point from which the agent no longer overlaps what it overlapped most."""
    near_x, near_z, reach = _find_deepest(stage, x, z)
    away_x = x - near_x
    away_z = z - near_z
    distance = math.sqrt(away_x * away_x + away_z * away_z)
    if distance == 0.0:  # on the wall itself, which has no side
        return x, z
    share = (reach + _CLEARANCE_M) / distance
    return near_x + share * away_x, near_z + share * away_z


def _find_deepest(stage: WorldState, x: float, z: float) -> tuple[float, float, float]:
    """Return the point (x, z) that the agent would overlap most, and the distance at which it would not."""
    agent = stage.agent
    radius = float(agent.radius)
    points = _nearest_on_walls(stage.solid_walls(agent, x, z), x, z)
    distances = np.sqrt((points[:, 0] - x) ** 2 + (points[:, 1] - z) ** 2)
    deepest = (math.inf, x, z, radius)
    if len(points):
        row = int(distances.argmin())
        deepest = (float(distances[row]) - radius, float(points[row, 0]), float(points[row, 1]), radius)
    for other in stage.entities:
        if not stage.is_beside(agent, other):
            continue
        reach = float(agent.radius + other.radius)
        dx = other.pos[0] - x
        dz = other.pos[2] - z
        overlap = math.sqrt(dx * dx + dz * dz) - reach
        if overlap < deepest[0]:
            deepest = (overlap, other.pos[0], other.pos[2], reach)
    return deepest[1:]


def _nearest_on_walls(walls: NDArray[np.float64], x: float, z: float) -> NDArray[np.float64]:
    """Return the point (x, z) of each wall that is nearest to a place, (n, 2)."""
    start = walls[:, :2]
    along = walls[:, 2:] - start
    shares = ((x - start[:, 0]) * along[:, 0] + (z - start[:, 1]) * along[:, 1]) / (along[:, 0] ** 2 + along[:, 1] ** 2)
    nearest: NDArray[np.float64] = start + np.clip(shares, 0.0, 1.0)[:, None] * along
    return nearest


def _load_fits(stage: WorldState) -> bool:
    """Return whether what the agent carries overlaps nothing where the agent is now."""
    load = stage.agent.carrying
    if load is None:
        return True
    return stage.load_fits(load, *stage.carrying_position(stage.agent.pos, load))


def _bring_load(stage: WorldState) -> None:
    """Put what the agent carries before it."""
    load: Entity | None = stage.agent.carrying
    if load is not None:
        load.pos = stage.carrying_position(stage.agent.pos, load)
        load.dir = stage.agent.dir
