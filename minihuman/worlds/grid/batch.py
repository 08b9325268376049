"""GridBatch: many grid worlds of one family, stepped in one call, as a Gymnasium vector environment.

The states are the rows of a matrix, one per world, and one kernel steps them all. Each world of a batch behaves as it
would alone: same layouts, random draws, observations, rewards and ends. The rows are int16 while all their values fit,
so that more rows fit into the nearest caches; otherwise they are int32, as for a single world.
"""

import os
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from minihuman.errors import WorldError
from minihuman.worlds.grid.babyai.encoding import block_of, noted_of
from minihuman.worlds.grid.babyai.instruction_space import InstructionSpace
from minihuman.worlds.grid.babyai.verifier import act_unedited, hand_over
from minihuman.worlds.grid.batch_names import MOST_OBJECTS, NARROW, GridBatchNames, RowMatrix
from minihuman.worlds.grid.core.rewards import INSTRUCTED
from minihuman.worlds.grid.core.rules import TERMINATED, TRUNCATED, act_inline
from minihuman.worlds.grid.core.state import (
    ACTIONS,
    CARRYING,
    DIRECTION,
    FAILED,
    HEIGHT,
    MAX_STEPS,
    NEW,
    OBJECTS,
    OVER,
    PHASE,
    PLAYING,
    TASK,
    Row,
    State,
    X,
    Y,
    clear,
)
from minihuman.worlds.grid.core.view import (
    TOGETHER,
    USUAL_VIEW,
    fetch_header,
    fetch_usual,
    is_usual,
    look_usual,
    see,
    show,
    show_usual,
    spread_usual,
)
from minihuman.worlds.grid.env import GridEnv
from minihuman.worlds.grid.layout import Recipe
from minihuman.worlds.kernels import inline, int64, kernel
from minihuman.worlds.options import BatchSeeds, seeds_per_world
from minihuman.worlds.rng import RngState, read_rng_state, write_rng_state
from minihuman.worlds.shared_work import APART, DONE, TAKEN, Counters, add_to_counter, share_work
from minihuman.worlds.simd import simd_function

MODES = (AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP, AutoresetMode.DISABLED)
NEXT_STEP, SAME_STEP, DISABLED = range(len(MODES))

MANY = 256  # worlds; smaller batches stay in the nearest caches, and their states are not prefetched
LEAD = 8  # worlds between the one that is stepped and the one whose cells are prefetched
LINE = 32  # numbers that a cache line holds
PART = 64  # worlds that a thread takes at a time
MIN_SHARE = 2048  # worlds per thread; with fewer, waking another thread saves little

Observation = dict[str, Any]  # image uint8[n, size, size, 3], direction int64[n], mission: n strings


