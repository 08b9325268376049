"""Worlds of one room: OneRoom, PickupObjects, PutNext, RoomObjects, CollectHealth; and `GoalEnv`.

`GoalEnv` is the base of worlds with one goal: an episode ends near a red box, and its reward decreases with every step.
"""

from collections.abc import Sequence
from typing import Any

from minihuman.worlds.colours import COLOUR_NAMES
from minihuman.worlds.contract import PathLengthBounds
from minihuman.worlds.first_person.entities import Ball, Box, Entity, Key, Mesh
from minihuman.worlds.first_person.env import (
    FirstPersonEnv,
    TerminationRule,
    near_goal,
    pick_up_all,
    put_next,
    stay_alive,
)
from minihuman.worlds.first_person.parameters import uniform
from minihuman.worlds.first_person.pathfinding.planner import least_steps, plan, plan_put_next, plan_take_all
from minihuman.worlds.first_person.rules import ACTIONS, MOVES
from minihuman.worlds.options import MAX_METRES, check_number, check_whole


class GoalEnv(FirstPersonEnv):
    """The base class of worlds whose episodes end near ``self.box``, which their ``build`` places."""

    box: Box

    def __init__(self, *, max_steps: int | None = 250, **options: Any) -> None:
        super().__init__(max_steps=max_steps, actions=MOVES, **options)

    def termination_rule(self) -> TerminationRule:
        """Return the rule that ends an episode near the box."""
        return near_goal(self.box)

    def targets(self) -> tuple[Entity, ...]:
        """Return the box."""
        return (self.box,)

    def shortest_path(self) -> Sequence[int] | None:
        """Return turns and steps to a place near the box; () if none were found."""
        return plan(self, self.box) or ()

    def path_length_bounds(self) -> PathLengthBounds:
        """Return a lower bound, and the length of the planned path or None if none was found."""
        path = self.shortest_path()
        return PathLengthBounds(least_steps(self, self.box), len(path) if path else None)


class OneRoom(GoalEnv):
    """A square room of ``size`` metres with a red box."""

    def __init__(self, *, size: float = 10, max_steps: int | None = 180, **options: Any) -> None:
        self.size = check_number("size", size, 2, MAX_METRES)
        super().__init__(max_steps=max_steps, **options)

    def build(self) -> None:
        """Build the room, and place the box and the agent."""
        self.add_rect_room(min_x=0, max_x=self.size, min_z=0, max_z=self.size)
        self.box = self.place_entity(Box("red"))
        self.place_agent()


def _make_thing(kind: int, colour: str) -> Entity:
    """Return an entity of a kind, given by its number: 0 for a ball, 1 for a box, 2 for a key."""
    if kind == 0:
        return Ball(colour, 0.9)
    if kind == 1:
        return Box(colour, 0.9)
    return Key(colour)


class PickupObjects(FirstPersonEnv):
    """An open yard of ``size`` metres with ``num_objs`` things; each one that is picked up earns 1 and disappears."""

    def __init__(self, *, size: float = 12, num_objs: int = 5, max_steps: int | None = 400, **options: Any) -> None:
        self.size = check_number("size", size, 2, MAX_METRES)
        self.num_objs = check_whole("num_objs", num_objs, 1, 100)
        super().__init__(max_steps=max_steps, actions=ACTIONS[:5], **options)

    def build(self) -> None:
        """Build the yard, with balls, boxes and keys of random colours."""
        self.add_rect_room(min_x=0, max_x=self.size, min_z=0, max_z=self.size, **_YARD)
        for _ in range(self.num_objs):
            kind = self.np_random.integers(3)
            colour = _any_colour(self)
            self.place_entity(_make_thing(int(kind), colour))
        self.place_agent()
        self.num_picked_up = 0

    def termination_rule(self) -> TerminationRule:
        """Return the rule that ends an episode when all things are picked up."""
        return pick_up_all(self.num_objs, score="num_picked_up")

    def targets(self) -> tuple[Entity, ...]:
        """Return the things that the agent has not picked up yet."""
        return tuple(thing for thing in self.entities if thing is not self.agent)

    def shortest_path(self) -> Sequence[int] | None:
        """Return a plan that picks up every thing, the nearest one first; () if none was found."""
        return plan_take_all(self, lambda: list(self.targets())) or ()


