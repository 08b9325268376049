"""Tasks of worlds of rules: a goal, rules, and the things that lie there; sets of tasks as files; how hard a task is.

All is written in the numbers of `dynamics`. A file is a NumPy archive of one record per task, sorted by difficulty:
four bytes for the goal, two for the numbers of rules and things, four per rule, one per thing.
"""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from pathlib import Path
from typing import Any, NamedTuple, cast
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.grid.ruleset import dynamics as numbers
from minihuman.worlds.grid.ruleset.layouts import N_RULES, N_THINGS, RECORD
from minihuman.worlds.options import check_whole, whole_number

MOST_RULES = 60
MOST_THINGS = 120
UNREACHABLE = 255  # the difficulty of a task whose goal no chain of rules makes possible

_PAIR_GOALS = range(numbers.GOAL_TILE_NEAR_UP, numbers.GOAL_TILE_NEAR_LEFT + 1)
_FOLDER = Path(__file__).parent / "task_sets"
FORMAT = 1


class RuleGoal(NamedTuple):
    """A goal: its kind, and three numbers, which are tiles, or a row and a column of the grid."""

    kind: int
    first: int = 0
    second: int = 0
    third: int = 0

    @property
    def tiles(self) -> tuple[int, ...]:
        """Return the tiles that the goal needs: none, one or two."""
        if self.kind in (numbers.NO_GOAL, numbers.GOAL_AGENT_AT):
            return ()
        if self.kind == numbers.GOAL_TILE_NEAR or self.kind in _PAIR_GOALS:
            return self.first, self.second
        return (self.first,)


class TileRule(NamedTuple):
    """A rule: its kind, the tiles that it takes (the second is 0 where it takes one), and the tile that it makes."""

    kind: int
    first: int
    second: int
    product: int

    @property
    def inputs(self) -> tuple[int, ...]:
        """Return the one or two tiles that the rule takes."""
        if numbers.TILE_NEAR <= self.kind <= numbers.TILE_NEAR_LEFT:
            return self.first, self.second
        return (self.first,)


class RuleTask(NamedTuple):
    """A task: the goal, the rules in the order in which they are tested, and the things that lie there at the start."""

    goal: RuleGoal
    rules: tuple[TileRule, ...]
    things: tuple[int, ...]

    @property
    def difficulty(self) -> int:
        """Return how many times rules have to be used before the goal is possible; `UNREACHABLE` if it never is.

        The number is that of the tree of rules, without regard to the rooms: things that a rule takes have to lie there
        or be made by another rule.
        """
        return UNREACHABLE if self.uses is None else min(self.uses, UNREACHABLE)

    @property
    def uses(self) -> int | None:
        """Return how many times rules have to be used before the goal is possible; None if it never is."""
        costs = dict.fromkeys(self.things, 0)
        for _ in self.rules:  # a round per level of the tree
            before = dict(costs)
            for rule in self.rules:
                if all(tile in costs for tile in rule.inputs):
                    cost = 1 + sum(costs[tile] for tile in rule.inputs)
                    costs[rule.product] = min(cost, costs.get(rule.product, cost))
            if costs == before:
                break
        if all(tile in costs for tile in self.goal.tiles):
            return sum(costs[tile] for tile in self.goal.tiles)
        return None

    def record(self) -> bytes:
        """Return the task's bytes in a file."""
        counts = len(self.rules), len(self.things)
        flat = [number for rule in self.rules for number in rule]
        return bytes((*self.goal, *counts, *flat, *self.things))


def read_record(record: Sequence[int]) -> RuleTask:
    """Return the task that a record in a file encodes, as `RuleTask.record` writes it."""
    integers = [int(number) for number in record]
    first_thing = RECORD + numbers.PER_RULE * integers[N_RULES]
    starts = range(RECORD, first_thing, numbers.PER_RULE)
    rules = tuple(TileRule(*integers[start : start + numbers.PER_RULE]) for start in starts)
    things = tuple(integers[first_thing : first_thing + integers[N_THINGS]])
    return RuleTask(RuleGoal(*integers[:N_RULES]), rules, things)


def check_task(task: RuleTask, height: int, width: int) -> None:
    """Check that the numbers of a task are valid in a grid of a size.

    Raises:
        WorldError: if a number stands for no tile, rule, goal or cell, a rule or the goal is about walls, or there are
            too many rules or things.
    """
    if len(task.rules) > MOST_RULES or len(task.things) > MOST_THINGS:
        raise WorldError(
            f"a task has {len(task.rules)} rules and {len(task.things)} things; at most {MOST_RULES} and "
            f"{MOST_THINGS} are possible"
        )
    check_whole("a goal's kind", task.goal.kind, 0, numbers.GOAL_AGENT_NEAR_LEFT)
    for rule in task.rules:
        check_whole("a rule's kind", rule.kind, 0, numbers.AGENT_NEAR_LEFT)
        if rule.kind != numbers.NO_RULE:
            for tile in rule.inputs:
                _check_tile("a rule takes", tile)
            _check_tile("a rule makes", rule.product)
    for tile in (*task.things, *task.goal.tiles):
        _check_tile("a task has", tile)
    cell = {numbers.GOAL_TILE_AT: task.goal[2:], numbers.GOAL_AGENT_AT: task.goal[1:3]}.get(task.goal.kind)
    if cell is not None and not (cell[0] < height and cell[1] < width):
        raise WorldError(f"the goal is about row {cell[0]} and column {cell[1]} of a grid of {height} x {width} cells")


