"""LevelBuilder: the object that a level's function receives. Its calls are traced once and become a program.

`level` turns such a function into the recipe of a world. Tracing draws no random numbers: every reset runs the program.
"""

import inspect
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import ceil
from typing import Any

import numpy as np

from minihuman.errors import WorldError
from minihuman.worlds.colours import COLOURS
from minihuman.worlds.grid.babyai import encoding, level_program
from minihuman.worlds.grid.babyai.encoding import to_numbers
from minihuman.worlds.grid.babyai.instruction_space import VERBS, InstructionSpace
from minihuman.worlds.grid.babyai.language import (
    PLACES,
    After,
    Before,
    Instruction,
    ObjectDescription,
    PutNext,
    clauses,
    parse,
    parts,
)
from minihuman.worlds.grid.babyai.level_program import IN_REGISTER, REGISTERS, USE, WIDE, Given, Program, furnish
from minihuman.worlds.grid.babyai.level_rooms import BOTH, ONE, SEQUENCE
from minihuman.worlds.grid.babyai.level_values import AnyOf, ObjectGroup, ObjectRef, RandomVariable, Use
from minihuman.worlds.grid.core.cells import KINDS
from minihuman.worlds.grid.core.state import Row
from minihuman.worlds.grid.layout import Recipe
from minihuman.worlds.grid.layouts.room_grid import DOWN, LEFT, RIGHT, UP
from minihuman.worlds.options import check_bool, check_whole
from minihuman.worlds.rng import RngState

WALLS = {"right": RIGHT, "down": DOWN, "left": LEFT, "up": UP}
ACTIONS = {"goto": encoding.GO_TO, "open": encoding.OPEN, "pickup": encoding.PICK_UP, "putnext": encoding.PUT_NEXT}
SENTENCES = {"action": ONE, "and": BOTH, "seq": SEQUENCE}
_WORDS = {encoding.VERBS[verb]: words for words, verb in VERBS.items()}


