"""Level: a function over verbs, traced once into a program, and the recipe of its world."""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from minihuman.errors import WorldError
from minihuman.worlds.grid.core.chance import Words
from minihuman.worlds.grid.core.state import Row
from minihuman.worlds.grid.instructions.block import OWN_STEPS, SAY_DONE
from minihuman.worlds.grid.instructions.language import Instruction, parse
from minihuman.worlds.grid.instructions.numbers import to_numbers
from minihuman.worlds.grid.instructions.space import InstructionSpace
from minihuman.worlds.grid.levels.program import Given, Program, furnish
from minihuman.worlds.grid.levels.tracing import AnyOf, House
from minihuman.worlds.grid.recipe import Recipe
from minihuman.worlds.options import one_of, whole

MOST_CELLS = 4095  # what a planner's node can number
NO_MISSION: Given = np.zeros(0, np.int64)

Trace = Callable[..., Instruction | AnyOf | None]


@dataclass(frozen=True, slots=True, kw_only=True)
class LevelRecipe(Recipe):
    """A level's recipe: its layout carries the program out, its mission is an instruction."""

    program: Program
    given: Given

    def lay_out(self, row: Row, words: Words) -> None:
        """Lay an episode out into a cleared row."""
        furnish(row, words, self.program, self.given)

    def limited(self, max_steps: int) -> "LevelRecipe":
        """The recipe of the same level with this step limit in every episode."""
        program = self.program.copy()
        program[0, 3] = 0
        return replace(self, max_steps=max_steps, program=program)

    def about(self, mission: str) -> "LevelRecipe":
        """The recipe of the same level with a mission set by hand.

        Raises:
            WorldError: if the sentence is none of the language.
        """
        if not isinstance(mission, str):
            raise WorldError(f"mission is {mission!r}; it is a sentence")
        said = parse(mission)
        assert isinstance(self.mission, InstructionSpace)
        if not self.mission.admits(said):
            raise WorldError(f"mission {mission!r} is none of {self.mission}; make the world with any_mission=True")
        return replace(self, given=to_numbers(said))


@dataclass(frozen=True, slots=True)
class Level:
    """A level: call it with its options for a recipe. `level` makes one of a function."""

    trace: Trace
    sizes: Mapping[str, int]  # room_size, num_cols, num_rows
    fixed: tuple[str, ...]  # which of them no option changes
    steps_by_area: int  # a step limit of so many times the room's area; 0: by the rooms and the mission

    @property
    def __name__(self) -> str:
        """The level's name, as the catalogue has it."""
        return self.trace.__name__

    def __call__(
        self,
        *,
        own_steps: bool = False,
        done_required: bool = False,
        mission: str | None = None,
        any_mission: bool = False,
        **options: Any,
    ) -> LevelRecipe:
        """The recipe of the level with these options.

        Args:
            own_steps: Judge each part of an instruction by its own steps, and by where things are.
            done_required: A clause ends when "done" is said right after it was done.
            mission: Set the mission of every episode by hand.
            any_mission: Let `reset` set any mission of the language, not only those that the level draws.
            options: room_size, num_rows and num_cols where they are free, and what the level's function takes.

        Raises:
            WorldError: if there is no such option, or a value is out of range.
        """
        for name, value in (("own_steps", own_steps), ("done_required", done_required), ("any_mission", any_mission)):
            one_of(name, value, (True, False))
        sizes = dict(self.sizes)
        for name in sizes.keys() & options.keys():
            if name in self.fixed:
                raise WorldError(f"{self.__name__} has a fixed {name}, {sizes[name]}; leave it out")
            sizes[name] = whole(name, options.pop(name), *((3, 64) if name == "room_size" else (1, 32)))
        known = inspect.signature(self.trace).parameters
        for name in options:
            if name not in known:
                free = [*(name for name in sizes if name not in self.fixed), *list(known)[1:]]
                raise WorldError(f"{self.__name__} takes no {name!r}; it takes {', '.join(free) or 'none'}")
        for name, parameter in list(known.items())[1:]:
            if parameter.default is parameter.empty and name not in options:
                raise WorldError(f"{self.__name__} needs {name}; say it")
        size, columns, lines = sizes["room_size"], sizes["num_cols"], sizes["num_rows"]
        width, height = (size - 1) * columns + 1, (size - 1) * lines + 1
        if width * height > MOST_CELLS:
            raise WorldError(
                f"{columns} x {lines} rooms of {size} make {width * height} cells; {MOST_CELLS} is the most"
            )
        house = House(columns, lines, size)
        house.finish(self.trace(house, **options))
        steps = self.steps_by_area * size * size
        walk = size * size * columns * lines
        flags = own_steps * OWN_STEPS | done_required * SAY_DONE
        recipe = LevelRecipe(
            layout=furnish,
            numbers=(),
            width=width,
            height=height,
            max_steps=steps or walk,
            mission=house.space(any_mission=any_mission or mission is not None),
            program=house.program(0 if steps else walk, flags=flags),
            given=NO_MISSION,
        )
        return recipe if mission is None else recipe.about(mission)


def level(
    *,
    room: int = 8,
    columns: int = 3,
    lines: int = 3,
    fixed: tuple[str, ...] = (),
    steps_by_area: int = 0,
) -> Callable[[Trace], Level]:
    """Make a level of a function that furnishes a house and returns the instruction.

    Args:
        room: Cells on a side of a room, walls included.
        columns: Rooms in a line.
        lines: Lines of rooms.
        fixed: Which of room_size, num_cols and num_rows no option may change.
        steps_by_area: The step limit in areas of a room; by the rooms and the mission's walks without.
    """

    def make(trace: Trace) -> Level:
        sizes = {"room_size": room, "num_cols": columns, "num_rows": lines}
        return Level(trace, sizes, fixed, steps_by_area)

    return make