def _check_tile(subject: str, tile: int) -> None:
    """Raise a WorldError unless a tile is coloured floor, a thing or a door; ``subject`` begins the message."""
    kind = tile & 15
    if not numbers.FLOOR <= kind <= numbers.STAR or kind == numbers.WALL or not 0 < tile >> 4 <= len(_COLOURS):
        raise WorldError(f"{subject} the tile {tile!r}, a {_name_kind(tile)}; use floor, things or doors in a colour")


_COLOURS = numbers.TILE_COLOURS[1:]


def _name_kind(tile: int) -> str:
    """Return the name of a tile's kind, or "tile of no kind"."""
    kind = tile & 15
    if kind < len(numbers.TILE_KINDS):
        return numbers.TILE_KINDS[kind]
    return "tile of no kind"


def parse_task(encoding: Any) -> RuleTask:
    """Return the task of an encoding in XLand-MiniGrid's numbers: ``goal``, ``rules``, ``init_tiles``, padded or not.

    Args:
        encoding: a mapping, or a task, which is returned unchanged; a goal has a kind and numbers, a rule a kind and
            the kind and colour of up to three tiles, the last of which it makes, and each initial tile a kind and a
            colour.

    Raises:
        WorldError: if something is missing or has another form.
    """
    if isinstance(encoding, RuleTask):
        return encoding
    if not isinstance(encoding, Mapping) or encoding.keys() != {"goal", "rules", "init_tiles"}:
        raise WorldError(f"task is {encoding!r}; give a table with goal, rules and init_tiles")
    goal = _read_goal(_read_numbers("goal", encoding["goal"], 5))
    rules = [_read_rule(_read_numbers("a rule", rule, 7)) for rule in encoding["rules"]]
    things = [_read_numbers("an initial tile", tile, 2) for tile in encoding["init_tiles"]]
    codes = tuple(kind | colour << 4 for kind, colour in things if kind != numbers.EMPTY)
    return RuleTask(goal, tuple(rule for rule in rules if rule.kind != numbers.NO_RULE), codes)


def _read_numbers(subject: str, encoding: Any, length: int) -> list[int]:
    """Return the whole numbers of an encoding as a list, padded with 0 to a length.

    Raises:
        WorldError: if there are more, or one is outside 0 to 255; ``subject`` begins the message.
    """
    plain = encoding.tolist() if isinstance(encoding, np.ndarray) else encoding
    if not isinstance(plain, list | tuple) or len(plain) > length:
        raise WorldError(f"{subject} of the task is {encoding!r}; give up to {length} whole numbers")
    wholes = [whole_number(number) for number in plain]
    if any(number is None or not 0 <= number < 256 for number in wholes):
        raise WorldError(f"{subject} of the task is {encoding!r}; give whole numbers from 0 to 255")
    return [*cast(list[int], wholes), *[0] * (length - len(wholes))]


def _read_goal(encoding: list[int]) -> RuleGoal:
    """Return the goal of an encoding: a kind, and two tiles, a tile and a cell, a cell, or a tile."""
    kind, *parts = encoding
    first = parts[0] | parts[1] << 4
    if kind == numbers.GOAL_AGENT_AT:
        return RuleGoal(kind, parts[0], parts[1])
    if kind == numbers.GOAL_TILE_AT:
        return RuleGoal(kind, first, parts[2], parts[3])
    if kind == numbers.GOAL_TILE_NEAR or kind in _PAIR_GOALS:
        return RuleGoal(kind, first, parts[2] | parts[3] << 4)
    return RuleGoal(kind, first if kind else 0)


def _read_rule(encoding: list[int]) -> TileRule:
    """Return the rule of an encoding: a kind, the tiles that it takes, and the tile that it makes."""
    kind, *parts = encoding
    tiles = [parts[start] | parts[start + 1] << 4 for start in (0, 2, 4)]
    if numbers.TILE_NEAR <= kind <= numbers.TILE_NEAR_LEFT:
        return TileRule(kind, *tiles)
    return TileRule(kind, tiles[0], 0, tiles[1])


