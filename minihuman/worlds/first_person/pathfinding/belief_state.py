"""Belief state: what an agent has seen of a floor and of the things on it, and where it would look next.

Sight runs along the ground over a floor divided into cells: unseen, open floor, or wall. What is unseen hides nothing
when it is estimated what could be seen. Of the goal it knows nothing before some of it was in view.
"""

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.first_person.entities import Entity
from minihuman.worlds.first_person.pathfinding.planner import zones_of
from minihuman.worlds.first_person.pathfinding.search import clearance_map, distance_map
from minihuman.worlds.kernels import kernel

if TYPE_CHECKING:
    from minihuman.worlds.first_person.env import FirstPersonEnv

UNSEEN, OPEN, WALL = 0, 1, 2
BEARINGS = 72  # directions that are looked along from a place
RANGE_M = 6.0  # how far off something new is looked for

_BEARING_RAD = 2 * math.pi / BEARINGS


@kernel("(float64[:, ::1], float64[:, ::1], float64[::1], int64, float64[::1], float64, int8[:, ::1], boolean[:, ::1])")
def mark_seen(
    walls: NDArray[np.float64],
    discs: NDArray[np.float64],
    eye: NDArray[np.float64],
    rays: int,
    bounds: NDArray[np.float64],
    cell: float,
    seen: NDArray[np.int8],
    in_view: NDArray[np.bool_],
) -> int:
    """Mark the cells in sight; how many are new. ``seen`` and ``in_view``, (columns, rows), are filled.

    Args:
        walls: (n, 4): x0, z0, x1, z1.
        discs: (n, 3): x, z and radius of things as high as the eye.
        eye: x, z, yaw, and the tangent of half the angle of view.
        rays: how many lines are looked along.
        bounds: of the floor: x0, z0, x1, z1.
        cell: metres.
        seen: what each cell is known to be.
        in_view: which cells are in sight now.
    """
    columns, rows = seen.shape
    in_view[:] = False
    new = 0
    for ray in range(rays):
        yaw = eye[2] + math.atan(eye[3] * (2 * ray / (rays - 1) - 1))
        along_x, along_z = math.cos(yaw), -math.sin(yaw)
        far = _to_wall(walls, discs, eye[0], eye[1], along_x, along_z)
        count = int(min(far, 1e3) / (cell / 2)) + 1
        for part in range(count + 1):
            off = part * cell / 2
            is_wall = part == count
            if is_wall:
                off = far + 0.1 * cell
            elif off >= far:
                continue
            column = math.floor((eye[0] + off * along_x - bounds[0]) / cell)
            row = math.floor((eye[1] + off * along_z - bounds[1]) / cell)
            if not (0 <= column < columns and 0 <= row < rows):
                break
            in_view[column, row] = True
            if seen[column, row] == UNSEEN:
                new += 1
            if is_wall or seen[column, row] == UNSEEN:
                seen[column, row] = WALL if is_wall else OPEN
    return new


@kernel("(float64[:, ::1], float64[:, ::1], float64[::1], float64, float64)")
def sees(walls: NDArray[np.float64], discs: NDArray[np.float64], eye: NDArray[np.float64], x: float, z: float) -> bool:
    """Whether a point is in the angle of view and nothing hides it."""
    off_x, off_z = x - eye[0], z - eye[1]
    distance = math.hypot(off_x, off_z)
    cos_yaw, sin_yaw = math.cos(eye[2]), math.sin(eye[2])
    ahead, aside = off_x * cos_yaw - off_z * sin_yaw, off_x * sin_yaw + off_z * cos_yaw
    if ahead <= 0 or abs(aside) > ahead * eye[3]:
        return False
    return bool(_to_wall(walls, discs, eye[0], eye[1], off_x / distance, off_z / distance) >= distance)


@kernel("(float64[:, ::1], float64[:, ::1], float64, float64, float64, float64)")
def _to_wall(
    walls: NDArray[np.float64], discs: NDArray[np.float64], x: float, z: float, along_x: float, along_z: float
) -> float:
    """How far it is along a line to the first wall or disc; infinite without any."""
    nearest = np.inf
    for index in range(walls.shape[0]):
        ax, az = walls[index, 0] - x, walls[index, 1] - z
        wall_x, wall_z = walls[index, 2] - walls[index, 0], walls[index, 3] - walls[index, 1]
        across = along_x * wall_z - along_z * wall_x
        if abs(across) < 1e-12:
            continue
        off = (ax * wall_z - az * wall_x) / across
        share = (ax * along_z - az * along_x) / across
        if off > 0 and -1e-9 <= share <= 1 + 1e-9 and off < nearest:
            nearest = off
    for index in range(discs.shape[0]):
        off_x, off_z = discs[index, 0] - x, discs[index, 1] - z
        middle = off_x * along_x + off_z * along_z
        beside = off_x * off_x + off_z * off_z - middle * middle
        within = discs[index, 2] * discs[index, 2] - beside
        if within > 0 and middle > math.sqrt(within):
            nearest = min(nearest, middle - math.sqrt(within))
    return nearest


