"""RulesetBatch: many worlds of rules, stepped in one call, as a Gymnasium vector environment.

The states are the rows of a matrix. Each world of a batch behaves as it would alone: the same tasks, layouts,
observations, rewards and ends.
"""

from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import Any, ClassVar, NamedTuple, overload

import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import ArrayLike, NDArray

from minihuman.errors import WorldError
from minihuman.worlds.grid.row_vector_env import Observation, RowVectorEnv, build_end_info
from minihuman.worlds.grid.ruleset.batch_steps import observe_rulesets, step_rulesets
from minihuman.worlds.grid.ruleset.dynamics import FAILED, NEW, OVER, PHASE, TASK, TOGGLE, Row
from minihuman.worlds.grid.ruleset.encodings import encode_tasks
from minihuman.worlds.grid.ruleset.env import RulesetSnapshot, RulesetWorld
from minihuman.worlds.grid.ruleset.instructions import describe_task
from minihuman.worlds.grid.ruleset.layouts import lay_out_tasks
from minihuman.worlds.grid.ruleset.tasks import TaskSet
from minihuman.worlds.options import BatchSeeds
from minihuman.worlds.rng import RngState

MODES = (AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP, AutoresetMode.DISABLED)  # in the order of `batch_steps`


@lru_cache(maxsize=65_536)
def _describe(tasks: TaskSet, number: int) -> str:
    return describe_task(tasks[number])


class TaskMissions(Sequence[str]):
    """The instructions of a batch's worlds at one moment, in the order of the worlds; each is made when it is read."""

    def __init__(self, tasks: TaskSet, task_numbers: NDArray[np.int32]) -> None:
        self._tasks = tasks
        self._task_numbers = task_numbers

    @overload
    def __getitem__(self, index: int) -> str: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[str, ...]: ...
    def __getitem__(self, index: int | slice) -> str | tuple[str, ...]:
        if isinstance(index, slice):
            return tuple(_describe(self._tasks, number) for number in self._task_numbers[index].tolist())
        return _describe(self._tasks, int(self._task_numbers[index]))

    def __len__(self) -> int:
        return len(self._task_numbers)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sequence) and tuple(self) == tuple(other)

    __hash__ = None  # type: ignore[assignment]  # it equals tuples, which are hashed by their texts

    def __repr__(self) -> str:
        return repr(tuple(self))


class RulesetBatchSnapshot(NamedTuple):
    """An exact copy of a batch's worlds in mid-episode. Only ``save`` makes it, and only ``restore`` reads it."""

    rows: Row
    rng_states: RngState
    seeds: list[int]


