"""FirstPersonBatch: many first-person worlds of one kind, stepped in one call and drawn on all cores.

Each world of a batch behaves as it would alone. The module also has the functions with which Gymnasium makes the
catalogue's worlds, single or in batches.
"""

import os
from collections.abc import Callable, Iterator, Sequence
from importlib import import_module
from itertools import chain, pairwise
from typing import Any, ClassVar, NamedTuple

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space, concatenate, create_empty_array, iterate
from numpy.typing import ArrayLike, NDArray

from minihuman.errors import WorldError
from minihuman.worlds.first_person.batch_kernels import (
    AFTER,
    EARNED,
    HEADING,
    NOTHING,
    OWN_SIZE,
    ROW_SIZE,
    SKIPPED,
    USE,
    act_together,
    move_together,
)
from minihuman.worlds.first_person.entities import LATEST_CHANGE
from minihuman.worlds.first_person.env import FirstPersonEnv
from minihuman.worlds.first_person.motion_kernels import COMMAND_SIZE, COMMAND_TURN, RADIANS
from minihuman.worlds.first_person.parameter_names import read_parameters
from minihuman.worlds.first_person.render.drawing import RenderTarget, turn
from minihuman.worlds.first_person.render.rasterisation import ROOM
from minihuman.worlds.first_person.render.render_pool import RenderPool, addresses
from minihuman.worlds.first_person.rules import (
    MOVED,
    TERMINATED,
    TRUNCATED,
    TURN_DEG,
    TURN_LEFT,
    TURN_RIGHT,
    VELOCITY,
)
from minihuman.worlds.first_person.snapshot import FirstPersonSnapshot
from minihuman.worlds.options import BatchSeeds, seeds_per_world
from minihuman.worlds.shared_work import helper_threads
from minihuman.worlds.vector_names import VectorNames

Stepped = tuple[Any, NDArray[np.float64], NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]


class FirstPersonBatchSnapshot(NamedTuple):
    """An exact copy of the state of a batch's worlds; only ``save`` makes one and only ``restore`` reads it."""

    worlds: tuple[FirstPersonSnapshot, ...]
    over: NDArray[np.bool_]