@dataclass(frozen=True, eq=False)
class TaskSet:
    """A set of tasks, sorted by difficulty.

    Attributes:
        records: the tasks' records one after the other, uint8.
        starts: the index at which each record begins, and the end of the last, int64[tasks + 1].
        difficulties: the difficulty of each task, uint8[tasks], ascending.
        origin: where the tasks come from: the generator, its version, settings and seed.
    """

    records: NDArray[np.uint8]
    starts: NDArray[np.int64]
    difficulties: NDArray[np.uint8]
    origin: Mapping[str, Any] = field(default_factory=dict)

    def __len__(self) -> int:
        return len(self.difficulties)

    def __getitem__(self, number: int) -> RuleTask:
        check_whole("task", number, 0, len(self) - 1)
        return read_record(self.records[self.starts[number] : self.starts[number + 1]].tolist())

    @cached_property
    def most_rules(self) -> int:
        """Return the number of rules of the task that has most of them."""
        return int(self.records[self.starts[:-1] + N_RULES].max())

    def numbers_of(self, difficulty: tuple[int, int]) -> tuple[int, int]:
        """Return the number of the first task in a range of difficulties, and the number after that of the last.

        Args:
            difficulty: the least and the greatest difficulty, both included.

        Raises:
            WorldError: if no task is of these difficulties.
        """
        low, high = difficulty
        first = int(np.searchsorted(self.difficulties, low, "left"))
        last = int(np.searchsorted(self.difficulties, high, "right"))
        if first == last:
            available = ", ".join(map(str, np.unique(self.difficulties).tolist()))
            raise WorldError(f"no task has a difficulty from {low} to {high}; those of this set have {available}")
        return first, last

    def save(self, path: Path) -> None:
        """Write the set to a file, the same bytes for the same tasks."""
        lengths = np.diff(self.starts)
        with path.open("wb") as file:
            np.savez_compressed(
                file,
                format=np.uint32(FORMAT),
                records=self.records,
                lengths=lengths.astype(np.uint16),
                difficulties=self.difficulties,
                origin=np.frombuffer(json.dumps(self.origin, sort_keys=True).encode(), np.uint8),
            )


def build_task_set(tasks: Iterable[RuleTask], origin: Mapping[str, Any] | None = None) -> TaskSet:
    """Return a set of tasks, sorted by difficulty; tasks of equal difficulty keep their order.

    Raises:
        WorldError: if there are no tasks.
    """
    pairs = [(task.difficulty, task.record()) for task in tasks]
    if not pairs:
        raise WorldError("a set needs at least one task")
    pairs.sort(key=lambda pair: pair[0])
    lengths = np.array([len(record) for _, record in pairs])
    return TaskSet(
        np.frombuffer(b"".join(record for _, record in pairs), np.uint8).copy(),  # kernels take writable arrays only
        np.concatenate(([0], np.cumsum(lengths))).astype(np.int64),
        np.array([difficulty for difficulty, _ in pairs], np.uint8),
        origin or {},
    )


def read_task_set(path: Path) -> TaskSet:
    """Return the set of tasks that a file contains.

    Raises:
        WorldError: if the file is missing, damaged, or of another format.
    """
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as archive:
            if int(archive["format"]) != FORMAT:
                raise WorldError(f"{path} has format {int(archive['format'])}; this version reads {FORMAT}: update")
            starts = np.concatenate(([0], np.cumsum(archive["lengths"], dtype=np.int64)))
            records = np.ascontiguousarray(archive["records"])
            difficulties = np.ascontiguousarray(archive["difficulties"])
            origin = json.loads(archive["origin"].tobytes())
    except (OSError, KeyError, ValueError, EOFError, BadZipFile) as error:
        raise WorldError(f"{path} is no set of tasks ({error}); write one with `TaskSet.save`") from error
    task_set = TaskSet(records, starts, difficulties, origin)
    if len(difficulties) == 0 or len(starts) != len(difficulties) + 1 or starts[-1] != len(records):
        raise WorldError(f"{path} is damaged: its records do not fit their number; write it again")
    _check_lengths(task_set, path)
    return task_set


def _check_lengths(task_set: TaskSet, path: Path) -> None:
    """Check that each record is as long as its counts say, so that no kernel reads past it, and the order of tasks.

    Raises:
        WorldError: if a record has another length, or the tasks are not sorted by difficulty.
    """
    first = task_set.starts[:-1]
    lengths = np.diff(task_set.starts)
    if lengths.min() < RECORD:
        raise WorldError(f"{path} is damaged: a record is too short; write it again")
    rules = task_set.records[first + N_RULES].astype(np.int64)
    things = task_set.records[first + N_THINGS].astype(np.int64)
    if (
        not np.array_equal(lengths, RECORD + numbers.PER_RULE * rules + things)
        or (np.diff(task_set.difficulties) < 0).any()
    ):
        raise WorldError(f"{path} is damaged: a record has another length than it says; write it again")


def packaged_sets() -> tuple[str, ...]:
    """Return the names of the sets that are part of the package."""
    return tuple(sorted(path.stem for path in _FOLDER.glob("*.npz")))


def find_task_set(name: str) -> TaskSet:
    """Return a set of the package by its name, or one of a file by its path.

    Raises:
        WorldError: if there is no such set.
    """
    if name in packaged_sets():
        return _read_once(_FOLDER / f"{name}.npz")
    path = Path(name)
    if not path.is_file():
        raise WorldError(f"task_set is {name!r}; use one of {', '.join(packaged_sets())}, or the path of a file")
    return _read_once(path.resolve())


@lru_cache(maxsize=8)
def _read_once(path: Path) -> TaskSet:
    return read_task_set(path)