class LevelBuilder:
    """A grid of equal rooms to furnish. The agent stands in the middle room until it is placed.

    The method `room` returns a room. If a method receives None for a room, wall, kind, colour or lock, it is drawn in
    each episode.
    """

    def __init__(self, columns: int, lines: int, size: int) -> None:
        self.columns = columns
        self.lines = lines
        self.size = size
        self._operations: list[list[int]] = []
        self._registers = 0
        self._verbs: set[str] = set()
        self._places = False
        self._clauses = 1
        self.keys_matter = False  # draw again where the instruction is about a key that opens a locked door

    def room(self, column: "int | RandomVariable", line: "int | RandomVariable") -> RandomVariable:
        """Return the room at a column and a line, both counted from 0; raise a WorldError if there is no such room."""
        for name, value, count in (("column", column, self.columns), ("line", line, self.lines)):
            if isinstance(value, int) and not 0 <= value < count:
                raise WorldError(
                    f"this level needs a room in {name} {value}, but has {count}, counted from 0; give it more rooms"
                )
        return self._record(level_program.ROOM_AT, column, line)

    def integer(self, low: int, high: int) -> RandomVariable:
        """Return a whole number in [low, high) that is drawn in each episode."""
        return self._record(level_program.INTEGER, low, high)

    def any_room(self) -> RandomVariable:
        """Return a room that is drawn in each episode: its column, then its line."""
        column = self.integer(0, self.columns)
        return self.room(column, self.integer(0, self.lines))

    def choice(self, options: Any) -> Any:
        """Return an object drawn from a group, or one of up to seven words of one type (colours, places or kinds)."""
        if isinstance(options, list):  # of objects that were made one after the other
            options = ObjectGroup(options[0], options[-1])
        if isinstance(options, ObjectGroup):
            return self._record_object(level_program.ONE_FROM, options.first, options.last)
        numbers = [_number(option) for option in options]
        return self._record(level_program.OUT_OF, len(numbers), *numbers)

    def two_of(self, options: "ObjectGroup | Sequence[ObjectRef]") -> tuple[ObjectRef, ObjectRef]:
        """Return two different objects drawn from a group, or from a sequence of objects made one after the other."""
        if isinstance(options, ObjectGroup):
            group = options
        else:
            group = ObjectGroup(options[0], options[-1])
        register = self._record(level_program.TWO_FROM, group.first, group.last, registers=2).argument - IN_REGISTER
        return ObjectRef(register), ObjectRef(register + 1)

    def colours(self, count: int) -> tuple[RandomVariable, ...]:
        """Return ``count`` different colours that are drawn in each episode."""
        first = self._record(level_program.TWO_COLOURS, count, registers=count).argument
        return tuple(RandomVariable(first + k) for k in range(count))

    def place_agent(self, room: RandomVariable | None = None, *, not_in: RandomVariable | None = None) -> None:
        """Place the agent in a room, or a random one but ``not_in``, so that it faces an empty cell or a wall."""
        self._record(level_program.AGENT_IN, _number_or_drawn(room), _number_or_drawn(not_in), registers=0)

    def connect_all(self, *, without: Any = None) -> None:
        """Add closed doors until all rooms are connected.

        If a colour ``without`` is given, none of the doors has it in half of the episodes.
        """
        self._record(level_program.JOIN_ROOMS, _number_or_drawn(without), int(without is not None), registers=0)

    def door(
        self, room: RandomVariable, wall: str | None = None, *, colour: Any = None, locked: bool | None = None
    ) -> ObjectRef:
        """Put a door into a wall (right, down, left, up) of a room, closed or ``locked``; return a reference to it."""
        at = -1 if wall is None else WALLS[wall]
        return self._record_object(
            level_program.DOOR_IN, room, at, _number_or_drawn(colour), -1 if locked is None else int(locked)
        )

    def remove_wall(self, room: RandomVariable, wall: str) -> None:
        """Remove the wall between a room and its neighbour."""
        self._record(level_program.REMOVE_WALL, room, WALLS[wall], registers=0)

    def thing(self, room: RandomVariable, kind: str | None = None, colour: Any = None) -> ObjectRef:
        """Put a key, ball or box into a room; return a reference to it."""
        return self._record_object(level_program.OBJECT_IN, room, _number_or_drawn(kind), _number_or_drawn(colour))

    def rooms(self) -> Iterator[RandomVariable]:
        """Yield all rooms, column by column."""
        for column in range(self.columns):
            for line in range(self.lines):
                yield self.room(column, line)

    def four_doors(self, room: RandomVariable, *, locked: bool | None = None) -> list[ObjectRef]:
        """Put a door into each wall of a room; return references to them."""
        return [self.door(room, locked=locked) for _ in range(4)]

    def things(
        self,
        count: int,
        room: RandomVariable | None = None,
        *,
        different: bool = False,
        but_not_in: RandomVariable | None = None,
    ) -> ObjectGroup:
        """Put ``count`` random keys, balls and boxes into a room, or each into a random room; return their group.

        With ``different``, no two objects of the layout are alike. If ``room`` is ``but_not_in``, none is put.
        """
        if different and count > 3 * len(COLOURS):
            raise WorldError(
                f"{count} objects cannot all differ; there are {3 * len(COLOURS)} pairs of kind and colour, so ask for "
                "fewer"
            )
        variable = self._record(
            level_program.OBJECTS_IN,
            _number_or_drawn(room),
            count,
            int(different),
            _number_or_drawn(but_not_in),
            registers=2,
        )
        register = variable.argument - IN_REGISTER
        return ObjectGroup(ObjectRef(register), ObjectRef(register + 1))

    def any_door(self) -> ObjectRef:
        """Return a reference to one of the doors, drawn in each episode."""
        return self._record_object(level_program.ANY_DOOR)

    def recolour(self, group: ObjectGroup, colour: str) -> None:
        """Give all objects of a group another colour."""
        self._record(level_program.RECOLOUR, group.first, group.last, _number(colour), registers=0)

    def open_all_doors(self) -> None:
        """Open every door."""
        self._record(level_program.OPEN_DOORS, registers=0)

    def require_reachable(self, reachable: bool = True) -> None:
        """Reject the layout unless all objects are (if ``reachable`` is False: not all are) in reach through doors."""
        self._record(level_program.IN_REACH, int(not reachable), registers=0)

    def require_no(self, group: ObjectGroup, kind: str, colour: str) -> None:
        """Reject the layout if an object of the group has the given kind and colour."""
        self._record(level_program.NONE_LIKE, group.first, group.last, _number(kind), _number(colour), registers=0)

    def require_other(self, thing: RandomVariable, other: RandomVariable) -> None:
        """Reject the layout if two variables, such as rooms, are equal in an episode."""
        self._record(level_program.GIVE_UP_UNLESS, thing, other, registers=0)

    def maybe_locked_room(self, chance: float) -> RandomVariable:
        """Lock a random room with a probability, and put its key into another; return the room, -1 if none is."""
        if isinstance(chance, bool) or not isinstance(chance, int | float) or not 0 <= chance <= 1:
            raise WorldError(f"locked_room_prob is {chance!r}; use a probability from 0 to 1")
        return self._record(level_program.LOCK_ROOM, ceil(chance * 2**53))  # draws are multiples of 2**-53

    def block(self, door: ObjectRef) -> ObjectRef:
        """Put a ball of a random colour into the cell to the left of a door; return a reference to the ball."""
        return self._record_object(level_program.BLOCK_DOOR, door)

    def boxed_key(self, room: RandomVariable, colour: Any) -> ObjectRef:
        """Put a box that contains a key into a room; return a reference to the box."""
        return self._record_object(level_program.BOXED_KEY, room, colour)

    def maybe_swap(self, thing: ObjectRef, other: ObjectRef) -> tuple[ObjectRef, ObjectRef]:
        """Swap what two references stand for, with probability 1/2 in each episode; return both."""
        self._record(level_program.SWAP, thing, other, registers=0)
        return thing, other

    def give(self, thing: ObjectRef) -> None:
        """Let the agent carry an object from the first step on."""
        self._record(level_program.HAND, thing, registers=0)

    def one_of(self, *alternatives: Any) -> AnyOf:
        """Return a choice of several instructions, of which one is drawn in each episode.

        An alternative may be a function that returns the instruction; its random draws are made only if it is chosen.
        """
        return AnyOf(self.integer(0, len(alternatives)), alternatives)

    def invent(
        self,
        actions: Sequence[str],
        kinds: Sequence[str],
        *,
        places: bool,
        implicit_unlock: bool,
        locked_room: RandomVariable,
    ) -> None:
        """Draw a whole instruction about the objects in the rooms; the options are those of `levels.level_gen`."""
        for name, words, allowed in (("action_kinds", actions, ACTIONS), ("instr_kinds", kinds, SENTENCES)):
            if isinstance(words, str) or not 1 <= len(words) <= 4 or any(word not in allowed for word in words):
                raise WorldError(f"{name} is {words!r}; give one to four of {', '.join(allowed)}")
        packed_lists = (_pack([ACTIONS[word] for word in actions]), _pack([SENTENCES[word] for word in kinds]))
        self._record(level_program.INVENT, *packed_lists, int(places), int(implicit_unlock), locked_room, registers=0)
        self._verbs |= {_WORDS[ACTIONS[word]] for word in actions}
        self._places |= places
        self._clauses = max(self._clauses, *({"action": 1, "and": 2, "seq": 4}[word] for word in kinds))

    def finish(self, instruction: "Instruction | AnyOf | None") -> None:
        """Add to the program the instruction that the level's function returned; None adds nothing."""
        if isinstance(instruction, AnyOf):
            for k, alternative in enumerate(instruction.alternatives):
                skip = len(self._operations)
                self._record(level_program.SKIP_UNLESS, instruction.selected, k, 0, registers=0)
                self.finish(alternative() if callable(alternative) else alternative)
                self._operations[skip][4] = len(self._operations) - skip - 1  # how many operations to skip
        elif instruction is not None:
            self._record_instruction(instruction)

    def _record_instruction(self, instruction: Instruction) -> None:
        """Record the operations that write an instruction, and what the mission space must admit for it."""
        spoken = clauses(instruction)
        self._clauses = max(self._clauses, len(spoken))
        for k, clause in enumerate(spoken):
            if isinstance(clause, Use):
                verb = USE
            else:
                verb = encoding.VERBS[type(clause)]
            self._verbs |= {"open", "pick up"} if verb == USE else {_WORDS[verb]}
            self._record(
                level_program.SAY,
                k,
                verb,
                *self._encode_description(clause.thing),
                int(getattr(clause, "strict", False)),
                registers=0,
            )
            if isinstance(clause, PutNext):
                self._record(level_program.SAY_OTHER, k, *self._encode_description(clause.other), registers=0)
        counts = [len(clauses(part)) for part in parts(instruction)]
        strict = isinstance(instruction, Before | After) and instruction.strict
        self._record(
            level_program.ARRANGE,
            encoding.JOINS.get(type(instruction), encoding.ALONE),
            counts[0],
            counts[1] if len(counts) > 1 else 0,
            encoding.IN_ORDER_STRICTLY if strict else 0,
            registers=0,
        )

    def _encode_description(self, thing: ObjectDescription) -> tuple[int, int, int]:
        """Return a description's kind, colour and place as arguments, ANY for None; record whether it has a place."""
        self._places |= thing.place is not None
        return (
            encoding.ANY if thing.kind is None else _number(thing.kind),
            encoding.ANY if thing.colour is None else _number(thing.colour),
            encoding.ANY if thing.place is None else _number(thing.place),
        )

    def space(self, *, any_mission: bool = False) -> InstructionSpace:
        """Return the space of the sentences that this level can draw; with ``any_mission``, of the whole language."""
        if any_mission or not self._verbs:
            return InstructionSpace()
        return InstructionSpace(*self._verbs, places=self._places, clauses=self._clauses)

    def program(self, steps_a_walk: int, *, flags: int) -> Program:
        """Return the traced program.

        Args:
            steps_a_walk: the number of steps that the limit allows per walk of the mission; 0 for a fixed limit.
            flags: the flags of every instruction of the level, OWN_STEPS and SAY_DONE.
        """
        settings = [self.columns, self.lines, self.size, steps_a_walk, int(self.keys_matter), flags]
        table = np.zeros((1 + len(self._operations), WIDE), np.int64)
        table[0, : len(settings)] = settings
        for line, numbers in zip(table[1:], self._operations, strict=True):
            line[: len(numbers)] = numbers
        return table

    def _record_object(self, operation: int, *arguments: Any) -> ObjectRef:
        """Record an operation whose result is an object's identity; return the reference to this object."""
        return ObjectRef(self._record(operation, *arguments).argument - IN_REGISTER)

    def _record(self, operation: int, *arguments: Any, registers: int = 1) -> RandomVariable:
        """Record an operation that writes ``registers`` registers; return the variable of the first of them."""
        out = self._registers
        self._registers += registers
        if operation == level_program.ROOM_AT and all(isinstance(argument, int) for argument in arguments):
            self._registers -= 1  # a room with a fixed number needs no register
            return RandomVariable(arguments[1] * self.columns + arguments[0])
        if self._registers > REGISTERS:
            raise WorldError(f"a level draws more than {REGISTERS} values; draw fewer")
        self._operations.append([operation, out, *(_number(argument) for argument in arguments)])
        return RandomVariable(IN_REGISTER + out)