@kernel("(int8[:, ::1], int64, int64, float64)")
def unseen_around(seen: NDArray[np.int8], column: int, row: int, cell: float) -> NDArray[np.float64]:
    """How much unseen floor would come into view from a cell, by bearing (counter-clockwise from +x), in m2."""
    columns, rows = seen.shape
    found = np.zeros(BEARINGS)
    for bearing in range(BEARINGS):
        along_x, along_z = math.cos(bearing * _BEARING_RAD), -math.sin(bearing * _BEARING_RAD)
        for part in range(1, int(RANGE_M / cell) + 1):
            c = math.floor(column + 0.5 + part * along_x)
            r = math.floor(row + 0.5 + part * along_z)
            if not (0 <= c < columns and 0 <= r < rows) or seen[c, r] == WALL:
                break
            if seen[c, r] == UNSEEN:
                found[bearing] += part * cell * cell * _BEARING_RAD
    return found


@kernel("(float64[::1], float64, float64)")
def in_sight(around: NDArray[np.float64], yaw: float, half_rad: float) -> float:
    """How much of what is around is in view along ``yaw``, m2."""
    total = 0.0
    for bearing in range(BEARINGS):
        off = (bearing * _BEARING_RAD - yaw + math.pi) % (2 * math.pi) - math.pi
        if abs(off) <= half_rad:
            total += around[bearing]
    return total


@kernel("(int8[:, ::1], int64[:, ::1], float64[::1], float64[::1], float64, float64[::1])")
def visibility_values(
    seen: NDArray[np.int8],
    places: NDArray[np.int64],
    costs: NDArray[np.float64],
    yaws: NDArray[np.float64],
    cell: float,
    taste: NDArray[np.float64],
) -> NDArray[np.float64]:
    """For each place the best look from it, (n, 3): cost less worth, its yaw, and how much it promises to show, m2.

    Args:
        seen: what each cell is known to be.
        places: (n, 2): column, row.
        costs: actions that it takes to be there.
        yaws: how one faces there.
        cell: metres.
        taste: the angle of a turn, half the angle of view, the least that is worth a look, what a square metre is worth
            in actions, and how many at once are enough.
    """
    turn, half, least, worth, enough = taste[0], taste[1], taste[2], taste[3], taste[4]
    found = np.empty((len(places), 3))
    for place in range(len(places)):
        around = unseen_around(seen, places[place, 0], places[place, 1], cell)
        found[place] = np.inf, 0.0, 0.0
        for bearing in range(0, BEARINGS, 3):
            yaw = bearing * _BEARING_RAD
            unseen = in_sight(around, yaw, half)
            if unseen >= least:
                off = abs((yaw - yaws[place] + math.pi) % (2 * math.pi) - math.pi)
                score = costs[place] + off / turn - worth * min(unseen, enough)
                if score < found[place, 0]:
                    found[place] = score, yaw, unseen
    return found


@kernel("(int8[:, ::1], int64, int64, float64, float64, float64)")
def give_up(seen: NDArray[np.int8], column: int, row: int, cell: float, yaw: float, half_rad: float) -> None:
    """Mark as wall what should have come into view from here along ``yaw`` and did not."""
    columns, rows = seen.shape
    for bearing in range(BEARINGS):
        off = (bearing * _BEARING_RAD - yaw + math.pi) % (2 * math.pi) - math.pi
        if abs(off) > half_rad:
            continue
        along_x, along_z = math.cos(bearing * _BEARING_RAD), -math.sin(bearing * _BEARING_RAD)
        for part in range(1, int(RANGE_M / cell) + 1):
            c = math.floor(column + 0.5 + part * along_x)
            r = math.floor(row + 0.5 + part * along_z)
            if not (0 <= c < columns and 0 <= r < rows) or seen[c, r] == WALL:
                break
            if seen[c, r] == UNSEEN:
                seen[c, r] = WALL
                break


