"""Worlds of branching corridors: TMaze, YMaze, Maze."""

import math
from typing import Any

import numpy as np

from minihuman.worlds.first_person.entities import Box, Position
from minihuman.worlds.first_person.layouts.one_room import GoalEnv
from minihuman.worlds.first_person.parameters import uniform
from minihuman.worlds.first_person.rooms import Point, Room
from minihuman.worlds.options import check_number, check_point, check_whole

MOST_ROOMS = 32  # in a row or a column of a maze
_GAP = 0.25  # between the rooms of a maze


class _Fork(GoalEnv):
    """A corridor that ends in two arms, with the box in a random arm or at ``goal_pos``."""

    def __init__(self, *, goal_pos: Position | None = None, max_steps: int | None = 280, **options: Any) -> None:
        if goal_pos is None:
            self.goal_pos = None
        else:
            self.goal_pos = check_point("goal_pos", goal_pos)
        super().__init__(max_steps=max_steps, **options)

    def place_box(self, left: tuple[Room, float], right: tuple[Room, float]) -> None:
        """Place the box at ``goal_pos``, or else at a random position near the end of a random arm.

        Args:
            left: the left arm, and the greatest z of the box there in metres
            right: the right arm, and the least z of the box there in metres
        """
        if self.goal_pos is not None:
            x, _, z = self.goal_pos
            self.box = self.place_entity(Box("red"), min_x=x, max_x=x, min_z=z, max_z=z)
        elif self.np_random.integers(2) == 0:
            self.box = self.place_entity(Box("red"), room=left[0], max_z=left[1])
        else:
            self.box = self.place_entity(Box("red"), room=right[0], min_z=right[1])

    def place_agent_in(self, room: Room) -> None:
        """Place the agent in the corridor, facing roughly along it."""
        self.place_agent(dir=uniform(self.np_random, -math.pi / 4, math.pi / 4), room=room)

    def info(self) -> dict[str, Any]:
        """Return the position of the box as "goal_pos", float64[3]: x, y, z."""
        return {"goal_pos": np.array(self.box.pos)}


class TMaze(_Fork):
    """A corridor that ends at a crosswise corridor."""

    def build(self) -> None:
        """Build the corridors, and place the box and the agent."""
        stem = self.add_rect_room(min_x=-1, max_x=8, min_z=-2, max_z=2)
        arms = self.add_rect_room(min_x=8, max_x=12, min_z=-8, max_z=8)
        self.connect_rooms(stem, arms, min_z=-2, max_z=2)
        self.place_box((arms, arms.min_z + 2), (arms, arms.max_z - 2))
        self.place_agent_in(stem)


class YMaze(_Fork):
    """Three corridors that meet in a triangle, 120 degrees apart."""

    def build(self) -> None:
        """Build the corridors, and place the box and the agent."""
        outline = ((-9.15, -2.0), (-9.15, 2.0), (-1.15, 2.0), (-1.15, -2.0))
        stem = self.add_room(outline)
        hub = self.add_room(((-1.15, -2.0), (-1.15, 2.0), (2.31, 0.0)))
        left = self.add_room(_rotate(outline, -120))
        right = self.add_room(_rotate(outline, 120))
        self.connect_rooms(stem, hub, min_z=-2, max_z=2)
        self.connect_rooms(left, hub, min_z=-1.995, max_z=0)
        self.connect_rooms(right, hub, min_z=0, max_z=1.995)
        self.place_box((left, left.min_z + 2.5), (right, right.max_z - 2.5))
        self.place_agent_in(stem)


class Maze(GoalEnv):
    """A maze of square rooms without loops, with a red box in one of them."""

    def __init__(
        self,
        *,
        num_rows: int = 8,
        num_cols: int = 8,
        room_size: float = 3,
        max_steps: int | None = None,
        **options: Any,
    ) -> None:
        self.num_rows = check_whole("num_rows", num_rows, 1, MOST_ROOMS)
        self.num_cols = check_whole("num_cols", num_cols, 1, MOST_ROOMS)
        self.room_size = check_number("room_size", room_size, 1, 100)
        super().__init__(max_steps=num_rows * num_cols * 24 if max_steps is None else max_steps, **options)

    def build(self) -> None:
        """Build the rooms in rows, and open walls along a random walk that backtracks at dead ends."""
        pitch = self.room_size + _GAP
        rooms = {
            (column, row): self.add_rect_room(
                min_x=column * pitch,
                max_x=column * pitch + self.room_size,
                min_z=row * pitch,
                max_z=row * pitch + self.room_size,
                wall="brick_wall",
            )
            for row in range(self.num_rows)
            for column in range(self.num_cols)
        }
        # a room is entered once; then the order of its four directions is drawn, from 4, 3, 2 and 1 that remain
        shuffles = iter(self.np_random.integers(np.tile((4, 3, 2, 1), len(rooms))).reshape(-1, 4).tolist())
        visited = {(0, 0)}
        trail = [((0, 0), _directions(next(shuffles)))]
        while trail:
            (column, row), directions = trail[-1]
            if not directions:
                trail.pop()
                continue
            right, down = directions.pop(0)
            neighbour = column + right, row + down
            if neighbour not in rooms or neighbour in visited:
                continue
            room = rooms[column, row]
            if right == 0:
                self.connect_rooms(room, rooms[neighbour], min_x=room.min_x, max_x=room.max_x)
            else:
                self.connect_rooms(room, rooms[neighbour], min_z=room.min_z, max_z=room.max_z)
            visited.add(neighbour)
            trail.append((neighbour, _directions(next(shuffles))))
        self.box = self.place_entity(Box("red"))
        self.place_agent()


def _directions(picks: list[int]) -> list[tuple[int, int]]:
    """Return the four directions (columns to the right, rows down) in the order of random picks.

    Each pick is an index among the directions that were not picked before.
    """
    remaining = [(1, 0), (-1, 0), (0, -1), (0, 1)]
    return [remaining.pop(pick) for pick in picks]


def _rotate(outline: tuple[Point, ...], degrees: float) -> tuple[Point, ...]:
    """Return an outline rotated about the origin by an angle in degrees, counter-clockwise as seen from above."""
    half_rad = degrees * (math.pi / 180) / 2.0
    # by the half angle, as Miniworld computes a rotation matrix, so that corners have the same bits
    cosine_half = math.cos(half_rad)
    sine_half = -math.sin(half_rad)
    cosine = cosine_half * cosine_half - sine_half * sine_half
    sine = 2 * (cosine_half * sine_half)
    return tuple((x * cosine - z * sine, x * sine + z * cosine) for x, z in outline)