class PutNext(FirstPersonEnv):
    """A room with a box of each colour, in which the red box must be put next to the yellow one."""

    def __init__(self, *, size: float = 12, max_steps: int | None = 250, **options: Any) -> None:
        self.size = check_number("size", size, 2, MAX_METRES)
        super().__init__(max_steps=max_steps, **options)

    def build(self) -> None:
        """Build the room, with boxes of slightly different sizes."""
        self.add_rect_room(min_x=0, max_x=self.size, min_z=0, max_z=self.size)
        boxes = {colour: self.place_entity(Box(colour, uniform(self.np_random, 0.6, 0.85))) for colour in COLOUR_NAMES}
        self.red_box = boxes["red"]
        self.yellow_box = boxes["yellow"]
        self.place_agent()

    def termination_rule(self) -> TerminationRule:
        """Return the rule that ends an episode when the red and yellow boxes are adjacent and nothing is carried."""
        return put_next(self.red_box, self.yellow_box)

    def targets(self) -> tuple[Entity, ...]:
        """Return the red box and the yellow one."""
        return (self.red_box, self.yellow_box)

    def shortest_path(self) -> Sequence[int] | None:
        """Return a plan to the red box and, carrying it, to the yellow one; () if none was found."""
        return plan_put_next(self, self.red_box, self.yellow_box) or ()


class RoomObjects(FirstPersonEnv):
    """An open yard with a box, a ball and a key to look at, without rewards and without an end."""

    def __init__(self, *, size: float = 10, max_steps: int | None = None, **options: Any) -> None:
        self.size = check_number("size", size, 2, MAX_METRES)
        super().__init__(max_steps=max_steps, **options)

    def build(self) -> None:
        """Build the yard; the agent is wide, so that it starts and stays well away from the things."""
        self.add_rect_room(min_x=0, max_x=self.size, min_z=0, max_z=self.size, **_YARD)
        self.agent.radius = 1.5
        self.place_entity(Box(_any_colour(self), 0.9))
        self.place_entity(Ball(_any_colour(self), 0.9))
        self.place_entity(Key(_any_colour(self)))
        self.place_agent()


class CollectHealth(FirstPersonEnv):
    """A room of slime that costs 2 health per step, with 18 medical kits that each restore the health to 100."""

    def __init__(self, *, size: float = 16, max_steps: int | None = 1000, **options: Any) -> None:
        self.size = check_number("size", size, 2, MAX_METRES)
        super().__init__(max_steps=max_steps, **options)

    def build(self) -> None:
        """Build the room, and place the kits and the agent."""
        self.add_rect_room(min_x=0, max_x=self.size, min_z=0, max_z=self.size, wall="cinder_blocks", floor="slime")
        for _ in range(_N_KITS):
            self.place_entity(Mesh("medkit", 0.40, static=False))
        self.place_agent()
        self.health = 100

    def termination_rule(self) -> TerminationRule:
        """Return the rule that pays 2 per step alive and -100 for dying, and relocates each kit that is picked up."""
        return stay_alive(score="health", cost=2.0, full=100.0, reward=2.0, penalty=-100.0)

    def info(self) -> dict[str, Any]:
        """Return the remaining health."""
        return {"health": self.health}


_YARD = {"wall": "brick_wall", "floor": "asphalt", "ceiling": None}
_N_KITS = 18


def _any_colour(world: FirstPersonEnv) -> str:
    """Return the name of a colour, drawn from the world's random stream."""
    return COLOUR_NAMES[world.np_random.integers(len(COLOUR_NAMES))]