@kernel("(boolean[:, ::1], float64[:, ::1], int64, int64)")
def waypoint(free: NDArray[np.bool_], distance: NDArray[np.float64], column: int, row: int) -> tuple[int, int]:
    """The farthest cell on the path down a map of distances that a straight line reaches."""
    columns, rows = free.shape
    best_c, best_r = column, row
    c, r = column, row
    while distance[c, r] > 0:
        next_c, next_r, lowest = c, r, np.inf
        for right in range(-2, 3):
            for down in range(-2, 3):
                i, j = c + right, r + down
                if 0 <= i < columns and 0 <= j < rows and distance[i, j] < distance[c, r]:
                    through = distance[i, j] + math.hypot(right, down)
                    if through < lowest:
                        next_c, next_r, lowest = i, j, through
        if next_c == c and next_r == r:
            break
        first = c == column and r == row
        c, r = next_c, next_r
        if not first and not _straight(free, column, row, c, r):
            break
        best_c, best_r = c, r
    return best_c, best_r


@kernel("(boolean[:, ::1], int64, int64, int64, int64)")
def _straight(free: NDArray[np.bool_], column: int, row: int, to_column: int, to_row: int) -> bool:
    parts = 2 * max(abs(to_column - column), abs(to_row - row), 1)
    for part in range(1, parts + 1):
        c = math.floor(column + (to_column - column) * part / parts + 0.5)
        r = math.floor(row + (to_row - row) * part / parts + 0.5)
        if not free[c, r]:
            return False
    return True


CELL_M = 0.25
MOST_CELLS = 40_000
PATCH_M = 1.0  # what is forgotten is forgotten in patches of this size
_RAYS = 81
_ASPECT = 4 / 3  # of the picture that a person is shown, width over height
_ASIDE = 3
_FAR_M = 1.0  # a heading towards what is farther off need not be as exact
_SPARE_M = 0.06  # kept from walls beyond the body's radius
_STRIDE_M = 1.0  # between places that are thought of as places to look from
_WORTH = 2.5  # actions that seeing one more square metre is worth
_ENOUGH_M2 = 16.0  # more at once is worth no more
_LEAST_M2 = 0.5  # less is not worth looking for
_STILL = 0.4  # a place is given up when less than this share of what it promised is left to see
_TRIES = 20  # to find something that can be looked at
_HALF_RAD = math.radians(35.0)  # of a glance, a little less than is shown

Angle = TypeVar("Angle", float, NDArray[np.float64])
Noise = Callable[[int], NDArray[np.float64]]  # how far off each of so many judgements is, in actions


