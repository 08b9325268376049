"""House: the drawing board of a level's function. Its verbs write a program down; nothing is drawn yet."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import ceil
from typing import Any

import numpy as np

from minihuman.errors import WorldError
from minihuman.worlds.grid.core.cells import COLOURS, KINDS
from minihuman.worlds.grid.instructions.block import ALONE, ANY, GO_TO, IN_ORDER_STRICTLY, OPEN, PICK_UP, PUT_NEXT
from minihuman.worlds.grid.instructions.language import (
    PLACES,
    After,
    Before,
    Clause,
    Instruction,
    PutNext,
    Thing,
    clauses,
    parts,
)
from minihuman.worlds.grid.instructions.numbers import JOINS
from minihuman.worlds.grid.instructions.numbers import VERBS as VERB_NUMBERS
from minihuman.worlds.grid.instructions.space import VERBS, InstructionSpace
from minihuman.worlds.grid.layouts.room_grid import DOWN, LEFT, RIGHT, UP
from minihuman.worlds.grid.levels import program as operations
from minihuman.worlds.grid.levels.invent import BOTH, ONE, SEQUENCE
from minihuman.worlds.grid.levels.program import COLOUR_IN, IN_REGISTER, KIND_IN, REGISTERS, USE, WIDE, Program

WALLS = {"right": RIGHT, "down": DOWN, "left": LEFT, "up": UP}
ACTIONS = {"goto": GO_TO, "open": OPEN, "pickup": PICK_UP, "putnext": PUT_NEXT}
SENTENCES = {"action": ONE, "and": BOTH, "seq": SEQUENCE}
_WORDS = {number: words for words, verb in VERBS.items() for number in (VERB_NUMBERS[verb],)}


@dataclass(frozen=True, slots=True)
class Drawn:
    """A number that is drawn in every episode anew: an argument of later verbs."""

    argument: int


@dataclass(frozen=True, slots=True)
class Made:
    """An object that is made in every episode; its kind and colour are known then."""

    register: int

    @property
    def kind(self) -> Any:
        """Its kind."""
        return Drawn(KIND_IN + self.register)

    @property
    def colour(self) -> Any:
        """Its colour."""
        return Drawn(COLOUR_IN + self.register)

    @property
    def thing(self) -> Thing:
        """The description by kind and colour."""
        return Thing(self.kind, self.colour)


@dataclass(frozen=True, slots=True)
class Group:
    """Objects made one after the other."""

    first: Made
    last: Made

    def __add__(self, doors: Sequence[Made]) -> "Group":
        """With what was made right after."""
        return Group(self.first, doors[-1])


@dataclass(frozen=True, slots=True)
class Use(Clause):
    """Open it if it is a door, pick it up otherwise."""


@dataclass(frozen=True, slots=True)
class AnyOf:
    """An instruction of several, drawn."""

    drawn: Drawn
    each: tuple[Any, ...]


class House:
    """Equal rooms to furnish; the agent stands in the middle one until it is placed.

    A room is what `room` gives; where a verb takes None for a room, a kind, a colour or a lock, it draws it.
    """

    def __init__(self, columns: int, lines: int, size: int) -> None:
        self.columns, self.lines, self.size = columns, lines, size
        self._lines: list[list[int]] = []
        self._registers = 0
        self._verbs: set[str] = set()
        self._places = False
        self._clauses = 1
        self.keys_matter = False  # draw again where the instruction is about a key that opens a locked door

    def room(self, column: "int | Drawn", line: "int | Drawn") -> Drawn:
        """A room by its place."""
        for name, value, count in (("column", column, self.columns), ("line", line, self.lines)):
            if isinstance(value, int) and not 0 <= value < count:
                raise WorldError(
                    f"this level needs a room in {name} {value}, and there are {count}; give it more rooms"
                )
        return self._do(operations.ROOM_AT, column, line)

    def integer(self, low: int, high: int) -> Drawn:
        """Draw a whole number in [low, high)."""
        return self._do(operations.INTEGER, low, high)

    def any_room(self) -> Drawn:
        """Draw a room: its column, then its line."""
        column = self.integer(0, self.columns)
        return self.room(column, self.integer(0, self.lines))

    def choice(self, options: Any) -> Any:
        """Draw an object of a group, or one of up to seven words of a kind (colours, places, kinds)."""
        if isinstance(options, list):  # of things made one after the other
            options = Group(options[0], options[-1])
        if isinstance(options, Group):
            return self._make(operations.ONE_FROM, options.first, options.last)
        numbers = [_number(option) for option in options]
        return self._do(operations.OUT_OF, len(numbers), *numbers)

    def two_of(self, options: "Group | Sequence[Made]") -> tuple[Made, Made]:
        """Draw two different objects."""
        group = options if isinstance(options, Group) else Group(options[0], options[-1])
        register = self._do(operations.TWO_FROM, group.first, group.last, registers=2).argument - IN_REGISTER
        return Made(register), Made(register + 1)

    def colours(self, count: int) -> tuple[Drawn, ...]:
        """Draw different colours."""
        first = self._do(operations.TWO_COLOURS, count, registers=count).argument
        return tuple(Drawn(first + k) for k in range(count))

    def place_agent(self, room: Drawn | None = None, *, not_in: Drawn | None = None) -> None:
        """Place the agent, looking in a drawn direction at nothing or a wall."""
        self._do(operations.AGENT_IN, _or_drawn(room), _or_drawn(not_in), registers=0)

    def connect_all(self, *, without: Any = None) -> None:
        """Add closed doors until all rooms are connected; with ``without`` in half the episodes none in that colour."""
        self._do(operations.JOIN_ROOMS, _or_drawn(without), int(without is not None), registers=0)

    def door(self, room: Drawn, wall: str | None = None, *, colour: Any = None, locked: bool | None = None) -> Made:
        """Put a door into a wall (right, down, left, up) of a room."""
        at = -1 if wall is None else WALLS[wall]
        return self._make(operations.DOOR_IN, room, at, _or_drawn(colour), -1 if locked is None else int(locked))

    def remove_wall(self, room: Drawn, wall: str) -> None:
        """Take a wall between two rooms away."""
        self._do(operations.REMOVE_WALL, room, WALLS[wall], registers=0)

    def thing(self, room: Drawn, kind: str | None = None, colour: Any = None) -> Made:
        """Put a key, ball or box into a room."""
        return self._make(operations.OBJECT_IN, room, _or_drawn(kind), _or_drawn(colour))

    def rooms(self) -> Iterator[Drawn]:
        """All rooms, column by column."""
        for column in range(self.columns):
            for line in range(self.lines):
                yield self.room(column, line)

    def four_doors(self, room: Drawn, *, locked: bool | None = None) -> list[Made]:
        """A door in each wall of a room."""
        return [self.door(room, locked=locked) for _ in range(4)]

    def things(
        self, count: int, room: Drawn | None = None, *, different: bool = False, but_not_in: Drawn | None = None
    ) -> Group:
        """Put so many drawn keys, balls and boxes into a room, or each into a drawn room."""
        if different and count > 3 * len(COLOURS):
            raise WorldError(f"{count} different objects; there are {3 * len(COLOURS)} kinds and colours")
        drawn = self._do(
            operations.OBJECTS_IN, _or_drawn(room), count, int(different), _or_drawn(but_not_in), registers=2
        )
        register = drawn.argument - IN_REGISTER
        return Group(Made(register), Made(register + 1))

    def any_door(self) -> Made:
        """Draw one of the doors."""
        return self._make(operations.ANY_DOOR)

    def recolour(self, group: Group, colour: str) -> None:
        """Give objects another colour."""
        self._do(operations.RECOLOUR, group.first, group.last, _number(colour), registers=0)

    def open_all_doors(self) -> None:
        """Open every door."""
        self._do(operations.OPEN_DOORS, registers=0)

    def require_reachable(self, reachable: bool = True) -> None:
        """Draw the round again unless everything can be reached without moving anything (or unless not)."""
        self._do(operations.IN_REACH, int(not reachable), registers=0)

    def require_no(self, group: Group, kind: str, colour: str) -> None:
        """Draw the round again if one of the objects is like that."""
        self._do(operations.NONE_LIKE, group.first, group.last, _number(kind), _number(colour), registers=0)

    def require_other(self, one: Drawn, other: Drawn) -> None:
        """Draw the round again if the two are the same."""
        self._do(operations.GIVE_UP_UNLESS, one, other, registers=0)

    def maybe_locked_room(self, chance: float) -> Drawn:
        """With that chance, put a locked door to a drawn room and its key into another; the room, or none."""
        if isinstance(chance, bool) or not isinstance(chance, int | float) or not 0 <= chance <= 1:
            raise WorldError(f"locked_room_prob is {chance!r}; a chance is 0 to 1")
        return self._do(operations.LOCK_ROOM, ceil(chance * 2**53))

    def block(self, door: Made) -> Made:
        """Put a ball of a drawn colour before a door, to its left."""
        return self._make(operations.BLOCK_DOOR, door)

    def boxed_key(self, room: Drawn, colour: Any) -> Made:
        """Put a box with a key in it into a room."""
        return self._make(operations.BOXED_KEY, room, colour)

    def maybe_swap(self, one: Made, other: Made) -> tuple[Made, Made]:
        """By one chance in two, each takes the other's place."""
        self._do(operations.SWAP, one, other, registers=0)
        return one, other

    def give(self, thing: Made) -> None:
        """The agent starts with it in its hand."""
        self._do(operations.HAND, thing, registers=0)

    def one_of(self, *each: Any) -> AnyOf:
        """Draw one of some instructions; a function is called for its instruction, and draws only when it is drawn."""
        return AnyOf(self.integer(0, len(each)), each)

    def invent(
        self,
        actions: Sequence[str],
        kinds: Sequence[str],
        *,
        places: bool,
        implicit_unlock: bool,
        locked_room: Drawn,
    ) -> None:
        """Draw a whole instruction about what lies in the house."""
        for name, given, known in (("action_kinds", actions, ACTIONS), ("instr_kinds", kinds, SENTENCES)):
            if isinstance(given, str) or not 1 <= len(given) <= 4 or any(word not in known for word in given):
                raise WorldError(f"{name} is {given!r}; it is one or more of {', '.join(known)}, at most four")
        lists = (_pack([ACTIONS[word] for word in actions]), _pack([SENTENCES[word] for word in kinds]))
        self._do(operations.INVENT, *lists, int(places), int(implicit_unlock), locked_room, registers=0)
        self._verbs |= {_WORDS[ACTIONS[word]] for word in actions}
        self._places |= places
        self._clauses = max(self._clauses, *({"action": 1, "and": 2, "seq": 4}[word] for word in kinds))

    def finish(self, instruction: "Instruction | AnyOf | None") -> None:
        """Say what the level's function has returned."""
        if isinstance(instruction, AnyOf):
            for k, each in enumerate(instruction.each):
                skip = len(self._lines)
                self._do(operations.SKIP_UNLESS, instruction.drawn, k, 0, registers=0)
                self.finish(each() if callable(each) else each)
                self._lines[skip][4] = len(self._lines) - skip - 1
        elif instruction is not None:
            self._say(instruction)

    def _say(self, instruction: Instruction) -> None:
        spoken = clauses(instruction)
        self._clauses = max(self._clauses, len(spoken))
        for k, clause in enumerate(spoken):
            verb = USE if isinstance(clause, Use) else VERB_NUMBERS[type(clause)]
            self._verbs |= {"open", "pick up"} if verb == USE else {_WORDS[verb]}
            self._do(
                operations.SAY,
                k,
                verb,
                *self._described(clause.thing),
                int(getattr(clause, "strict", False)),
                registers=0,
            )
            if isinstance(clause, PutNext):
                self._do(operations.SAY_OTHER, k, *self._described(clause.other), registers=0)
        counts = [len(clauses(part)) for part in parts(instruction)]
        strict = isinstance(instruction, Before | After) and instruction.strict
        self._do(
            operations.ARRANGE,
            JOINS.get(type(instruction), ALONE),
            counts[0],
            counts[1] if len(counts) > 1 else 0,
            IN_ORDER_STRICTLY if strict else 0,
            registers=0,
        )

    def _described(self, thing: Thing) -> tuple[int, int, int]:
        self._places |= thing.place is not None
        return (
            ANY if thing.kind is None else _number(thing.kind),
            ANY if thing.colour is None else _number(thing.colour),
            ANY if thing.place is None else _number(thing.place),
        )

    def space(self, *, any_mission: bool = False) -> InstructionSpace:
        """The space of the sentences that this level can say."""
        if any_mission or not self._verbs:
            return InstructionSpace()
        return InstructionSpace(*self._verbs, places=self._places, clauses=self._clauses)

    def program(self, steps_a_walk: int, *, flags: int) -> Program:
        """What was traced."""
        head = [self.columns, self.lines, self.size, steps_a_walk, int(self.keys_matter), flags]
        table = np.zeros((1 + len(self._lines), WIDE), np.int64)
        table[0, : len(head)] = head
        for line, numbers in zip(table[1:], self._lines, strict=True):
            line[: len(numbers)] = numbers
        return table

    def _make(self, operation: int, *arguments: Any) -> Made:
        return Made(self._do(operation, *arguments).argument - IN_REGISTER)

    def _do(self, operation: int, *arguments: Any, registers: int = 1) -> Drawn:
        out = self._registers
        self._registers += registers
        if operation == operations.ROOM_AT and all(isinstance(argument, int) for argument in arguments):
            self._registers -= 1  # a room that is known needs no register
            return Drawn(arguments[1] * self.columns + arguments[0])
        if self._registers > REGISTERS:
            raise WorldError(f"a level with more than {REGISTERS} drawn values; draw less in it")
        self._lines.append([operation, out, *(_number(argument) for argument in arguments)])
        return Drawn(IN_REGISTER + out)


def _number(value: Any) -> int:
    """An argument as a number: words by their place in the table of their sort."""
    if isinstance(value, Drawn):
        return value.argument
    if isinstance(value, Made):
        return IN_REGISTER + value.register
    if isinstance(value, str):
        for table in (COLOURS, KINDS, PLACES):
            if value in table:
                return table.index(value)
        raise WorldError(f"{value!r} is no colour, kind or place")
    return int(value)


def _or_drawn(value: Any) -> int:
    return -1 if value is None else _number(value)


def _pack(numbers: Sequence[int]) -> int:
    """A short list in one number, as `invent` reads it."""
    return len(numbers) | sum(number << 4 * (k + 1) for k, number in enumerate(numbers))
