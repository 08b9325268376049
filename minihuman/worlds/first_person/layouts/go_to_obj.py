"""GoToObj in 3D: a square room with four objects at the middles of its walls; stand before the one that is named."""

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
    """The target world of the transfer experiment; every default is a fact of the published one.

    The agent starts in the middle, facing +x. It succeeds when the point ``reach_m`` ahead of it is within
    ``tolerance_m`` of the target, and earns ``1 - 0.2 * step / max_steps``.

    Args:
        size: Length of a wall in metres; objects stand a tenth of it from the walls.
        step_m: How far one step goes.
        turn_deg: How far one turn turns.
        reach_m: How far ahead the target has to be.
        tolerance_m: How exactly.
        lift_m: How high above the floor agent and objects are.
        object_m: Size of boxes and balls.
        max_steps: Steps after which an episode is truncated.
        actions: Names of the actions; the published agent could also do the next four of `rules.ACTIONS` by a mistake.
        options: `FirstPersonEnv`'s settings.
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
        """Lay out the room, the objects and the agent."""
        middle = self.size / 2
        near = self.size / 10
        far = self.size * 9 / 10
        places = ((near, middle), (middle, far), (far, middle), (middle, near))  # in the order of WALLS
        arrangement = draw_arrangement(self.np_random)
        self.add_rect_room(min_x=0, max_x=self.size, min_z=0, max_z=self.size)
        placed = [
            self.place_entity(self._make(colour, kind), pos=(x, self.lift_m, z), dir=number * math.pi / 2)
            for number, ((colour, kind), (x, z)) in enumerate(zip(arrangement.objects, places, strict=True))
        ]
        self.target: Entity = placed[arrangement.target]
        self.mission = arrangement.mission
        self.place_agent(pos=(middle, self.lift_m, middle), dir=0.0)

    def termination_rule(self) -> TerminationRule:
        """End where the target is just ahead."""
        return face(self.target, reach_m=self.reach_m, tolerance_m=self.tolerance_m)

    def targets(self) -> tuple[Entity, ...]:
        """Return the object to go to."""
        return (self.target,)

    def shortest_path(self) -> Sequence[int] | None:
        """Return the shortest list of turns and steps to where the target is just ahead."""
        names = ("turn_left", "turn_right", "move_forward")
        actions = search_first_success(
            self, [self.action_names.index(name) for name in names if name in self.action_names]
        )
        return actions or ()

    def path_length_bounds(self) -> PathLengthBounds:
        """Return the length of that path as both bounds."""
        count = len(self.shortest_path() or ()) or None
        return PathLengthBounds(count, count)

    def _make(self, colour: str, kind: str) -> Entity:
        match kind:
            case "ball":
                return Ball(colour, self.object_m)
            case "box":
                return Box(colour, self.object_m)
            case _:
                return Key(colour)
