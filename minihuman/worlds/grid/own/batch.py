"""OwnBatch: a Gymnasium vector environment of many worlds of a user's own class, whose rules are compiled.

A step is three passes over all worlds: the grid's own rules, the author's compiled rules, and the views. Each world of
a batch behaves as it would alone. Worlds whose rules are not translated are stepped one after the other.
"""

import logging
from collections.abc import Callable, Iterator
from typing import Any, ClassVar, NamedTuple

import numpy as np
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from numpy.typing import ArrayLike, NDArray

from minihuman.errors import WorldError
from minihuman.worlds.grid.core.state import ACTIONS, NEW, OVER, PHASE, State
from minihuman.worlds.grid.engine import GridSnapshot
from minihuman.worlds.grid.own import entries
from minihuman.worlds.grid.own.entries import FAULT
from minihuman.worlds.grid.own.fields import Bool, field_named, numbers_length, own_numbers
from minihuman.worlds.grid.own.library import compile_library
from minihuman.worlds.grid.own.passes import act_many, see_many
from minihuman.worlds.grid.own.programs import (
    compile_rules,
    mission_of,
    raise_fault,
    setting_arrays,
    translate_rules,
)
from minihuman.worlds.grid.own.source_names import TranslationError
from minihuman.worlds.grid.row_vector_env import Observation, RowVectorEnv, build_end_info
from minihuman.worlds.options import BatchSeeds

LOG = logging.getLogger("minihuman")


def make_batch(
    world_class: Callable[..., Any],
    *,
    num_envs: int = 1,
    autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
    options_per_world: list[dict[str, Any]] | None = None,
    **options: Any,
) -> Any:
    """Return a batch of worlds of a class: compiled if the rules can be translated, otherwise stepped one by one.

    It is an `OwnBatch` or else Gymnasium's SyncVectorEnv.

    Args:
        world_class: the class.
        num_envs: the number of worlds.
        autoreset_mode: Gymnasium's name for the behaviour after an episode's end.
        options_per_world: further options for each world, which must not change its spaces; None for none.
        options: the options that all worlds share.

    Raises:
        WorldError: if ``num_envs`` is below 1 or is not the number of ``options_per_world``.
    """
    per_world = options_per_world or [{}] * num_envs
    if num_envs < 1 or len(per_world) != num_envs:
        raise WorldError(f"num_envs is {num_envs!r} and there are {len(per_world)} sets of options; give one per world")
    keys = [str(sorted(world_options.items())) for world_options in per_world]  # equal options share a world
    worlds = {key: world_class(**options | world_options) for key, world_options in zip(keys, per_world, strict=True)}
    try:
        for world in worlds.values():
            compile_rules(world)
        return OwnBatch([worlds[key] for key in keys], autoreset_mode=autoreset_mode)
    except TranslationError as refusal:
        LOG.warning("%s is stepped in plain Python: %s", getattr(world_class, "__name__", world_class), refusal)
    makers = [lambda own=own: world_class(**{**options, **own}) for own in per_world]
    return SyncVectorEnv(makers, autoreset_mode=autoreset_mode)


class OwnBatchSnapshot(NamedTuple):
    """An exact copy of a batch's worlds in mid-episode. Only ``save`` makes it, and only ``restore`` reads it."""

    rows: NDArray[np.int32]
    own: NDArray[np.int64]
    rng_states: NDArray[np.uint64]
    missions: tuple[str, ...]
    seeds: list[int]