class FirstPersonBatch(gymnasium.vector.VectorEnv[Any, NDArray[np.int64], NDArray[Any]], VectorNames):
    """A batch of ``num_envs`` worlds that differ only in their seeds.

    Args:
        make: a function that makes one of the worlds
        num_envs: the number of worlds
        autoreset_mode: what happens after an episode's end, in Gymnasium's terms: "NextStep", "SameStep" or "Disabled"
        threads: the number of pictures that are drawn at once; None for one per core
    """

    readable: ClassVar[frozenset[str]] = frozenset(
        {"action_names", "actions", "agent", "domain_rand", "entities", "light_ambient", "light_color", "light_pos"}
        | {"max_episode_steps", "max_forward_step", "max_steps", "max_x", "max_z", "min_x", "min_z", "params"}
        | {"render_mode", "rooms", "sky_color", "stage", "step_count", "wall_segs"}
    )
    methods: ClassVar[frozenset[str]] = frozenset(
        {"depth", "get_visible_ents", "info", "intersect", "map", "move_agent", "near", "observe", "picture", "pose"}
        | {"path_length_bounds", "render", "render_depth", "render_obs", "render_top_view", "save", "scene_hash"}
        | {"see", "shortest_path", "state_hash", "subgoals", "targets", "turn_agent", "visible_entities"}
    )
    settable: ClassVar[frozenset[str]] = frozenset(
        {"light_ambient", "light_color", "light_pos", "max_episode_steps", "max_steps", "sky_color", "step_count"}
    )

    def __init__(
        self,
        make: Callable[[], FirstPersonEnv],
        *,
        num_envs: int = 1,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        threads: int | None = None,
    ) -> None:
        if num_envs < 1:
            raise WorldError(f"num_envs is {num_envs}; use 1 or more")
        self.worlds = [make() for _ in range(num_envs)]
        first = self.worlds[0]
        self._autoreset = AutoresetMode(autoreset_mode)
        self.metadata = {**first.metadata, "autoreset_mode": self._autoreset}
        self.num_envs = num_envs
        self.render_mode = first.render_mode
        self.single_action_space = first.action_space
        self.single_observation_space = first.observation_space
        self.action_space = batch_space(first.action_space, num_envs)
        self.observation_space = batch_space(first.observation_space, num_envs)
        self._over = np.zeros(num_envs, np.bool_)  # whether each world's episode ended in the last step
        self._threads = threads or os.cpu_count() or 1
        self._render_pool = RenderPool(num_envs, self._threads)
        kind = type(first)
        draws_itself = kind.observe is not FirstPersonEnv.observe or kind.see is not FirstPersonEnv.see
        self._draws_together = num_envs > 1 and not draws_itself
        kernels_step = kind.advance is FirstPersonEnv.advance and first.kernels_judge and not first.domain_rand
        self._joint: JointStep | None = None
        if self._draws_together and kernels_step and first.control == "discrete":
            self._joint = JointStep(self.worlds)
        elif self._draws_together and kernels_step and first.control != "discrete-strafe" and not _turns_by_hand(first):
            self._joint = JointMotion(self.worlds)

    @property  # type: ignore[misc]  # Gymnasium's can be set; Gymnasium's own vectors give one per world too
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """Return the random stream of each world."""
        return tuple(world.np_random for world in self.worlds)

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """Return the seed that each world was last given or drew; -1 before its first reset."""
        seeds = [world._np_random_seed for world in self.worlds]
        return tuple(-1 if seed is None else seed for seed in seeds)

    def reset(self, *, seed: BatchSeeds = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin new episodes in all worlds, or in those marked in ``options["reset_mask"]`` (bool[n]).

        World ``i`` takes the seed ``seed + i`` or ``seed[i]``. Without a seed, its random stream continues. The
        observations and infos of all worlds are returned.

        Raises:
            WorldError: if the mask is not bool[n], or the seeds do not fit the batch.
        """
        seeds = seeds_per_world(seed, self.num_envs)
        chosen = np.ones(self.num_envs, np.bool_)
        if options is not None and "reset_mask" in options:
            chosen = np.asarray(options["reset_mask"])
            if chosen.shape != (self.num_envs,) or chosen.dtype != np.bool_:
                raise WorldError(f"reset_mask is {chosen.dtype}{chosen.shape}; it must be bool({self.num_envs},)")

        for i in np.flatnonzero(chosen).tolist():
            self.worlds[i].begin(seed=seeds[i])
        self._over[chosen] = False
        return self._observe_all(range(self.num_envs))

    def step(self, actions: ArrayLike) -> Stepped:
        """Step every world by its action; return observations, rewards, terminated, truncated and infos.

        Raises:
            WorldError: before ``reset``, if the actions are not one valid action per world, or after an episode's end
                if autoreset is disabled. No world has changed then.
        """
        joint = self._joint
        if joint is not None and not joint.is_current():
            joint = None
        action_array = self._read_actions(actions, one_by_one=joint is None)
        resets_at_once = self._autoreset is AutoresetMode.SAME_STEP
        renewed = self._over & (self._autoreset is AutoresetMode.NEXT_STEP)
        rewards = np.zeros(self.num_envs)
        statuses = np.full(self.num_envs, -1)
        if joint is not None:
            joint.step(action_array, renewed, rewards, statuses)
        was_stepped = statuses >= 0
        terminated, truncated = (was_stepped & (statuses & part != 0) for part in (TERMINATED, TRUNCATED))
        # The worlds that did other than move, or made no joint step (-1 has every bit); Python handles them.
        changed = np.flatnonzero(statuses & ~MOVED).tolist()
        final: dict[int, tuple[Any, dict[str, Any]]] = {}  # last observations and infos of worlds that begin anew
        for i in changed:
            world = self.worlds[i]
            if renewed[i]:
                world.begin()
                continue
            if not was_stepped[i]:
                rewards[i], terminated[i], truncated[i] = world.advance(action_array[i])
            is_over = bool(terminated[i] or truncated[i])
            vars(world)["_over"] = is_over
            if resets_at_once and is_over:
                final[i] = world.observe(), world.info()
                world.begin()
        observations, infos = self._observe_all(changed)
        over = terminated | truncated
        self._over = np.zeros_like(over) if resets_at_once else over
        return observations, rewards, terminated, truncated, infos | self._collect_final(final)

    def _read_actions(self, actions: Any, *, one_by_one: bool) -> Any:
        """Return the worlds' actions after checking them: their numbers, or for continuous worlds actions or commands.

        Raises:
            WorldError: in the same cases as `step`.
        """
        if isinstance(self.single_action_space, gymnasium.spaces.Discrete):
            return self._check_actions(actions, one_by_one=one_by_one)
        if one_by_one:
            return self._check_continuous_actions(actions)
        return self._read_commands(actions)

    def _check_actions(self, actions: ArrayLike, *, one_by_one: bool) -> NDArray[Any]:
        """Return the actions as an array after checking them; if ``one_by_one``, every world checks its own action.

        Worlds also check one by one if any action is out of range.

        Raises:
            WorldError: in the same cases as `step`.
        """
        action_array = np.asarray(actions)
        if action_array.shape != (self.num_envs,) or action_array.dtype.kind not in "iu":
            raise WorldError(
                f"actions must be {self.num_envs} whole numbers, not {action_array.dtype}{action_array.shape}"
            )
        if one_by_one or not 0 <= action_array.min() <= action_array.max() < len(self.worlds[0].action_names):
            for world, action in zip(self.worlds, action_array.tolist(), strict=True):
                world.check(action)
        self._require_running()
        return action_array

    def _check_continuous_actions(self, actions: Any) -> list[Any]:
        """Split the actions of a batch by world, let each world check its own, and return them in a list.

        Raises:
            WorldError: in the same cases as `step`.
        """
        separate = list(iterate(self.action_space, actions))
        if len(separate) != self.num_envs:
            raise WorldError(f"there are {len(separate)} actions; a batch of {self.num_envs} worlds needs one for each")
        for world, action in zip(self.worlds, separate, strict=True):
            world.check(action)
        self._require_running()
        return separate

    def _read_commands(self, actions: Any) -> NDArray[np.float64]:
        """Return the command of each world, float64[n, COMMAND_SIZE + 1], as `move_together` takes it.

        Raises:
            WorldError: in the same cases as `step`.
        """
        first = self.worlds[0]
        assert first._continuous is not None
        read_actions = first._continuous.read_all(actions, self.num_envs)
        if read_actions is None:
            self._check_continuous_actions(actions)
            raise WorldError(f"the actions are not in {self.action_space}; give one for each world")
        self._require_running()
        components, uses = read_actions
        commands = np.zeros((self.num_envs, COMMAND_SIZE + 1))
        commands[:, : components.shape[1]] = components
        commands[:, USE] = np.array((NOTHING, *first.use_actions))[uses]
        return commands

    def _require_running(self) -> None:
        """Check that no episode is over if autoreset is disabled.

        Raises:
            WorldError: if an episode is over.
        """
        if self._autoreset is AutoresetMode.DISABLED and self._over.any():
            raise WorldError(
                f"the episode of world {int(np.argmax(self._over))} is over; reset it with options['reset_mask'] first"
            )

    def render(self) -> tuple[NDArray[np.uint8] | None, ...] | None:  # type: ignore[override]
        """Return the rendered picture of each world; None without a render mode."""
        if self.render_mode is None:
            return None
        return tuple(helper_threads(os.getpid()).map(lambda world: world.render(), self.worlds))

    @property
    def envs(self) -> list[FirstPersonEnv]:
        """Return the worlds of the batch."""
        return self.worlds

    def is_readable(self, name: str) -> bool:
        """Return whether `get_attr` can read an attribute: one in ``readable``, or one of a world's state."""
        return name in self.readable or name in self.worlds[0].own_attributes()

    def worlds_in_turn(self) -> Iterator[FirstPersonEnv]:
        """Yield each world in turn."""
        return iter(self.worlds)

    def save(self) -> FirstPersonBatchSnapshot:
        """Return an exact copy of every world's state, for pickling or for restoring into a batch of the same size."""
        return FirstPersonBatchSnapshot(tuple(world.save() for world in self.worlds), self._over.copy())

    def restore(self, saved: FirstPersonBatchSnapshot) -> None:
        """Restore a saved state, which can be restored again.

        Raises:
            WorldError: if the state comes from a batch of another size or another kind of world.
        """
        if not isinstance(saved, FirstPersonBatchSnapshot) or len(saved.worlds) != self.num_envs:
            raise WorldError(f"this was not saved by a batch of {self.num_envs} such worlds; pass what save() returned")
        for world, snapshot in zip(self.worlds, saved.worlds, strict=True):
            world.restore(snapshot)
        self._over = saved.over.copy()

    def _observe_all(self, changed: Sequence[int]) -> tuple[Any, dict[str, Any]]:
        """Return the observations and infos of all worlds.

        Args:
            changed: the indices of worlds that have changed otherwise than by a move in the kernels
        """
        if not self._draws_together:
            return self._observe_in_threads(), self._infos()
        if self._joint is None:
            targets = [world.aim_target() for world in self.worlds]
        else:
            targets = self._joint.aim_targets(changed)
        batch: Any = create_empty_array(self.single_observation_space, self.num_envs, np.empty)
        self._render_pool.paint(targets, batch)
        return batch, self._infos()

    def _observe_in_threads(self) -> Any:
        """Return the observations of worlds that define their own kind of observation."""
        # each thread gets a run of neighbouring worlds in a single call
        ends = [self.num_envs * nth // self._threads for nth in range(self._threads + 1)]
        shares = [self.worlds[first:last] for first, last in pairwise(ends) if first < last]
        observations = helper_threads(os.getpid()).map(lambda share: [world.observe() for world in share], shares)
        batch: Any = create_empty_array(self.single_observation_space, self.num_envs)
        return concatenate(self.single_observation_space, list(chain.from_iterable(observations)), batch)

    def _infos(self) -> dict[str, Any]:
        """Return the infos of all worlds in Gymnasium's form; {} if their class defines none."""
        infos: dict[str, Any] = {}
        if type(self.worlds[0]).info is FirstPersonEnv.info:
            return infos
        for i, world in enumerate(self.worlds):
            infos = self._add_info(infos, world.info(), i)
        return infos

    def _collect_final(self, final: dict[int, tuple[Any, dict[str, Any]]]) -> dict[str, Any]:
        """Return the last observations and infos of the worlds whose episodes ended, in Gymnasium's form."""
        if not final:
            return {}
        observations = np.full(self.num_envs, None, object)
        over = np.zeros(self.num_envs, np.bool_)
        infos: dict[str, Any] = {}
        for i, (observation, info) in final.items():
            observations[i] = observation
            over[i] = True
            infos = self._add_info(infos, info, i)
        return {"final_obs": observations, "_final_obs": over, "final_info": infos, "_final_info": over}


class JointStep:
    """A joint step of a batch's worlds in one call, for worlds that only kernels step.

    The worlds' entities are updated afterwards.
    """

    def __init__(self, worlds: Sequence[FirstPersonEnv]) -> None:
        count = len(worlds)
        self._worlds = worlds
        self._all = np.arange(count)
        self._latest = -1
        self._counts = self._count()  # the counts when the views were aimed
        nothing: list[Any] = [None] * count
        self._flats, self._arrays, self._targets, self._agents = (nothing.copy() for _ in range(4))
        self._trigs = [0] * count
        self._rows = np.zeros((count, ROW_SIZE), np.int64)
        self._own = np.zeros((count, OWN_SIZE))
        self._turns_rad = np.zeros((count, len(worlds[0].action_names)))

    def __reduce__(self) -> tuple[Any, ...]:
        return JointStep, (self._worlds,)

    def is_current(self) -> bool:
        """Return whether nothing else has changed the worlds since their views were aimed."""
        return self._latest == LATEST_CHANGE[0] and self._counts == self._count()

    def step(
        self,
        actions: NDArray[Any],
        skipped: NDArray[np.bool_],
        rewards: NDArray[np.float64],
        statuses: NDArray[np.int64],
    ) -> None:
        """Step every world that is not skipped; write its reward and its status as in `rules.act`, or 0 and -1."""
        self._latest = -1  # until all views are aimed
        has_score = bool(self._flats[0].score)
        if has_score:
            for flat, world in zip(self._flats, self._worlds, strict=True):
                flat.write_counts(world)
        self._act(actions, skipped, statuses)
        rewards[:] = np.where(skipped, 0.0, self._own[:, EARNED])
        poses = self._own[:, : HEADING + 1].tolist()
        outcomes = zip(self._worlds, self._flats, self._agents, poses, statuses.tolist(), strict=True)
        for world, flat, agent, (x, y, z, heading), status in outcomes:
            if status >= 0:
                vars(world)["step_count"] += 1
                agent["pos"] = (x, y, z)
                agent["dir"] = heading
                if has_score or status & _MORE:
                    flat.apply_step(world, status)

    def _act(self, actions: NDArray[Any], skipped: NDArray[np.bool_], statuses: NDArray[np.int64]) -> None:
        """Do the actions of the worlds that are not skipped in the kernels' arrays; write the statuses."""
        numbers = np.where(skipped, -1, actions.astype(np.int64))
        self._turn_to(self._own[:, HEADING] + self._turns_rad[self._all, numbers])
        act_together(self._rows, numbers, self._own, statuses)

    def _turn_to(self, headings: NDArray[np.float64]) -> None:
        """Compute the sines and cosines of the headings (rad) after a turn, and write them to the kernels' arrays."""
        self._own[:, AFTER:EARNED] = list(map(turn, headings.tolist(), self._trigs))

    def aim_targets(self, changed: Sequence[int]) -> list[RenderTarget]:
        """Return the render targets of all worlds, after reading the state of changed worlds anew.

        Args:
            changed: the indices of worlds that have changed otherwise than by a move in the kernels
        """
        for i in changed:
            world = self._worlds[i]
            flat = world.flat_state()
            agent = world.agent
            target = world.aim_target()
            flat.write_counts(world)
            self._flats[i] = flat
            self._targets[i] = target
            self._agents[i] = vars(agent)
            self._trigs[i] = agent.trig
            self._arrays[i] = flat.things, flat.numbers, flat.walls, target.view
            # Of the view, a row has the address alone, and then the number of spans for which there is memory.
            self._rows[i] = *addresses(*self._arrays[i])[:-1], target.view[ROOM]
            # The heading after a turn and the reward (0.0) are written at each step.
            self._own[i] = *agent.pos, agent.dir, *turn(agent.dir, agent.trig), 0.0, 0.0, 0.0, agent.cam_fwd_disp
            signs = [(motion == TURN_LEFT) - (motion == TURN_RIGHT) for motion in flat.motions]
            self._turns_rad[i] = np.array(signs) * flat.turn_rad
        self._latest = LATEST_CHANGE[0]
        self._counts = self._count()
        return self._targets

    def _count(self) -> tuple[list[int], int]:
        """Return the step count of each world and the number of all entities, to detect that a world was used alone."""
        stages = [world._stage for world in self._worlds]
        return [world.step_count for world in self._worlds], sum(len(stage.entities) for stage in stages if stage)


class JointMotion(JointStep):
    """A joint step of worlds with continuous actions, of which each has a command."""

    def __reduce__(self) -> tuple[Any, ...]:
        return JointMotion, (self._worlds,)

    def _act(self, actions: NDArray[Any], skipped: NDArray[np.bool_], statuses: NDArray[np.int64]) -> None:
        """Do the commands of the worlds that are not skipped in the kernels' arrays; write the statuses."""
        commands = actions.copy()
        commands[skipped, USE] = SKIPPED
        widest_rad = np.array([flat.numbers[TURN_DEG] for flat in self._flats]) * RADIANS
        self._turn_to(self._own[:, HEADING] + commands[:, COMMAND_TURN] * widest_rad)
        move_together(self._rows, commands, self._own, statuses)
        if self._worlds[0].acceleration:
            for world, flat in zip(self._worlds, self._flats, strict=True):
                vars(world)["velocity"] = tuple(flat.numbers[VELOCITY : VELOCITY + 2].tolist())


def _turns_by_hand(world: FirstPersonEnv) -> bool:
    """Return whether one of a world's named actions besides its continuous ones turns the agent by a fixed angle."""
    names = (world.motions.get(world.kernel_actions[number], "") for number in world.use_actions)
    return any(name in ("turn_left", "turn_right") for name in names)


_MORE = ~(MOVED | TERMINATED | TRUNCATED)  # the parts of a step's status that change more than the body's place
_MOVED_LAYOUTS = {  # by their names in data sets that were exported earlier
    "transfer:GoToObj": "layouts.go_to_obj:GoToObj",
    "layouts.sidewalk:Sidewalk": "layouts.connected_rooms:Sidewalk",
}


def make_world(layout: str, **options: Any) -> FirstPersonEnv:
    """Make a world of a layout class of this package, as in ``make_world("layouts.mazes:Maze", num_rows=3)``."""
    module, _, name = _MOVED_LAYOUTS.get(layout, layout).partition(":")
    if "params" in options:
        options["parameters"] = read_parameters(options.pop("params"))
    world: FirstPersonEnv = getattr(import_module(f"minihuman.worlds.first_person.{module}"), name)(**options)
    world._is_made = True
    return world


def make_batch(layout: str, **options: Any) -> FirstPersonBatch:
    """Make a batch of the worlds that `make_world` makes, for ``gymnasium.make_vec``."""
    settings = {name: options.pop(name) for name in {"num_envs", "autoreset_mode", "threads"} & options.keys()}
    return FirstPersonBatch(lambda: make_world(layout, **options), **settings)


vars(make_world)["metadata"] = FirstPersonEnv.metadata  # Gymnasium reads there which render modes it has to add
