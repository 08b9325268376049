"""Sign: a sign on the wall names a colour, and the observation a kind; the agent must touch the object with both."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import gymnasium

from minihuman.worlds.contract import PathLengthBounds
from minihuman.worlds.first_person.entities import Box, Entity, Key, TextFrame
from minihuman.worlds.first_person.env import FirstPersonEnv, TerminationRule, touch_right_one
from minihuman.worlds.first_person.parameters import DEFAULTS
from minihuman.worlds.first_person.pathfinding.planner import least_steps, plan
from minihuman.worlds.first_person.rules import MOVES
from minihuman.worlds.options import MAX_METRES, check_number, check_whole

_GAP = 0.25
_COLOURS = ("blue", "red", "green")


class Sign(FirstPersonEnv):
    """A U-shaped corridor with a box and a key of each of three colours (Liu et al., 2020).

    The observation is a dict: the picture under "obs", and 0 (box) or 1 (key) under "goal". Touching the thing with the
    sign's colour and the goal's kind earns 1, and touching any other -1; both end the episode. So does the action
    "done", which also steps back, as in Miniworld.
    """

    motions: ClassVar[Mapping[str, str]] = {"done": "move_back"}

    def __init__(
        self, *, size: float = 10, max_steps: int | None = 20, color_index: int = 0, goal: int = 0, **options: Any
    ) -> None:
        self.size = check_number("size", size, 5, MAX_METRES)
        self.color_index = check_whole("color_index", color_index, 0, 2)  # blue, red, green
        self.goal = check_whole("goal", goal, 0, 1)  # box, key
        options = {"parameters": DEFAULTS.fixed(forward_step=0.7, turn_step=45.0)} | options
        super().__init__(max_steps=max_steps, actions=(*MOVES, "done"), **options)
        self.observation_space = gymnasium.spaces.Dict(obs=self.observation_space, goal=gymnasium.spaces.Discrete(2))

    def build(self) -> None:
        """Build the corridor, and place the sign, the things and the agent."""
        size = self.size
        middle = self.size * 0.65
        top = self.add_rect_room(min_x=0, max_x=size, min_z=0, max_z=middle)
        left = self.add_rect_room(min_x=0, max_x=size * 3 / 5, min_z=middle + _GAP, max_z=size * 1.3)
        right = self.add_rect_room(min_x=size * 3 / 5, max_x=size, min_z=middle + _GAP, max_z=size * 1.3)
        self.connect_rooms(top, left, min_x=0, max_x=size * 3 / 5)
        self.connect_rooms(left, right, min_z=middle + _GAP, max_z=size * 1.3)
        # the things stand at fixed places (x, y, z), whatever the size of the corridor
        boxes = [
            self.place_entity(Box(colour), pos=pos)
            for colour, pos in zip(_COLOURS, ((1, 0, 1), (9, 0, 1), (9, 0, 5)), strict=True)
        ]
        keys = [
            self.place_entity(Key(colour, 0.6), pos=pos)
            for colour, pos in zip(_COLOURS, ((5, 0, 1), (1, 0, 5), (1, 0, 9)), strict=True)
        ]
        self.objects: tuple[list[Box], list[Key]] = (boxes, keys)
        self.hang(TextFrame((size, 1.35, size + _GAP), math.pi, _COLOURS[self.color_index].upper(), height=1.0))
        self.place_agent(min_x=4, max_x=5, min_z=4, max_z=6)

    def termination_rule(self) -> TerminationRule:
        """Return the rule that pays 1 for the right thing and -1 for a wrong one; the last of several near counts."""
        boxes, keys = self.objects
        first = len(boxes) if self.goal else 0
        return touch_right_one((*boxes, *keys), first + self.color_index)

    def targets(self) -> tuple[Entity, ...]:
        """Return the sign and the object that it asks for."""
        return *(thing for thing in self.entities if isinstance(thing, TextFrame)), self._goal_object()

    def shortest_path(self) -> Sequence[int] | None:
        """Return turns and steps to the object that the sign asks for, around the others; () if none were found."""
        target = self._goal_object()
        obstacles = [thing for things in self.objects for thing in things if thing is not target]
        return plan(self, target, avoid=obstacles) or ()

    def path_length_bounds(self) -> PathLengthBounds:
        """Return a lower bound, and the length of the planned path or None if none was found."""
        path = self.shortest_path()
        return PathLengthBounds(least_steps(self, self._goal_object()), len(path) if path else None)

    def _goal_object(self) -> Entity:
        """Return the thing with the sign's colour and the goal's kind."""
        boxes, keys = self.objects
        return (keys if self.goal else boxes)[self.color_index]

    def observe(self) -> Any:
        """Return the picture ("obs") and the number of the goal's kind ("goal") in a dict."""
        return {"obs": super().observe(), "goal": self.goal}