def _number(value: Any) -> int:
    """Return an argument as a number; a word becomes its index in the table of its type."""
    if isinstance(value, RandomVariable):
        return value.argument
    if isinstance(value, ObjectRef):
        return IN_REGISTER + value.register
    if isinstance(value, str):
        for table in (COLOURS, KINDS, PLACES):
            if value in table:
                return table.index(value)
        raise WorldError(
            f"{value!r} is not a colour, kind or place; use one of {', '.join((*COLOURS, *KINDS, *PLACES))}"
        )
    return int(value)


def _number_or_drawn(value: Any) -> int:
    """Return an argument as a number, or -1 for None: it is drawn in each episode."""
    return -1 if value is None else _number(value)


def _pack(numbers: Sequence[int]) -> int:
    """Return up to four numbers below 16 as one: their count in the lowest four bits, then four bits per number."""
    return len(numbers) | sum(number << 4 * (k + 1) for k, number in enumerate(numbers))


MAX_LEVEL_CELLS = 4095  # the number of cells that a planner's node can address
NO_MISSION: Given = np.zeros(0, np.int64)

Trace = Callable[..., Instruction | AnyOf | None]


@dataclass(frozen=True, slots=True, kw_only=True)
class LevelRecipe(Recipe):
    """The recipe of a level, whose layout runs the program and whose mission is an instruction."""

    program: Program
    fixed_mission: Given

    def lay_out(self, row: Row, rng_state: RngState) -> None:
        """Lay out an episode in a cleared row."""
        furnish(row, rng_state, self.program, self.fixed_mission)

    def limited(self, max_steps: int) -> "LevelRecipe":
        """Return the recipe of the same level with the step limit ``max_steps`` for every episode."""
        program = self.program.copy()
        program[0, level_program.STEPS_A_WALK] = 0
        return replace(self, max_steps=max_steps, program=program)

    def about(self, mission: str) -> "LevelRecipe":
        """Return the recipe of the same level with the given mission in every episode.

        Raises:
            WorldError: if the sentence does not belong to the language or to the level's mission space.
        """
        if not isinstance(mission, str):
            raise WorldError(f"mission is {mission!r}; it must be a string")
        instruction = parse(mission)
        assert isinstance(self.mission, InstructionSpace)
        if not self.mission.admits(instruction):
            raise WorldError(f"mission {mission!r} is not one of {self.mission}; make the world with any_mission=True")
        return replace(self, fixed_mission=to_numbers(instruction))


