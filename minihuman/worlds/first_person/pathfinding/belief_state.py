"""The belief state: what an agent has seen of a floor and the things on it, and where it would look next.

Visibility is computed along the ground on a floor divided into cells: unseen, open floor, or wall. Unseen cells are
assumed to hide nothing when the visible area of a place is estimated. The agent knows nothing of the goal before it has
seen a part of it.
"""

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.first_person.entities import Entity
from minihuman.worlds.first_person.pathfinding.line_of_sight import (
    OPEN,
    UNSEEN,
    give_up,
    in_sight,
    mark_seen,
    sees,
    unseen_around,
    visibility_values,
    waypoint,
)
from minihuman.worlds.first_person.pathfinding.planner import zones_of
from minihuman.worlds.first_person.pathfinding.search import clearance_map, distance_map

if TYPE_CHECKING:
    from minihuman.worlds.first_person.env import FirstPersonEnv


CELL_M = 0.25
MOST_CELLS = 40_000
PATCH_M = 1.0  # the side of the patches in which floor is forgotten
_RAYS = 81  # by which a view is marked as seen
_ASPECT = 4 / 3  # of the picture that a person is shown, width over height
_ASIDE = 3  # steps around an obstacle before heading for the target again
_FAR_M = 1.0  # towards a point that is farther off, a less exact heading suffices
_SPARE_TURNS = 0.55  # a heading that differs by less, in turns, is exact enough
_SPARE_TURNS_FAR = 0.9  # the same towards a point that is far off
_SPARE_M = 0.06  # the distance kept from walls in addition to the body's radius
_STRIDE_M = 1.0  # the distance between places that are considered for a look
_WORTH = 2.5  # actions that seeing one more square metre is worth
_ENOUGH_M2 = 16.0  # a look that shows more is worth no more
_LEAST_M2 = 0.5  # a look that shows less is worth nothing
_STILL = 0.4  # a place is given up when less than this share of what it promised is left to see
_TRIES = 20  # looks that are considered before the search is given up
_HALF_RAD = math.radians(35.0)  # half the angle of a look, a little less than a picture shows

Angle = TypeVar("Angle", float, NDArray[np.float64])
Noise = Callable[[int], NDArray[np.float64]]  # returns the errors of so many judgements, in actions