class GridBatch(gymnasium.vector.VectorEnv[Observation, NDArray[np.int64], NDArray[Any]], GridBatchNames):
    """A batch of ``num_envs`` worlds of a family that are alike but for their seeds.

    Args:
        family: one of ``env.FAMILIES``.
        num_envs: the number of worlds.
        autoreset_mode: Gymnasium's name for the behaviour after an episode's end: "NextStep", "SameStep" or "Disabled".
        threads: the maximum number of threads, each of which steps two thousand worlds or more; None for one per core.
        options: the options of `GridEnv`.
    """

    def __init__(
        self,
        family: str | Callable[..., Recipe],
        *,
        num_envs: int = 1,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        threads: int | None = 1,
        **options: Any,
    ) -> None:
        if num_envs < 1:
            raise WorldError(f"num_envs is {num_envs!r}; use 1 or more")
        if threads is not None and threads < 1:
            raise WorldError(f"threads is {threads!r}; use 1 or more, or None for one per core")
        self._world = GridEnv(family, **options)  # what all have in common: spaces, recipe, settings
        self._mode = MODES.index(AutoresetMode(autoreset_mode))
        self.metadata = {**self._world.metadata, "autoreset_mode": MODES[self._mode]}
        self.num_envs = num_envs
        self.render_mode = self._world.render_mode
        self.single_action_space = self._world.action_space
        self.single_observation_space = self._world.observation_space
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._instructed = isinstance(self._world.mission_space, InstructionSpace)
        self._layout: Row = self._world.state.row.copy()  # where episodes are laid out
        narrow = max(len(self._layout), *self._layout.tolist()) <= NARROW
        self._rows = np.tile(self._layout.astype(np.int16 if narrow else np.int32), (num_envs, 1))
        self._rng_states: RngState = np.zeros((num_envs, 6), np.uint64)
        self._images = num_envs, *self._world.image_shape
        self._missions = (self._world.mission,) * num_envs
        self._seeds = [-1] * num_envs
        self._recipes = [self._world.recipe] * num_envs  # of each world's episodes until it is reset without a mission
        self._settings: dict[int, NDArray[np.int32]] = {}  # set with `set_attr`: a number per world, by index in a row
        self._over = np.zeros(num_envs, np.int64)  # the worlds that must be laid out anew after a step
        self._extra_threads = max(min(threads or os.cpu_count() or 1, num_envs // MIN_SHARE), 1) - 1

    @property
    def states(self) -> list[State]:
        """Return a copy of each world's state, with named fields."""
        return [State(row.astype(np.int32)) for row in self._rows]

    @property  # type: ignore[misc]  # Gymnasium's can be set; Gymnasium's own vectors give one per world too
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """Return a copy of each world's random generator. Drawing from it does not affect the world."""
        generators = tuple(np.random.default_rng(0) for _ in self._rng_states)
        for rng_state, generator in zip(self._rng_states, generators, strict=True):
            if rng_state.any():
                write_rng_state(rng_state, generator)
        return generators

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """Return the seed of each world, as given in its last seeded reset or drawn; -1 before its first reset."""
        return tuple(self._seeds)

    def reset(
        self, *, seed: BatchSeeds = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin a new episode in all worlds, or in those selected by ``options["reset_mask"]`` (bool[n]).

        World ``i`` takes the seed ``seed + i``, or ``seed[i]``; without a seed its random stream continues. The option
        ``"mission"`` sets the mission of all these worlds, as in `GridEnv.reset`. It also applies to episodes that
        autoreset begins, until the worlds are reset without it. Return all observations and an empty info.

        Raises:
            WorldError: if an option is not valid, or a layout has no free cell for something that it places.
        """
        seeds = seeds_per_world(seed, self.num_envs)
        mission = (options or {}).get("mission")
        if mission is None:
            recipe = self._world.recipe
        else:
            recipe = self._world.recipe.about(mission)
        mask = np.ones(self.num_envs, np.bool_)
        if options is not None and "reset_mask" in options:
            mask = np.asarray(options["reset_mask"])
            if mask.shape != (self.num_envs,) or mask.dtype != np.bool_:
                raise WorldError(
                    f"reset_mask has dtype {mask.dtype} and shape {mask.shape}; use bool and ({self.num_envs},)"
                )
        for i in np.flatnonzero(mask).tolist():
            self._recipes[i] = recipe
            rng_state = self._rng_states[i]
            if seeds[i] is not None or not rng_state.any():
                generator, self._seeds[i] = seeding.np_random(seeds[i])
                read_rng_state(generator, rng_state)
        images = np.zeros(self._images, np.uint8)
        directions = np.zeros(self.num_envs, np.int64)
        self._lay_out(np.flatnonzero(mask), images, directions)
        observe_many(self._rows, ~mask & (self._rows[:, PHASE] != NEW), images, directions)
        return {"image": images, "direction": directions, "mission": self._missions}, {}

    def step(
        self, actions: ArrayLike
    ) -> tuple[Observation, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Take one action in every world; return observations, rewards, terminated, truncated and info of Gymnasium.

        Raises:
            WorldError: if there is not one valid action per world, before `reset`, and, with autoreset disabled, after
                an episode's end. No world is changed then.
        """
        action_array = np.asarray(actions)
        if action_array.shape != (self.num_envs,) or action_array.dtype.kind not in "iu":
            raise WorldError(
                f"actions must be {self.num_envs} whole numbers, not {action_array.dtype}{action_array.shape}"
            )
        n = self.num_envs
        images = np.empty(self._images, np.uint8)
        directions = np.empty(n, np.int64)
        rewards = np.empty(n)
        terminated = np.empty(n, np.bool_)
        truncated = np.empty(n, np.bool_)
        numbers = np.ascontiguousarray(action_array, np.int64)
        results = images, directions, rewards, terminated, truncated
        step: Callable[..., int] = self._step_together if self._extra_threads else step_many
        count = step(self._rows, numbers, self._rng_states, *results, self._over, self._mode, 0, n, self._instructed)
        if count < 0:
            raise self._refusal(~count, action_array)
        info: dict[str, Any] = {}
        if count > 0:
            if self._mode == SAME_STEP:
                info = self._final(terminated | truncated, images, directions)
            self._lay_out(self._over[:count], images, directions)
        return (
            {"image": images, "direction": directions, "mission": self._missions},
            rewards,
            terminated,
            truncated,
            info,
        )

    def render(self) -> tuple[NDArray[np.uint8] | str | None, ...] | None:  # type: ignore[override]
        """Return the rendering of each world, or None without a render mode."""
        if self.render_mode is None:
            return None
        return self.call("render")

    def _refusal(self, world: int, actions: NDArray[np.integer[Any]]) -> WorldError:
        """Return the error that says why the world with the number ``world`` was not stepped."""
        phase = self._rows[world, PHASE]
        count = self._rows[world, ACTIONS]
        if phase == NEW or (phase == OVER and self._mode != NEXT_STEP):
            return WorldError(f"world {world} is not in an episode; call reset() before step()")
        return WorldError(f"action {int(actions[world])} does not exist in world {world}; actions are 0 to {count - 1}")

    def _step_together(self, *arguments: Any) -> int:
        """Run `step_many` in several threads, each of which takes parts of the worlds in turn; return its result.

        Args:
            arguments: the arguments of `step_many`, for all worlds.
        """
        rows, actions, *_ = arguments
        refusal = first_refusal(rows, actions, self._mode, 0, self.num_envs)
        if refusal < 0:
            return refusal
        *shared_arguments, _first, _last, instructed = arguments
        counts = np.zeros(-(-self.num_envs // PART), np.int64)  # of the worlds to lay out anew, by part
        share_work(step_parts, (counts, *shared_arguments, instructed), len(counts), self._extra_threads)
        ended = [self._over[part * PART :][:count] for part, count in enumerate(counts.tolist()) if count]
        self._over[: counts.sum()] = np.concatenate(ended) if ended else 0
        return int(counts.sum())

    def _lay_out(self, worlds: NDArray[np.int64], images: NDArray[np.uint8], directions: NDArray[np.int64]) -> None:
        """Lay out new episodes of the given worlds, and write their observations into ``images`` and ``directions``.

        Raises:
            WorldError: if a layout has no free cell for something that it places.
        """
        layout = self._layout
        space = self._world.mission_space
        missions = list(self._missions) if space.varies else []
        for i in worlds.tolist():
            clear(layout)
            for field, numbers in self._settings.items():
                layout[field] = numbers[i]
            self._recipes[i].lay_out(layout, self._rng_states[i])
            if not begin(layout, self._rows, i, images, directions):
                self._rows = self._rows.astype(np.int32)  # a number of the layout does not fit into int16
                begin(layout, self._rows, i, images, directions)
            if layout[FAILED]:
                raise WorldError(
                    f"world {i} of {self._world} has no free cell for something it places; make the grid larger"
                )
            if missions:
                missions[i] = space.of(layout)
        self._missions = tuple(missions) or self._missions

    def _final(
        self, over: NDArray[np.bool_], images: NDArray[np.uint8], directions: NDArray[np.int64]
    ) -> dict[str, Any]:
        """Return the info of a step for the worlds whose episodes it ended: their last observations, and no infos.

        ``over`` says which worlds these are, bool[n]; the other arrays are the observations of all worlds.
        """
        observations = np.full(self.num_envs, None, object)
        for i in np.flatnonzero(over).tolist():
            observations[i] = {"image": images[i].copy(), "direction": int(directions[i]), "mission": self._missions[i]}
        return {"final_obs": observations, "_final_obs": over, "final_info": {}, "_final_info": over.copy()}


_STEPPED = (
    "int64[::1], uint64[:, ::1], uint8[:, :, :, ::1], int64[::1], float64[::1], boolean[::1], boolean[::1], "
    "int64[::1], int64, "
)


@kernel(
    "(int16[:, ::1], " + _STEPPED + "int64, int64, boolean)",
    "(int32[:, ::1], " + _STEPPED + "int64, int64, boolean)",
    nogil=True,
)
def step_many(
    rows: RowMatrix,
    actions: NDArray[np.int64],
    rng_state: RngState,
    images: NDArray[np.uint8],
    directions: NDArray[np.int64],
    rewards: NDArray[np.float64],
    terminated: NDArray[np.bool_],
    truncated: NDArray[np.bool_],
    over: NDArray[np.int64],
    mode: int,
    first: int,
    last: int,
    instructed: bool,
) -> int:
    """Step the worlds from ``first`` to before ``last``.

    The worlds that autoreset must lay out anew are written to ``over``, starting at ``first``. A world whose episode
    has already ended is not stepped and earns nothing. With ``instructed``, the rows have space for an instruction.

    Returns:
        The number of worlds to lay out anew; or, if a world refuses its action or must not be stepped now, the
            complement (~) of the index of the first such world. No world is stepped then.
    """
    count = first_refusal(rows, actions, mode, first, last)
    for start in range(first, last if count == 0 else first, TOGETHER):
        end = min(start + TOGETHER, last)
        together = end - start == TOGETHER and is_usual(rows[start], images[start])
        for i in range(start, end):
            fetch(rows, i)
            if instructed:
                fetch_instruction(rows, i)
            status = 0
            rewards[i] = 0.0
            stepped = rows[i, PHASE] != OVER
            if stepped:
                status, rewards[i] = (
                    act_unedited(rows[i], actions[i], rng_state[i], True)
                    if instructed
                    else act_inline(rows[i], actions[i], rng_state[i])
                )
            if together:
                directions[i] = look_usual(rows[i], images[i])
            else:
                see(rows[i], images[i])
                directions[i] = rows[i, DIRECTION]
            terminated[i] = status & TERMINATED != 0
            truncated[i] = status & TRUNCATED != 0
            over[first + count] = i  # overwritten by the next world unless the count grows
            count += not stepped or (mode == SAME_STEP and status != 0)
        if together:
            spread_usual(directions, start)
            for i in range(start, end):
                show_usual(images[i], directions, i)
                show(images[i], USUAL_VIEW // 2, USUAL_VIEW - 1, int64(rows[i, CARRYING]))
                directions[i] = rows[i, DIRECTION]
    return count


@kernel(
    "(int64[::1], int64[::1], int16[:, ::1], " + _STEPPED + "boolean, int64)",
    "(int64[::1], int64[::1], int32[:, ::1], " + _STEPPED + "boolean, int64)",
    nogil=True,
)
def step_parts(
    counters: Counters,
    counts: NDArray[np.int64],
    rows: RowMatrix,
    actions: NDArray[np.int64],
    rng_state: RngState,
    images: NDArray[np.uint8],
    directions: NDArray[np.int64],
    rewards: NDArray[np.float64],
    terminated: NDArray[np.bool_],
    truncated: NDArray[np.bool_],
    over: NDArray[np.int64],
    mode: int,
    instructed: bool,
    nth: int,
) -> None:
    """Run `step_many` for parts of the worlds, sharing them with other threads; write its results to ``counts``.

    A thread begins with its own share, number ``nth``, so that the same worlds stay in its core's nearest caches.
    """
    threads = len(counters) // APART - 1
    for turn in range(nth, nth + threads):
        share = turn % threads
        start = len(counts) * share // threads
        end = len(counts) * (share + 1) // threads
        part = start + add_to_counter(counters, TAKEN + APART * share, 1)
        while part < end:
            first = part * PART
            last = min(part * PART + PART, len(rows))
            counts[part] = step_many(
                rows,
                actions,
                rng_state,
                images,
                directions,
                rewards,
                terminated,
                truncated,
                over,
                mode,
                first,
                last,
                instructed,
            )
            add_to_counter(counters, DONE, 1)
            part = start + add_to_counter(counters, TAKEN + APART * share, 1)


@inline
def fetch(rows: RowMatrix, i: int) -> None:
    """Prefetch the state of worlds after world ``i`` if the batch is too large for the nearest caches."""
    if len(rows) >= MANY:
        fetch_header(rows[min(i + 2 * LEAD, len(rows) - 1)])
        fetch_usual(rows[min(i + LEAD, len(rows) - 1)])


@inline
def fetch_instruction(rows: RowMatrix, i: int) -> None:
    """Prefetch the part of the state of a world after world ``i`` that the verifier of its instruction reads."""
    if len(rows) >= MANY:
        soon = rows[min(i + LEAD, len(rows) - 1)]
        block = block_of(soon)
        fetch_numbers(soon, block, block + LINE, noted_of(soon) + soon[X] * soon[HEIGHT] + soon[Y])


@simd_function()
def fetch_numbers(ops: Any, row: Row, first: Any, second: Any, third: Any) -> None:
    """Prefetch the elements of a row at the three indices ``first``, ``second`` and ``third``."""
    for at in (first, second, third):
        ops.prefetch(row, at)


@kernel(
    "(int16[:, ::1], int64[::1], int64, int64, int64)",
    "(int32[:, ::1], int64[::1], int64, int64, int64)",
    hold_gil=True,
)
def first_refusal(rows: RowMatrix, actions: NDArray[np.int64], mode: int, first: int, last: int) -> int:
    """Return the complement (~) of the index of the first world that cannot be stepped, or 0 if there is none.

    Only the worlds from ``first`` to before ``last`` are tested. A world cannot be stepped if its action does not
    exist, or if it is not in an episode. In the mode NEXT_STEP, a world whose episode has ended can be stepped.
    """
    for i in range(first, last):
        phase = rows[i, PHASE]
        ready = phase == PLAYING or (mode == NEXT_STEP and phase == OVER)
        if not ready or actions[i] < 0 or actions[i] >= rows[i, ACTIONS]:
            return ~i
    return 0


@kernel(
    "(int32[::1], int16[:, ::1], int64, uint8[:, :, :, ::1], int64[::1])",
    "(int32[::1], int32[:, ::1], int64, uint8[:, :, :, ::1], int64[::1])",
    hold_gil=True,
)
def begin(layout: Row, rows: RowMatrix, i: int, images: NDArray[np.uint8], directions: NDArray[np.int64]) -> bool:
    """Copy a laid-out row into row ``i``, and begin the episode with its observation unless the layout failed.

    The observation is written into ``images[i]`` and ``directions[i]``. Return True if the row was copied; return
    False, without copying, if the numbers of the layout do not fit into the dtype of ``rows``.
    """
    if rows.itemsize < layout.itemsize and (layout[OBJECTS] > MOST_OBJECTS or layout[MAX_STEPS] > NARROW):
        return False
    row = rows[i]
    for k in range(len(layout)):
        row[k] = layout[k]
    if row[FAILED] == 0:
        row[PHASE] = PLAYING
        see(row, images[i])
        directions[i] = row[DIRECTION]
        if row[TASK] == INSTRUCTED:
            hand_over(row)
    return True


@kernel(
    "(int16[:, ::1], boolean[::1], uint8[:, :, :, ::1], int64[::1])",
    "(int32[:, ::1], boolean[::1], uint8[:, :, :, ::1], int64[::1])",
    nogil=True,
)
def observe_many(
    rows: RowMatrix, selected: NDArray[np.bool_], images: NDArray[np.uint8], directions: NDArray[np.int64]
) -> None:
    """Write the views and directions of the worlds that ``selected`` marks into ``images`` and ``directions``."""
    for i in range(len(rows)):
        if selected[i]:
            see(rows[i], images[i])
            directions[i] = rows[i, DIRECTION]