@dataclass(frozen=True, slots=True)
class Level:
    """A level. Calling it with options returns its recipe. `level` makes one from a function."""

    trace: Trace
    sizes: Mapping[str, int]  # room_size, num_cols, num_rows
    fixed: tuple[str, ...]  # those of the sizes that no option may change
    steps_by_area: int  # the step limit, times a room's area; 0 if it depends on the rooms and the mission

    @property
    def __name__(self) -> str:
        """Return the name of the level's function."""
        return self.trace.__name__

    def _check_options(self, options: Mapping[str, Any]) -> None:
        """Raise a WorldError unless the level's function takes all options, and no required option is missing."""
        parameters = inspect.signature(self.trace).parameters  # the first one is the builder
        for name in options:
            if name not in parameters:
                free = [*(size for size in self.sizes if size not in self.fixed), *list(parameters)[1:]]
                raise WorldError(f"{self.__name__} has no option {name!r}; its options are {', '.join(free) or 'none'}")
        for name, parameter in list(parameters.items())[1:]:
            if parameter.default is parameter.empty and name not in options:
                raise WorldError(f"{self.__name__} needs the option {name}; pass it")

    def __call__(
        self,
        *,
        own_steps: bool = False,
        done_required: bool = False,
        mission: str | None = None,
        any_mission: bool = False,
        **options: Any,
    ) -> LevelRecipe:
        """Return the recipe of the level with these options.

        Args:
            own_steps: whether to judge each part of an instruction by its own steps, and by where objects are.
            done_required: whether a clause is only complete when "done" is said right after it was carried out.
            mission: the mission of every episode; None to draw it.
            any_mission: whether `reset` may set any mission of the language, not only those that the level draws.
            options: room_size, num_rows and num_cols where they are not fixed, and the options of the level's function.

        Raises:
            WorldError: if there is no such option, or a value is out of range.
        """
        for name, value in (("own_steps", own_steps), ("done_required", done_required), ("any_mission", any_mission)):
            check_bool(name, value)
        sizes = dict(self.sizes)
        for name in sizes.keys() & options.keys():
            if name in self.fixed:
                raise WorldError(f"{self.__name__} has a fixed {name}, {sizes[name]}; remove this option")
            sizes[name] = check_whole(name, options.pop(name), *((3, 64) if name == "room_size" else (1, 32)))
        self._check_options(options)
        size = sizes["room_size"]
        columns = sizes["num_cols"]
        lines = sizes["num_rows"]
        width = (size - 1) * columns + 1
        height = (size - 1) * lines + 1
        if width * height > MAX_LEVEL_CELLS:
            raise WorldError(
                f"{columns} x {lines} rooms of {size} make {width * height} cells; use fewer or smaller rooms, for at "
                f"most {MAX_LEVEL_CELLS}"
            )
        builder = LevelBuilder(columns, lines, size)
        builder.finish(self.trace(builder, **options))
        fixed_limit = self.steps_by_area * size * size
        steps_a_walk = size * size * columns * lines
        flags = own_steps * encoding.OWN_STEPS | done_required * encoding.SAY_DONE
        recipe = LevelRecipe(
            layout=furnish,
            numbers=(),
            width=width,
            height=height,
            max_steps=fixed_limit or steps_a_walk,
            mission=builder.space(any_mission=any_mission or mission is not None),
            room_size=size,
            program=builder.program(0 if fixed_limit else steps_a_walk, flags=flags),
            fixed_mission=NO_MISSION,
        )
        if mission is None:
            return recipe
        return recipe.about(mission)


def level(
    *, room: int = 8, columns: int = 3, lines: int = 3, fixed: tuple[str, ...] = (), steps_by_area: int = 0
) -> Callable[[Trace], Level]:
    """Return a decorator that makes a level from a function that furnishes rooms and returns the instruction.

    Args:
        room: the number of cells on a side of a room, including its walls.
        columns: the number of rooms in a line.
        lines: the number of lines of rooms.
        fixed: those of room_size, num_cols and num_rows that no option may change.
        steps_by_area: the step limit as a multiple of a room's area; 0 for a limit that depends on the rooms and on the
            number of walks in the mission.
    """

    def make(trace: Trace) -> Level:
        sizes = {"room_size": room, "num_cols": columns, "num_rows": lines}
        return Level(trace, sizes, fixed, steps_by_area)

    return make
