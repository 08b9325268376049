"""GoToObj in 3D: a square room with an object at the middle of each wall, of which one is the target."""

import math
from collections.abc import Sequence
from typing import Any

from minihuman.worlds.contract import PathLengthBounds, search_first_success
from minihuman.worlds.first_person.entities import Ball, Box, Entity, Key
from minihuman.worlds.first_person.env import FirstPersonEnv, TerminationRule, face
from minihuman.worlds.first_person.parameters import DEFAULTS
from minihuman.worlds.first_person.rules import MOVES
from minihuman.worlds.go_to_obj import draw_arrangement
from minihuman.worlds.options import MAX_METRES, check_number


class GoToObj(FirstPersonEnv):
    """The target world of the transfer experiment, whose defaults are those of the published world.

    The agent starts in the middle, facing +x. It succeeds when the point ``reach_m`` ahead of it is within
    ``tolerance_m`` of the target, and earns ``1 - 0.2 * step / max_steps``.

    Args:
        size: the length of a wall in metres; objects stand a tenth of it from the walls
        step_m: the length of a step in metres
        turn_deg: the angle of a turn in degrees
        reach_m: the distance ahead of the agent at which the target must be, in metres
        tolerance_m: the largest distance between that point and the target, in metres
        lift_m: the height of agent and objects above the floor in metres
        object_m: the size of boxes and balls in metres
        max_steps: the number of steps after which an episode is truncated
        actions: the names of the actions; by a mistake, the published agent also had the next four of `rules.ACTIONS`
        options: further settings of `FirstPersonEnv`
    """

    def __init__(
        self,
        *,
        size: float = 9.0,
        step_m: float = 0.9,
        turn_deg: float = 90.0,
        reach_m: float = 0.8,
        tolerance_m: float = 0.2,
        lift_m: float = 0.5,
        object_m: float = 0.5,
        max_steps: int = 100,
        actions: tuple[str, ...] = MOVES,
        **options: Any,
    ) -> None:
        self.size = float(check_number("size", size, 5, MAX_METRES))  # four objects, and space to turn
        self.reach_m = check_number("reach_m", reach_m, 0, MAX_METRES)
        self.tolerance_m = check_number("tolerance_m", tolerance_m, 0, MAX_METRES)
        self.lift_m = check_number("lift_m", lift_m, 0, 100)
        self.object_m = check_number("object_m", object_m, 0.01, 10)
        options = {"parameters": DEFAULTS.fixed(forward_step=step_m, turn_step=turn_deg)} | options
        super().__init__(max_steps=max_steps, actions=tuple(actions), **options)

    def build(self) -> None:
        """Build the room, and place the objects and the agent."""
        middle = self.size / 2
        near = self.size / 10
        far = self.size * 9 / 10
        places = ((near, middle), (middle, far), (far, middle), (middle, near))  # in the order of WALLS
        arrangement = draw_arrangement(self.np_random)
        self.add_rect_room(min_x=0, max_x=self.size, min_z=0, max_z=self.size)
        placed = [
            self.place_entity(self._make_object(colour, kind), pos=(x, self.lift_m, z), dir=number * math.pi / 2)
            for number, ((colour, kind), (x, z)) in enumerate(zip(arrangement.objects, places, strict=True))
        ]
        self.target: Entity = placed[arrangement.target]
        self.mission = arrangement.mission
        self.place_agent(pos=(middle, self.lift_m, middle), dir=0.0)

    def termination_rule(self) -> TerminationRule:
        """Return the rule that ends an episode when the target is just ahead."""
        return face(self.target, reach_m=self.reach_m, tolerance_m=self.tolerance_m)

    def targets(self) -> tuple[Entity, ...]:
        """Return the target object."""
        return (self.target,)

    def shortest_path(self) -> Sequence[int] | None:
        """Return the fewest turns and steps to a place where the target is just ahead; () if none were found."""
        names = ("turn_left", "turn_right", "move_forward")
        actions = search_first_success(
            self, [self.action_names.index(name) for name in names if name in self.action_names]
        )
        return actions or ()

    def path_length_bounds(self) -> PathLengthBounds:
        """Return the length of the shortest path as both bounds; None for both if no path was found."""
        path = self.shortest_path()
        length = len(path) if path else None
        return PathLengthBounds(length, length)

    def _make_object(self, colour: str, kind: str) -> Entity:
        """Return an object of a colour and a kind: "ball", "box" or "key"."""
        match kind:
            case "ball":
                return Ball(colour, self.object_m)
            case "box":
                return Box(colour, self.object_m)
            case _:
                return Key(colour)
