"""A planner for worlds of rules: a search for the next change that brings the goal nearer.

A plan is a sequence of changes (something is picked up, put down or transformed, a door is opened), each reached by a
shortest walk that changes nothing else. Which change to look at first is estimated by how many rules have still to be
used. So the plan is short, but not always the shortest.
"""

import heapq
from collections.abc import Iterable, Sequence
from itertools import count
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.grid.ruleset.dynamics import (
    DOOR_OPEN,
    FORWARD,
    MAX_STEPS,
    NO_GOAL,
    OVER,
    PHASE,
    PICK_UP,
    POCKET,
    PUT_DOWN,
    STEP,
    TASK,
    TOGGLE,
    Row,
)
from minihuman.worlds.grid.ruleset.reach import FAR, reach_changes
from minihuman.worlds.grid.ruleset.tasks import RuleTask

MOST_SCENES = 4_000  # the search is given up after so many expanded states
STEPS_PER_RULE = 30  # steps per rule in the estimate: more than a rule mostly takes, so that the search is greedy
MOST_DROPS = 8  # a narrow search puts a thing down without effect only in so many places, the nearest
_IMPOSSIBLE = float("inf")
_MOVE_BASE = 8  # by which the kernel codes a pose and an action as one number


class _Change(NamedTuple):
    """The way to a state: the state before it, and the pose and action that led on, ``pose * _MOVE_BASE + action``."""

    before: bytes
    move: int


class _Expansion(NamedTuple):
    """The arrays into which the kernel writes the states that one change leads to.

    The fields are the arguments of `reach_changes`.
    """

    after: Row
    costs: NDArray[np.int64]
    moves: NDArray[np.int64]
    parents: NDArray[np.int64]
    queue: NDArray[np.int64]

    @classmethod
    def for_row(cls, row: Row, n_cells: int) -> "_Expansion":
        """Return arrays for the changes that are possible in the state ``row`` of a grid of ``n_cells`` cells."""
        poses = 4 * n_cells
        after = np.zeros((4 * poses, len(row)), np.int32)
        costs = np.zeros(4 * poses, np.int64)
        moves = np.zeros(4 * poses, np.int64)
        return cls(after, costs, moves, np.zeros(poses, np.int64), np.zeros(poses, np.int64))


def find_plan(row: Row, task: RuleTask, n_cells: int) -> Sequence[int]:
    """Return actions that lead from a state to the goal; empty if there are none.

    Args:
        row: the state.
        task: the goal and rules of the state.
        n_cells: the number of cells of the grid.

    Raises:
        WorldError: if no plan was found in `MOST_SCENES` states.
    """
    if row[PHASE] == OVER or task.goal.kind == NO_GOAL:
        return ()
    search = _Search(row, task, n_cells)
    return search.run(is_narrow=True) or search.run(is_narrow=False) or ()


def _find_needed(task: RuleTask) -> set[int]:
    """Return the tiles that the goal needs, and those that rules need to make needed tiles."""
    needed = set(task.goal.tiles)
    for _ in task.rules:
        needed |= {tile for rule in task.rules if rule.product in needed for tile in rule.inputs}
    return needed