class OwnBatch(RowVectorEnv):
    """A batch of worlds of one class, stepped together in compiled code.

    Args:
        worlds: newly made worlds, one for each world of the batch; the same object may stand for several equal ones.
        autoreset_mode: Gymnasium's name for the behaviour after an episode's end: "NextStep", "SameStep" or "Disabled".

    Raises:
        TranslationError: if the translated rules differ between worlds, because different attributes are part of them.
        WorldError: if the worlds differ in their sizes or spaces.
    """

    readable: ClassVar[frozenset[str]] = frozenset(
        {"action_names", "agent_dir", "agent_pos", "carrying", "height", "max_steps", "mission", "state", "step_count"}
        | {"width", "render_mode"}
    )
    methods: ClassVar[frozenset[str]] = frozenset(
        {"frame", "map", "observation", "picture", "pose", "render", "save", "scene_hash", "state_hash", "text"}
    )
    settable: ClassVar[frozenset[str]] = frozenset({"agent_dir", "agent_pos", "carrying", "max_steps", "step_count"})

    def __init__(self, worlds: list[Any], *, autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP) -> None:
        super().__init__(worlds[0], num_envs=len(worlds), autoreset_mode=autoreset_mode)
        self._check_alike(worlds)
        self._program = translate_rules(self._world)
        self._library = compile_library(self._program.text, has_steps=self._program.has_reward)
        self._first_missions = [world.mission_space.first() for world in worlds]
        self._missions: tuple[str, ...] = tuple(self._first_missions)
        self._make_memory(worlds)

    def _check_alike(self, worlds: list[Any]) -> None:
        """Check that all worlds have the sizes, spaces and translated rules of the first one.

        Raises:
            WorldError: if their sizes or spaces differ.
            TranslationError: if their translated rules differ.
        """
        for world in worlds[1:]:
            is_alike = world.action_space == self._world.action_space and world._row.shape == self._world._row.shape
            if not is_alike or world.image_shape != self._world.image_shape:
                raise WorldError("the worlds of a batch differ in their sizes or spaces; make a batch of each kind")
            if translate_rules(world) is not translate_rules(self._world):
                raise TranslationError("the worlds of a batch differ in texts or tuples that their rules read")

    def _make_memory(self, worlds: list[Any]) -> None:
        """Allocate the arrays that compiled code reads and writes, a row for each world, and their table."""
        n = self.num_envs
        program = self._program
        self._rows: NDArray[np.int32] = np.ascontiguousarray([world._row for world in worlds])
        self._own = np.zeros((n, numbers_length(type(self._world))), np.int64)
        self._mission_parts = np.zeros((n, program.mission_length), np.int64)
        settings = [setting_arrays(world, program) for world in worlds]
        self._settings = np.ascontiguousarray([whole for whole, _ in settings])
        self._float_settings = np.ascontiguousarray([floats for _, floats in settings])
        self._scratch = np.zeros(max(program.scratch, 1), np.int64)
        self._stepped = np.ones(n, np.bool_)
        self._table = entries.make_table(
            {
                entries.ROWS: self._rows,
                entries.OWN_NUMBERS: self._own,
                entries.INT_SETTINGS: self._settings,
                entries.FLOAT_SETTINGS: self._float_settings,
                entries.RNG: self._rng_states,
                entries.MISSIONS: self._mission_parts,
                entries.STEPPED: self._stepped,
                entries.SCRATCH: self._scratch,
            }
        )

    @property
    def states(self) -> list[State]:
        """Return a copy of each world's state, with named fields."""
        return [State(row.copy()) for row in self._rows]

    def reset(
        self, *, seed: BatchSeeds = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin a new episode in all worlds, or in those selected by ``options["reset_mask"]`` (bool[n]).

        World ``i`` takes the seed ``seed + i``, or ``seed[i]``; without a seed its random stream continues. Return the
        observations of all worlds and an empty info.
        """
        self._lay_out(self._seed_worlds(seed, options))
        return self._observe(), {}

    def step(
        self, actions: ArrayLike
    ) -> tuple[Observation, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Take one action in every world; return observations, rewards, terminated, truncated and info of Gymnasium.

        Raises:
            WorldError: if there is not one valid action per world, before `reset`, and, with autoreset disabled, after
                an episode's end. No world is changed then.
            Exception: if the rules raise an error; the message names the line and the world. The batch must then be
                reset.
        """
        numbers = self._check_actions(actions)
        n = self.num_envs
        rewards = np.empty(n)
        terminated = np.empty(n, np.bool_)
        truncated = np.empty(n, np.bool_)
        next_step = self._autoreset_mode is AutoresetMode.NEXT_STEP
        flags = terminated, truncated, self._stepped
        status = act_many(self._rows, numbers, self._rng_states, rewards, *flags, next_step)
        if status < 0:
            raise self._refusal(~status, numbers)
        self._run_rules(numbers, rewards, terminated, truncated)
        info: dict[str, Any] = {}
        ended = np.zeros(0, np.int64)
        if next_step:
            ended = np.flatnonzero(~self._stepped)
        elif self._autoreset_mode is AutoresetMode.SAME_STEP and (terminated | truncated).any():
            ended = np.flatnonzero(terminated | truncated)
            info = self._collect_final(terminated | truncated)
        if len(ended):
            self._lay_out(ended)
        return self._observe(), rewards, terminated, truncated, info

    def _run_rules(
        self,
        actions: NDArray[np.int64],
        rewards: NDArray[np.float64],
        terminated: NDArray[np.bool_],
        truncated: NDArray[np.bool_],
    ) -> None:
        """Run the author's `reward_and_done`, if there is one, in every stepped world, and write its results.

        ``rewards`` and ``terminated`` hold what the grid's own rules say, and receive what the author's say.

        Raises:
            Exception: if the rules raise an error.
        """
        if self._library.steps is None:
            return
        table = self._table
        table[entries.ACTIONS] = actions.ctypes.data
        table[entries.REWARDS] = rewards.ctypes.data
        table[entries.TERMINATED] = terminated.ctypes.data
        table[entries.TRUNCATED] = truncated.ctypes.data
        if self._library.steps(table.ctypes.data):
            raise_fault(self._program, table, world=int(table[FAULT + 4]))

    def _refusal(self, world: int, actions: NDArray[np.int64]) -> WorldError:
        """Return the error for the action that the world with the number ``world`` cannot take."""
        phase = self._rows[world, PHASE]
        last = int(self._rows[world, ACTIONS]) - 1
        return self._build_refusal(
            world, int(actions[world]), is_new=phase == NEW, is_over=phase == OVER, last_action=last
        )

    def _lay_out(self, worlds: NDArray[np.int64]) -> None:
        """Lay out new episodes in the worlds with the given numbers, and set their missions.

        Raises:
            Exception: if the rules raise an error.
        """
        numbers = np.ascontiguousarray(worlds, np.int64)
        self._table[entries.WORLDS] = numbers.ctypes.data
        self._table[entries.COUNT] = len(numbers)
        if self._library.layouts(self._table.ctypes.data):
            raise_fault(self._program, self._table, world=int(self._table[FAULT + 4]))
        if self._program.templates:
            missions = list(self._missions)
            for i in numbers.tolist():
                missions[i] = mission_of(self._program, self._mission_parts[i], self._first_missions[i])
            self._missions = tuple(missions)

    def _observe(self) -> Observation:
        """Return the observations of all worlds."""
        images = np.empty((self.num_envs, *self._world.image_shape), np.uint8)
        directions = np.empty(self.num_envs, np.int64)
        see_many(self._rows, images, directions)
        observation = {"image": images, "direction": directions, "mission": self._missions}
        for name in self._world.observed:
            observation[name] = self._observed(name)
        return observation

    def _observed(self, name: str) -> NDArray[Any]:
        """Return the observations of a declared field, one row for each world."""
        field = field_named(type(self._world), name)
        numbers = self._own[:, field.offset : field.offset + field.size]
        if isinstance(field, Bool):
            return numbers[:, 0].copy()
        return np.ascontiguousarray(numbers).view(field.dtype).reshape(self.num_envs, *field.shape)

    def _collect_final(self, over: NDArray[np.bool_]) -> dict[str, Any]:
        """Return the last observations of the worlds whose episodes ended (``over``, bool[n]), as Gymnasium's info."""
        observations = np.full(self.num_envs, None, object)
        last = self._observe()
        for i in np.flatnonzero(over).tolist():
            observations[i] = {name: numbers[i] for name, numbers in last.items()}
            observations[i]["direction"] = int(last["direction"][i])
        return build_end_info(over, observations)

    def worlds_in_turn(self) -> Iterator[Any]:
        """Yield each world in turn, as one environment. Changes made to it are written back to the batch."""
        world = self._world
        for i in range(self.num_envs):
            kept = dict.fromkeys(world.kept)
            own_numbers(world)[:] = self._own[i]
            for name in kept:
                kept[name] = getattr(world, name)
            world.restore(GridSnapshot(self._rows[i], self._rng_states[i], self._missions[i], kept))
            yield world
            saved = world.save()
            self._rows[i] = saved.row
            self._rng_states[i] = saved.rng_state
            self._own[i] = own_numbers(world)

    def is_readable(self, name: str) -> bool:
        """Return whether `get_attr` supports an attribute: one that batches list, or a declared field."""
        return name in self.readable or any(field.name == name for field in self._world.own_fields)

    def save(self) -> OwnBatchSnapshot:
        """Return an exact copy of every world in mid-episode, which can be pickled."""
        arrays = self._rows.copy(), self._own.copy(), self._rng_states.copy()
        return OwnBatchSnapshot(*arrays, self._missions, [*self._seeds])

    def restore(self, saved: OwnBatchSnapshot) -> None:
        """Restore a saved state. The copy is not consumed.

        Raises:
            WorldError: if a batch of another size saved it.
        """
        saved = self._check_saved(saved, OwnBatchSnapshot)
        self._rows[:] = saved.rows
        self._own[:] = saved.own
        self._rng_states[:] = saved.rng_states
        self._missions = saved.missions
        self._seeds = [*saved.seeds]