class RulesetBatch(RowVectorEnv):
    """A batch of ``num_envs`` worlds of rules with the same options. Each draws its own tasks.

    Args:
        num_envs: the number of worlds.
        autoreset_mode: Gymnasium's name for the behaviour after an episode's end: "NextStep", "SameStep" or "Disabled".
        options: the options of `RulesetWorld`.
    """

    readable: ClassVar[frozenset[str]] = frozenset(
        {"action_names", "max_steps", "mission", "observes_task", "render_mode", "rooms", "row", "task", "tiles"}
    )
    methods: ClassVar[frozenset[str]] = frozenset(
        {"map", "observation", "picture", "pose", "render", "save", "scene_hash", "shortest_path", "state_hash", "text"}
    )
    settable: ClassVar[frozenset[str]] = frozenset()

    def __init__(
        self,
        *,
        num_envs: int = 1,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        **options: Any,
    ) -> None:
        if num_envs < 1:
            raise WorldError(f"num_envs is {num_envs!r}; use 1 or more")
        world = RulesetWorld(**options)  # what all have in common: spaces, tasks, settings
        super().__init__(world, num_envs=num_envs, autoreset_mode=autoreset_mode)
        self._mode = MODES.index(self._autoreset_mode)
        self._rows: Row = np.tile(world.row, (num_envs, 1))
        self._over = np.zeros(num_envs, np.int64)  # begins with the numbers of worlds to lay out after the last step
        self._image_shape = (num_envs, world.view_size, world.view_size, 2)
        self._after_layout()

    def reset(
        self, *, seed: BatchSeeds = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin a new episode in all worlds, or in those selected by ``options["reset_mask"]`` (bool[n]).

        World ``i`` takes the seed ``seed + i``, or ``seed[i]``; without a seed its random stream continues. Return the
        observations of all worlds and an empty info.
        """
        worlds = self._seed_worlds(seed, options)
        self._lay_out(worlds)
        laid_out = np.flatnonzero(self._rows[:, PHASE] != NEW)
        return self._observe(laid_out), {}

    def step(
        self, actions: ArrayLike
    ) -> tuple[Observation, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Take one action in every world; return observations, rewards, terminated, truncated and info of Gymnasium.

        Raises:
            WorldError: if there is not one valid action per world, before `reset`, and, with autoreset disabled, after
                an episode's end. No world is changed then.
        """
        numbers = self._check_actions(actions)
        n = self.num_envs
        images = np.empty(self._image_shape, np.uint8)
        directions = np.empty(n, np.int64)
        pockets = np.empty((n, 2), np.uint8)
        rewards = np.empty(n)
        terminated = np.empty(n, np.bool_)
        truncated = np.empty(n, np.bool_)
        seen = images, directions, pockets
        count = step_rulesets(self._rows, numbers, *seen, rewards, terminated, truncated, self._over, self._mode)
        if count < 0:
            raise self._refusal(~count, numbers)
        info: dict[str, Any] = {}
        if count > 0:
            over = self._over[:count].copy()
            if MODES[self._mode] is AutoresetMode.SAME_STEP:
                info = self._collect_final(terminated | truncated, self._build_observation(*seen))
            self._lay_out(over)
            observe_rulesets(self._rows, over, *seen)
        return self._build_observation(*seen), rewards, terminated, truncated, info

    def _refusal(self, world: int, actions: NDArray[np.int64]) -> WorldError:
        """Return the error for the action that the world with the number ``world`` cannot take."""
        phase = self._rows[world, PHASE]
        return self._build_refusal(
            world, int(actions[world]), is_new=phase == NEW, is_over=phase == OVER, last_action=TOGGLE
        )

    def _lay_out(self, worlds: NDArray[np.int64]) -> None:
        """Draw the tasks and layouts of new episodes in the given worlds.

        Raises:
            WorldError: if a world has not enough floor for its task's things.
        """
        tasks, first, last = self._world.source
        source = tasks.records, tasks.starts, first, last, self._world.rooms
        failed = lay_out_tasks(self._rows, worlds, self._rng_states, *source)
        if failed >= 0:
            assert self._rows[failed, FAILED]
            raise WorldError(
                f"world {failed} has no floor for the things of task {self._rows[failed, TASK]}; make the grid larger"
            )
        self._after_layout()

    def _after_layout(self) -> None:
        """Update the missions, goals and rules that observations have, after worlds were laid out."""
        self._missions = TaskMissions(self._world.source.tasks, self._rows[:, TASK].copy())
        if self._world.observes_task:
            self._encodings = encode_tasks(self._rows, self._world.most_rules)

    def _observe(self, worlds: NDArray[np.int64]) -> Observation:
        """Return the observations of the given worlds; those of the others are 0."""
        images = np.zeros(self._image_shape, np.uint8)
        directions = np.zeros(self.num_envs, np.int64)
        pockets = np.zeros((self.num_envs, 2), np.uint8)
        observe_rulesets(self._rows, worlds, images, directions, pockets)
        return self._build_observation(images, directions, pockets)

    def _build_observation(
        self, images: NDArray[np.uint8], directions: NDArray[np.int64], pockets: NDArray[np.uint8]
    ) -> Observation:
        observation = {"image": images, "direction": directions, "pocket": pockets, "mission": self._missions}
        if self._world.observes_task:
            goals, rules = self._encodings
            observation |= {"goal_encoding": goals.copy(), "rule_encoding": rules.copy()}
        return observation

    def _collect_final(self, over: NDArray[np.bool_], last: Observation) -> dict[str, Any]:
        """Return the last observations of the worlds whose episodes ended, as the info of Gymnasium's "SameStep" mode.

        ``over`` says which worlds these are, bool[n], and ``last`` has the observations of all worlds.
        """
        observations = np.full(self.num_envs, None, object)
        for i in np.flatnonzero(over).tolist():
            parts = {name: part[i] for name, part in last.items()}
            copies = {name: part.copy() for name, part in parts.items() if isinstance(part, np.ndarray)}
            observations[i] = {**parts, **copies, "direction": int(parts["direction"])}
        return build_end_info(over, observations)

    def worlds_in_turn(self) -> Iterator[RulesetWorld]:
        """Yield each world in turn, as one environment. Changes made to it are written back to the batch."""
        for i in range(self.num_envs):
            self._world.restore(RulesetSnapshot(self._rows[i], self._rng_states[i]))
            yield self._world
            saved = self._world.save()
            self._rows[i] = saved.row
            self._rng_states[i] = saved.rng_state

    def save(self) -> RulesetBatchSnapshot:
        """Return an exact copy of every world in mid-episode, which can be pickled."""
        return RulesetBatchSnapshot(self._rows.copy(), self._rng_states.copy(), [*self._seeds])

    def restore(self, saved: RulesetBatchSnapshot) -> None:
        """Restore a saved state. The copy is not consumed.

        Raises:
            WorldError: if a batch of another size saved it.
        """
        saved = self._check_saved(saved, RulesetBatchSnapshot)
        self._rows[:] = saved.rows
        self._rng_states[:] = saved.rng_states
        self._seeds = [*saved.seeds]
        self._after_layout()