class _Search:
    """A best-first search through the changes that the agent can bring about."""

    def __init__(self, row: Row, task: RuleTask, n_cells: int) -> None:
        self._start = row.copy()
        self._start[[STEP, TASK]] = 0
        self._start[MAX_STEPS] = FAR
        self._task = task
        self._n_cells = n_cells
        self._space = _Expansion.for_row(row, n_cells)
        self._estimates: dict[frozenset[int], float] = {}
        self._needed = _find_needed(task)

    def run(self, *, is_narrow: bool) -> list[int] | None:
        """Search for a plan and return its actions; None if no state that the search can reach is at the goal.

        Args:
            is_narrow: whether to close no door, to pick up only what is needed, and to put it down without effect only
                in few places.

        Raises:
            WorldError: if there are too many states.
        """
        start = self._start.tobytes()
        reached: dict[bytes, _Change | None] = {start: None}
        order = count()
        waiting = [(self._estimate(self._start), next(order), 0, start)]
        done: set[bytes] = set()
        while waiting:
            _, _, cost, key = heapq.heappop(waiting)
            row = np.frombuffer(key, np.int32).copy()
            if row[PHASE] == OVER:
                return self._build_plan(key, reached)
            scene = self._scene_key(row)
            if scene in done:
                continue
            done.add(scene)
            if len(done) > MOST_SCENES:
                raise WorldError(
                    f"no plan was found in the first {MOST_SCENES} states searched; there may still be one"
                )
            for after, n_actions, move in self._expand(row, is_narrow=is_narrow):
                next_key = after.tobytes()
                if next_key in reached or self._scene_key(after) in done:
                    continue
                estimate = self._estimate(after)
                if estimate < _IMPOSSIBLE:
                    reached[next_key] = _Change(key, move)
                    new_cost = cost + n_actions
                    heapq.heappush(waiting, (new_cost + estimate, next(order), new_cost, next_key))
        return None

    def _scene_key(self, row: Row) -> bytes:
        """Return the part of a state that the search distinguishes, as bytes: what is carried, the tiles, the phase."""
        return row[POCKET].tobytes() + row[-self._n_cells :].tobytes() + row[PHASE].tobytes()

    def _expand(self, row: Row, *, is_narrow: bool) -> Iterable[tuple[Row, int, int]]:
        """Yield each state to which one change leads, the number of actions to it, and the last pose and action.

        The last two are one number, ``pose * _MOVE_BASE + action``. The state is a view that the next expansion
        overwrites. ``is_narrow`` is as in `run`.
        """
        space = self._space
        before = row[-self._n_cells :]
        drops: set[bytes] = set()
        for number in range(reach_changes(row, *space)):
            after = space.after[number]
            move = int(space.moves[number])
            if is_narrow and after[PHASE] != OVER and move % _MOVE_BASE != FORWARD:
                tiles = after[-self._n_cells :]
                # one tile alone has changed, so no rule about tiles was used
                is_plain = int((tiles != before).sum()) == 1
                if move % _MOVE_BASE == TOGGLE and int((tiles & 15 == DOOR_OPEN).sum()) < int(
                    (before & 15 == DOOR_OPEN).sum()
                ):
                    continue
                if is_plain and move % _MOVE_BASE == PICK_UP and int(after[POCKET]) not in self._needed:
                    continue
                if is_plain and move % _MOVE_BASE == PUT_DOWN:
                    layout = tiles.tobytes()
                    if layout in drops or len(drops) == MOST_DROPS:
                        continue
                    drops.add(layout)
            yield after, int(space.costs[number]), move

    def _estimate(self, row: Row) -> float:
        """Return an estimate of the number of actions to the goal, by the number of rules that still have to be used.

        It is infinite if rules cannot make what the goal needs.
        """
        if row[PHASE] == OVER:
            return 0.0
        present = frozenset(self._needed & {int(row[POCKET]), *row[-self._n_cells :].tolist()})
        if present not in self._estimates:
            uses = self._task._replace(things=tuple(present)).uses
            self._estimates[present] = _IMPOSSIBLE if uses is None else STEPS_PER_RULE * uses + 1.0
        return self._estimates[present]

    def _build_plan(self, key: bytes, reached: dict[bytes, _Change | None]) -> list[int]:
        """Return the actions of the plan that leads to the state ``key``: walks between its changes, and the changes.

        ``reached`` has the change that led to each state, None for the start.
        """
        actions: list[int] = []
        change = reached[key]
        while change is not None:
            row = np.frombuffer(change.before, np.int32).copy()
            reach_changes(row, *self._space)
            move = change.move
            while move >= 0:
                pose, action = divmod(move, _MOVE_BASE)
                actions.append(action)
                move = int(self._space.parents[pose])
            change = reached[change.before]
        return actions[::-1]