class ExploredFloor:
    """What an agent has seen in one episode.

    Args:
        world: the world, of which only what the agent can see is used
    """

    def __init__(self, world: "FirstPersonEnv") -> None:
        self._world = world
        x0, z0, x1, z1 = world.stage.floor.bounds
        self._bounds = np.array((x0, z0, x1, z1))
        self.cell = max(CELL_M, math.sqrt((x1 - x0) * (z1 - z0) / MOST_CELLS))
        shape = int((x1 - x0) / self.cell) + 1, int((z1 - z0) / self.cell) + 1
        self.seen = np.zeros(shape, np.int8)
        self.things: list[Entity] = []  # the things that have been in view, in the order in which they came into view
        self._in_view = np.zeros(shape, np.bool_)
        self._bumped: set[tuple[float, float, float]] = set()  # poses in which a step ahead led nowhere
        self._tight: set[tuple[int, int]] = set()  # cells of those poses
        self._evading = ""  # the turn that leads around an obstacle; "" without one
        self._aside = 0  # steps left before heading for the target again
        self._looking: tuple[tuple[int, int], float, float] | None = None  # the next look, of `_find_best_look`
        self._clear: tuple[int, NDArray[np.bool_]] | None = None  # the number of obstacles, and where a body fits
        self._distance: NDArray[np.float64] | None = None  # of each cell to the target
        self._going: tuple[int, int] | None = None  # the target's cell
        self.look()

    def look(self) -> int:
        """Mark the floor in view as seen, and remember the things in view; return the number of newly seen cells."""
        agent = self._world.agent
        tangent = math.tan(math.radians(agent.cam_fov_y) / 2)
        eye = np.array((*self._eye(), agent.dir, _ASPECT * tangent))
        walls = self._world.stage.floor.walls
        high = self._find_high_things()
        n_new = int(mark_seen(walls, high, eye, _RAYS, self._bounds, self.cell, self.seen, self._in_view))
        for column, row in self._find_unseen_around(self._current_cell()):  # under the agent
            n_new += self.seen[column, row] == UNSEEN
            self.seen[column, row] = OPEN
            self._in_view[column, row] = True
        for thing in self._world.entities:
            is_new = thing is not agent and not any(thing is seen_thing for seen_thing in self.things)
            if is_new and self._sees(thing, eye, tangent):
                self.things.append(thing)
        return n_new

    def forget(self, chance: float, rng: np.random.Generator) -> None:
        """Forget each patch of floor that is not in view, with a given probability."""
        side = max(round(PATCH_M / self.cell), 1)
        columns, rows = (math.ceil(count / side) for count in self.seen.shape)
        is_forgotten = np.kron(rng.random((columns, rows)) < chance, np.ones((side, side), np.bool_))
        is_forgotten = is_forgotten[: self.seen.shape[0], : self.seen.shape[1]] & ~self._in_view
        self.seen[is_forgotten] = UNSEEN

    def moved(self) -> None:
        """Record that a step ahead succeeded."""
        self._aside -= 1
        if self._aside <= 0:
            self._evading = ""

    def bumped(self) -> None:
        """Record that a step ahead failed, so that something is in the way."""
        self._bumped.add(self._pose())
        self._tight.add(self._current_cell())
        self._distance = None

    def step_to(self, thing: Entity) -> str | None:
        """Return the name of the next move towards a thing that was seen; None if no path is known."""
        return self._step(self._cell(thing.pos[0], thing.pos[2]))

    def step_to_see_more(self, noise: Noise) -> str | None:
        """Return the name of the next move towards the most promising view; None if no more floor can be seen.

        Places whose view is out of reach are given up. The function ``noise`` returns errors of judgement.
        """
        for _ in range(_TRIES):
            if self._looking is None or not self._is_look_worthwhile():
                self._looking = self._find_best_look(noise)
            if self._looking is None:
                return None
            target, yaw, _ = self._looking
            if self._current_cell() == target:
                move = self._turn_to(yaw)
            else:
                move = self._step(target)
            if move is not None:
                return move
            give_up(self.seen, *target, self.cell, yaw, _HALF_RAD)
            self._looking = None
        return None

    def start_over(self) -> None:
        """Forget everything that is not in view now."""
        self.seen[~self._in_view] = UNSEEN
        self._looking = None
        self._tight.clear()

    def _is_look_worthwhile(self) -> bool:
        """Return whether enough of what the next look promised is still unseen."""
        assert self._looking is not None
        target, yaw, promised_m2 = self._looking
        unseen_m2 = in_sight(unseen_around(self.seen, *target, self.cell), yaw, _HALF_RAD)
        return bool(unseen_m2 >= max(_STILL * promised_m2, _LEAST_M2))

    def _find_best_look(self, noise: Noise) -> tuple[tuple[int, int], float, float] | None:
        """Return the cell from which to look next, the yaw of the look, and the unseen floor that it promises in m².

        The result is None if no look promises enough.
        """
        agent = self._world.agent
        stage = self._world.stage
        step = stage.parameters.number("forward_step", None)
        turn = self._turn_rad()
        start = self._current_cell()
        free = self._find_free_cells()
        free[start] = True
        away = distance_map(free, *start, 0.0)
        stride = max(round(_STRIDE_M / self.cell), 1)
        candidates = [start]
        candidates += [
            (column, row)
            for column in range(stride // 2, self.seen.shape[0], stride)
            for row in range(stride // 2, self.seen.shape[1], stride)
            if np.isfinite(away[column, row])
        ]
        cells = np.array(candidates, np.int64)
        costs = np.array([away[candidate] for candidate in candidates]) * self.cell / step
        yaws = np.arctan2(start[1] - cells[:, 1], cells[:, 0] - start[0])  # facing away from the start
        costs[1:] += np.abs(_angle_between(yaws[1:], agent.dir)) / turn
        costs[0] = 0.0
        yaws[0] = agent.dir
        taste = np.array((turn, _HALF_RAD, _LEAST_M2, _WORTH, _ENOUGH_M2))
        looks = visibility_values(self.seen, cells, costs, yaws, self.cell, taste)  # net cost, yaw, promised area
        scores = looks[:, 0] + noise(len(looks))
        best = int(np.argmin(scores))
        if not np.isfinite(scores[best]):
            return None
        return candidates[best], float(looks[best, 1]), float(looks[best, 2])

    def _step(self, target: tuple[int, int]) -> str | None:
        """Return the next move towards a cell, around obstacles that were seen; None if there is none."""
        free = self._find_free_cells()
        start = self._current_cell()
        free[start] = free[target] = True
        if self._going != target or self._distance is None or not np.isfinite(self._distance[start]):
            self._distance = distance_map(free, *target, 0.0)
            self._going = target
        if np.isfinite(self._distance[start]):
            next_cell = waypoint(free, self._distance, *start)
        else:
            next_cell = start
        if next_cell == start:
            return None
        agent = self._world.agent
        x, z = (self._bounds[:2] + (np.array(next_cell) + 0.5) * self.cell).tolist()
        ahead_x = x - agent.pos[0]
        ahead_z = z - agent.pos[2]
        is_far = math.hypot(ahead_x, ahead_z) > _FAR_M
        yaw = math.atan2(-ahead_z, ahead_x)
        turn = self._turn_to(yaw, spare=_SPARE_TURNS_FAR if is_far else _SPARE_TURNS)
        if self._pose() in self._bumped:  # then aside until there is room ahead
            self._evading = self._evading or ("turn_left" if _angle_between(yaw, agent.dir) > 0 else "turn_right")
            self._aside = _ASIDE
            return self._evading
        if self._evading:
            return "move_forward"
        return turn or "move_forward"

    def _turn_to(self, yaw: float, *, spare: float = _SPARE_TURNS) -> str | None:
        """Return the turn towards a heading; None if the heading differs by less than ``spare`` turns."""
        angle_rad = _angle_between(yaw, self._world.agent.dir)
        if abs(angle_rad) <= spare * self._turn_rad():
            return None
        return "turn_left" if angle_rad > 0 else "turn_right"

    def _find_free_cells(self) -> NDArray[np.bool_]:
        """Return a mask of the cells that were seen and in which the agent's body fits."""
        agent = self._world.agent
        stage = self._world.stage
        in_the_way = [entity for entity in self.things if not any(entity is thing for thing in self._world.targets())]
        discs = [(entity.pos[0], entity.pos[2], float(agent.radius + entity.radius)) for entity in in_the_way]
        table = np.array(discs, np.float64).reshape(-1, 3)
        radius = float(agent.radius) + _SPARE_M
        if self._clear is None or self._clear[0] != len(discs):
            cleared = clearance_map(stage.floor.walls, table, zones_of(self._world), self._bounds, self.cell, radius)
            self._clear = len(discs), cleared
        free: NDArray[np.bool_] = self._clear[1] & (self.seen == OPEN)
        for cell in self._tight:
            free[cell] = False
        return free

    def _find_high_things(self) -> NDArray[np.float64]:
        """Return the things that are too high to look over, float64[n, 3] with x, z and radius."""
        agent = self._world.agent
        rows = [
            (entity.pos[0], entity.pos[2], float(entity.radius))
            for entity in self._world.entities
            if entity is not agent
            and entity.pos[1] + entity.height >= agent.pos[1] + agent.cam_height
            and entity.radius > 0
        ]
        return np.array(rows, np.float64).reshape(-1, 3)

    def _sees(self, thing: Entity, eye: NDArray[np.float64], tangent: float) -> bool:
        """Return whether the agent sees a thing in the direction of its view, if no wall or thing hides it.

        A thing whose top lies below the lower edge of the picture is not seen.

        Args:
            thing: the thing.
            eye: the camera's x, z and yaw, and the tangent of half of its horizontal angle of view.
            tangent: the tangent of half of the camera's vertical angle of view.
        """
        agent = self._world.agent
        distance = math.hypot(thing.pos[0] - eye[0], thing.pos[2] - eye[1])
        top = thing.pos[1] + thing.height - agent.pos[1] - agent.cam_height
        other_rows = [row for row in self._find_high_things().tolist() if row[:2] != [thing.pos[0], thing.pos[2]]]
        in_front = np.array(other_rows, np.float64).reshape(-1, 3)
        pitch = math.radians(agent.cam_pitch)
        return math.atan2(top, distance) > pitch - math.atan(tangent) and bool(
            sees(self._world.stage.floor.walls, in_front, eye, thing.pos[0], thing.pos[2])
        )

    def _pose(self) -> tuple[float, float, float]:
        agent = self._world.agent
        return agent.pos[0], agent.pos[2], agent.dir

    def _eye(self) -> tuple[float, float]:
        """Return the position (x, z) of the agent's camera."""
        agent = self._world.agent
        ahead_x, ahead_z = agent.forward
        return agent.pos[0] + agent.cam_fwd_disp * ahead_x, agent.pos[2] + agent.cam_fwd_disp * ahead_z

    def _turn_rad(self) -> float:
        return math.radians(self._world.stage.parameters.number("turn_step", None))

    def _current_cell(self) -> tuple[int, int]:
        return self._cell(self._world.agent.pos[0], self._world.agent.pos[2])

    def _cell(self, x: float, z: float) -> tuple[int, int]:
        """Return the cell that contains a point; the nearest one for a point outside the floor."""
        column = int((x - self._bounds[0]) / self.cell)
        row = int((z - self._bounds[1]) / self.cell)
        return min(max(column, 0), self.seen.shape[0] - 1), min(max(row, 0), self.seen.shape[1] - 1)

    def _find_unseen_around(self, cell: tuple[int, int]) -> list[tuple[int, int]]:
        """Return a cell and those of its eight neighbours that have not been seen."""
        column, row = cell
        return [
            (c, r)
            for c in range(max(column - 1, 0), min(column + 2, self.seen.shape[0]))
            for r in range(max(row - 1, 0), min(row + 2, self.seen.shape[1]))
            if (c, r) == cell or self.seen[c, r] == UNSEEN
        ]


def _angle_between(yaw: Angle, from_yaw: float) -> Angle:
    """Return the angle from the heading ``from_yaw`` to ``yaw``, counter-clockwise, in -pi to pi."""
    return (yaw - from_yaw + math.pi) % (2 * math.pi) - math.pi