class ExploredFloor:
    """What has been seen in one episode.

    Args:
        world: its rooms, things and agent; looked at through the agent's eye alone.
    """

    def __init__(self, world: "FirstPersonEnv") -> None:
        self._world = world
        x0, z0, x1, z1 = world.stage.floor.bounds
        self._bounds = np.array((x0, z0, x1, z1))
        self.cell = max(CELL_M, math.sqrt((x1 - x0) * (z1 - z0) / MOST_CELLS))
        shape = int((x1 - x0) / self.cell) + 1, int((z1 - z0) / self.cell) + 1
        self.seen = np.zeros(shape, np.int8)
        self.things: list[Entity] = []  # that have been in view, in that order
        self._in_view = np.zeros(shape, np.bool_)
        self._bumped: set[tuple[float, float, float]] = set()  # poses in which a step ahead led nowhere
        self._tight: set[tuple[int, int]] = set()  # cells of those poses
        self._evading = ""  # the turn that leads round what is in the way
        self._aside = 0  # steps left before heading for the target again
        self._looking: tuple[tuple[int, int], float, float] | None = None  # from where, along which yaw, for how much
        self._clear: tuple[int, NDArray[np.bool_]] | None = None  # of how many things, and where a body fits
        self._distance: NDArray[np.float64] | None = None  # to the target
        self._going: tuple[int, int] | None = None
        self.look()

    def look(self) -> int:
        """Remember what is in view now; how many cells are new."""
        agent = self._world.agent
        tangent = math.tan(math.radians(agent.cam_fov_y) / 2)
        eye = np.array((*self._eye(), agent.dir, _ASPECT * tangent))
        walls, high = self._world.stage.floor.walls, self._high()
        new = int(mark_seen(walls, high, eye, _RAYS, self._bounds, self.cell, self.seen, self._in_view))
        for column, row in self._around(self._here()):  # under the agent
            new += self.seen[column, row] == UNSEEN
            self.seen[column, row], self._in_view[column, row] = OPEN, True
        for thing in self._world.entities:
            if thing is not agent and not any(thing is one for one in self.things) and self._sees(thing, eye, tangent):
                self.things.append(thing)
        return new

    def forget(self, chance: float, rng: np.random.Generator) -> None:
        """Each patch of floor that is not in view is forgotten with this chance."""
        side = max(round(PATCH_M / self.cell), 1)
        columns, rows = (-(-count // side) for count in self.seen.shape)
        gone = np.kron(rng.random((columns, rows)) < chance, np.ones((side, side), np.bool_))
        gone = gone[: self.seen.shape[0], : self.seen.shape[1]] & ~self._in_view
        self.seen[gone] = UNSEEN

    def moved(self) -> None:
        """A step ahead succeeded."""
        self._aside -= 1
        if self._aside <= 0:
            self._evading = ""

    def bumped(self) -> None:
        """A step ahead led nowhere: something is in the way."""
        self._bumped.add(self._pose())
        self._tight.add(self._here())
        self._distance = None

    def step_to(self, thing: Entity) -> str | None:
        """The move that leads towards a thing that was seen; None where no path is known."""
        return self._step(self._cell(thing.pos[0], thing.pos[2]))

    def step_to_see_more(self, noise: Noise) -> str | None:
        """The move that leads to seeing more; None where nothing more can be seen."""
        for _ in range(_TRIES):
            if self._looking is None or not self._worth_it():
                self._looking = self._best(noise)
            if self._looking is None:
                return None
            (place, yaw, _), here = self._looking, self._here()
            move = self._turn_to(yaw) if here == place else self._step(place)
            if move is not None:
                return move
            give_up(self.seen, *place, self.cell, yaw, _HALF_RAD)
            self._looking = None
        return None

    def start_over(self) -> None:
        """Forget all that is not in view now."""
        self.seen[~self._in_view] = UNSEEN
        self._looking = None
        self._tight.clear()

    def _worth_it(self) -> bool:
        assert self._looking is not None
        place, yaw, promised = self._looking
        left = in_sight(unseen_around(self.seen, *place, self.cell), yaw, _HALF_RAD)
        return bool(left >= max(_STILL * promised, _LEAST_M2))

    def _best(self, noise: Noise) -> tuple[tuple[int, int], float, float] | None:
        """Where to look from, along which yaw, and how much unseen floor that promises, m2."""
        agent, stage = self._world.agent, self._world.stage
        step, turn = stage.parameters.number("forward_step", None), self._turn_rad()
        here = self._here()
        free = self._free()
        free[here] = True
        away = distance_map(free, *here, 0.0)
        stride = max(round(_STRIDE_M / self.cell), 1)
        places = [here]
        places += [
            (column, row)
            for column in range(stride // 2, self.seen.shape[0], stride)
            for row in range(stride // 2, self.seen.shape[1], stride)
            if np.isfinite(away[column, row])
        ]
        at = np.array(places, np.int64)
        costs = np.array([away[place] for place in places]) * self.cell / step
        yaws = np.arctan2(here[1] - at[:, 1], at[:, 0] - here[0])  # facing away from the start
        costs[1:] += np.abs(_off(yaws[1:], agent.dir)) / turn
        costs[0], yaws[0] = 0.0, agent.dir
        taste = np.array((turn, _HALF_RAD, _LEAST_M2, _WORTH, _ENOUGH_M2))
        found = visibility_values(self.seen, at, costs, yaws, self.cell, taste)
        scores = found[:, 0] + noise(len(found))
        first = int(np.argmin(scores))
        if not np.isfinite(scores[first]):
            return None
        return places[first], float(found[first, 1]), float(found[first, 2])

    def _step(self, place: tuple[int, int]) -> str | None:
        """The move towards a cell, round known obstacles; None where there is none."""
        free, here = self._free(), self._here()
        free[here] = free[place] = True
        if self._going != place or self._distance is None or not np.isfinite(self._distance[here]):
            self._distance, self._going = distance_map(free, *place, 0.0), place
        aim = waypoint(free, self._distance, *here) if np.isfinite(self._distance[here]) else here
        if aim == here:
            return None
        agent = self._world.agent
        x, z = (self._bounds[:2] + (np.array(aim) + 0.5) * self.cell).tolist()
        off_x, off_z = x - agent.pos[0], z - agent.pos[2]
        far = math.hypot(off_x, off_z) > _FAR_M
        yaw = math.atan2(-off_z, off_x)
        turn = self._turn_to(yaw, spare=0.9 if far else 0.55)
        if self._pose() in self._bumped:  # then aside until there is room ahead
            self._evading = self._evading or ("turn_left" if _off(yaw, agent.dir) > 0 else "turn_right")
            self._aside = _ASIDE
            return self._evading
        if self._evading:
            return "move_forward"
        return turn or "move_forward"

    def _turn_to(self, yaw: float, *, spare: float = 0.55) -> str | None:
        """The turn towards a heading; None where it is off by less than ``spare`` turns."""
        off = _off(yaw, self._world.agent.dir)
        if abs(off) <= spare * self._turn_rad():
            return None
        return "turn_left" if off > 0 else "turn_right"

    def _free(self) -> NDArray[np.bool_]:
        """Cells that are free as far as is known."""
        agent, stage = self._world.agent, self._world.stage
        in_the_way = [one for one in self.things if not any(one is thing for thing in self._world.targets())]
        discs = [(one.pos[0], one.pos[2], float(agent.radius + one.radius)) for one in in_the_way]
        table = np.array(discs, np.float64).reshape(-1, 3)
        radius = float(agent.radius) + _SPARE_M
        if self._clear is None or self._clear[0] != len(discs):
            cleared = clearance_map(stage.floor.walls, table, zones_of(self._world), self._bounds, self.cell, radius)
            self._clear = len(discs), cleared
        free: NDArray[np.bool_] = self._clear[1] & (self.seen == OPEN)
        for cell in self._tight:
            free[cell] = False
        return free

    def _high(self) -> NDArray[np.float64]:
        """Things too high to look over."""
        agent = self._world.agent
        rows = [
            (one.pos[0], one.pos[2], float(one.radius))
            for one in self._world.entities
            if one is not agent and one.pos[1] + one.height >= agent.pos[1] + agent.cam_height and one.radius > 0
        ]
        return np.array(rows, np.float64).reshape(-1, 3)

    def _sees(self, thing: Entity, eye: NDArray[np.float64], tangent: float) -> bool:
        agent = self._world.agent
        distance = math.hypot(thing.pos[0] - eye[0], thing.pos[2] - eye[1])
        top = thing.pos[1] + thing.height - agent.pos[1] - agent.cam_height
        others = [row for row in self._high().tolist() if row[:2] != [thing.pos[0], thing.pos[2]]]
        in_front = np.array(others, np.float64).reshape(-1, 3)
        pitch = math.radians(agent.cam_pitch)
        return math.atan2(top, distance) > pitch - math.atan(tangent) and bool(
            sees(self._world.stage.floor.walls, in_front, eye, thing.pos[0], thing.pos[2])
        )

    def _pose(self) -> tuple[float, float, float]:
        agent = self._world.agent
        return agent.pos[0], agent.pos[2], agent.dir

    def _eye(self) -> tuple[float, float]:
        agent = self._world.agent
        ahead_x, ahead_z = agent.forward
        return agent.pos[0] + agent.cam_fwd_disp * ahead_x, agent.pos[2] + agent.cam_fwd_disp * ahead_z

    def _turn_rad(self) -> float:
        return math.radians(self._world.stage.parameters.number("turn_step", None))

    def _here(self) -> tuple[int, int]:
        return self._cell(self._world.agent.pos[0], self._world.agent.pos[2])

    def _cell(self, x: float, z: float) -> tuple[int, int]:
        column, row = int((x - self._bounds[0]) / self.cell), int((z - self._bounds[1]) / self.cell)
        return min(max(column, 0), self.seen.shape[0] - 1), min(max(row, 0), self.seen.shape[1] - 1)

    def _around(self, cell: tuple[int, int]) -> list[tuple[int, int]]:
        column, row = cell
        return [
            (c, r)
            for c in range(max(column - 1, 0), min(column + 2, self.seen.shape[0]))
            for r in range(max(row - 1, 0), min(row + 2, self.seen.shape[1]))
            if (c, r) == cell or self.seen[c, r] == UNSEEN
        ]


def _off(yaw: Angle, from_yaw: float) -> Angle:
    """How far a heading is from another, counter-clockwise, -pi to pi."""
    return (yaw - from_yaw + math.pi) % (2 * math.pi) - math.pi
