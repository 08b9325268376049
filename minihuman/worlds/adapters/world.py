"""World: any Gymnasium environment with the interface that a session needs.

Native worlds implement the interface themselves. Worlds built like Minigrid's or Miniworld's are read through their
attributes. Any other world can be played, too, without pose and map. The module knows neither keys nor time. A world is
imported only from a trusted module.
"""

import copy
import logging
import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any, ClassVar, Literal, TypeVar

import gymnasium
import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.trust import locate_world
from minihuman.worlds.adapters.environment import (
    has_own_reward_rule,
    is_built_in,
    make_environment,
    require_stated_space,
)
from minihuman.worlds.adapters.foreign_code import WorldCodeError, contain_errors
from minihuman.worlds.adapters.returned_values import (
    explain_unhashable,
    read_onset,
    read_picture,
    read_reset,
    read_step,
)
from minihuman.worlds.adapters.seat import SeatEnv
from minihuman.worlds.adapters.spaces import Action, build_actions
from minihuman.worlds.adapters.transition import ResetResult, StepResult
from minihuman.worlds.adapters.upstream import MinigridAdapter, MiniworldAdapter, is_minigrid_like, is_miniworld_like
from minihuman.worlds.adapters.world_text import describe_observation, draw_text
from minihuman.worlds.adapters.wrapper_state import WrapperState
from minihuman.worlds.contract import UNKNOWN_BOUNDS, NativeWorld, Palette, PathLengthBounds, View, answer_to_old_names
from minihuman.worlds.hashing import hash64
from minihuman.worlds.pose import Map, Pose
from minihuman.worlds.step_limit import elapsed_steps, set_elapsed_steps, step_limit_of
from minihuman.worlds.team import PictureTiles

LOG = logging.getLogger("minihuman")
T = TypeVar("T")


class World:
    """A Gymnasium environment with one interface, which must be reset before any other use.

    Args:
        world_id: a Gymnasium id, if needed after the module that registers it and a colon
        options: the keyword arguments of ``gymnasium.make``
        trusted: whether the user named the world, not a protocol or a log, so that any module is imported for it

    Raises:
        WorldError: if the world cannot be made, is not trusted, has actions that keys cannot do, or cannot draw itself.
    """

    has_portable_copies: ClassVar[bool] = True  # whether another world of this id and options can restore its copies

    def __init__(self, world_id: str, options: dict[str, Any] | None = None, *, trusted: bool = False) -> None:
        self.id = world_id
        self.options = options or {}
        with contain_errors(world_id, "its code"):
            self._env = make_environment(world_id, self.options if trusted else locate_world(world_id, self.options))
            self.is_built_in = is_built_in(self._env)
            native = self._env.unwrapped
            self.drawn = isinstance(native, NativeWorld) and native.drawn  # see `NativeWorld.drawn`
            self.reward_means_success = has_own_reward_rule(native)
            require_stated_space(world_id, self._env, "action_space")
            self.actions = build_actions(world_id, self._env)
            require_stated_space(world_id, self._env, "observation_space")
            self._wrappers = WrapperState(self._env)
        self.action_names = self.actions.names
        self._native: NativeWorld | None = None
        self._observation: Any = None
        self._has_advanced = False  # whether steps were made after the latest observation
        self._steps = 0

    @property
    def unwrapped(self) -> Any:
        """Return the environment itself, for agents that may use more than the picture."""
        return self._env.unwrapped

    @property
    def env(self) -> gymnasium.Env[Any, Any]:
        """Return the environment with its wrappers, for checks of what the wrappers change."""
        return self._env

    @property
    def is_compiled(self) -> bool:
        """Return whether compiled kernels alone step and draw the world, so that a page can compute it."""
        env = self._env.unwrapped
        return isinstance(env, NativeWorld) and env.is_compiled and not self._wrappers.any

    @property
    def knows_state(self) -> bool:
        """Return whether the environment reveals its whole state; otherwise, hashes cover what can be observed."""
        return self._native is not None

    @property
    def observation(self) -> Any:
        """Return the observation of the latest reset or step; `advance` leaves it as it is."""
        return self._observation

    @property
    def observation_space(self) -> gymnasium.Space[Any]:
        """Return the space of the world's observations."""
        return self._env.observation_space

    @property
    def action_space(self) -> gymnasium.Space[Any]:
        """Return the space of the world's actions."""
        return self._env.action_space

    @property
    def step_limit(self) -> int | None:
        """Return the environment's own step limit per episode; None if it states no number."""
        if self.is_built_in:
            return step_limit_of(self._env)
        stated = self._call("max_steps", getattr, self._env.unwrapped, "max_steps", None)
        if self._env.spec:
            registered = self._env.spec.max_episode_steps
        else:
            registered = None
        limits = [limit for limit in (stated, registered) if isinstance(limit, int | float | np.number)]
        return min((int(limit) for limit in limits if math.isfinite(limit)), default=None)

    def name_actions(self, chosen: Iterable[str]) -> None:
        """Set `action_names` to the actions' numbers if a plan uses only numbers, else to their names.

        A plan may be older than the names of the world's actions.

        Args:
            chosen: the actions of the plan, as the plan writes them
        """
        numbers = tuple(str(number) for number in range(len(self.actions.names)))
        plan_names = set(chosen)
        if plan_names and plan_names <= set(numbers):
            self.action_names = numbers
        else:
            self.action_names = self.actions.names

    def reset(self, seed: int) -> ResetResult:
        """Begin an episode from a seed, with the wrappers in their initial state."""
        self._wrappers.begin()
        self._observation, onset = self._call("reset()", self._reset_env, seed)
        self._native = self._call("its code", _adapt_to_native, self._env.unwrapped)
        self._steps = 0
        self._has_advanced = False
        return ResetResult(self._observation_hash(), self._call("mission", self._mission), onset)

    def _reset_env(self, seed: int) -> tuple[Any, bool]:
        """Reset the environment; return the observation, and whether the first picture shows a stimulus onset."""
        observation, info = read_reset(self._env.reset(seed=seed))
        return observation, read_onset(info)

    def step(self, action: Action) -> StepResult:
        """Step the world by an action: its number in ``action_names``, or a vector if actions are vectors.

        Raises:
            WorldError: if the action does not exist, or a foreign world raises an error or returns an invalid value.
        """
        value = self._action_value(action)
        info: Mapping[str, Any]
        if self.is_built_in:  # its values need no checks, which would take a fifth of a grid's step
            self._observation, reward, terminated, truncated, info = self._env.step(value)
            onset = bool(info.get("onset"))
        else:
            returned = self._call("step()", self._step_env, value)
            self._observation, reward, terminated, truncated, onset, info = returned
        self._has_advanced = False
        self._steps += 1
        return StepResult(
            float(reward),
            bool(terminated),
            bool(truncated),
            self._observation_hash(),
            onset,
            info,
            self.reward_means_success,
        )

    def _step_env(self, value: Any) -> tuple[Any, float, bool, bool, bool, Mapping[str, Any]]:
        """Step a foreign environment; return its checked values, with the stimulus onset before the info."""
        observation, reward, terminated, truncated, info = read_step(self._env.step(value))
        return observation, reward, terminated, truncated, read_onset(info), info

    def _call(self, name: str, function: Callable[..., T], *arguments: Any) -> T:
        """Call a function that runs the world's code; ``name`` is what error messages call it.

        Errors of a foreign world are raised as WorldError with the world's id. Errors of a built-in world are bugs and
        pass unchanged.
        """
        if self.is_built_in:
            return function(*arguments)
        with contain_errors(self.id, name):
            try:
                return function(*arguments)
            except WorldCodeError:
                raise
            except WorldError as error:
                raise self._with_world_id(error) from error

    def _with_world_id(self, error: WorldError) -> WorldError:
        """Return the error with the world's id at the start of its message."""
        if str(error).startswith(f"{self.id}: "):
            return error
        return WorldError(f"{self.id}: {error}")

    def advance(self, action: Action) -> tuple[bool, bool]:
        """Step the world without computing an observation, if it is native and no wrapper needs one.

        Returns:
            Whether the episode terminated, and whether it was truncated. `observation` does not change.

        Raises:
            WorldError: in the same cases as ``step``.
        """
        env = self._env.unwrapped
        if not isinstance(env, NativeWorld) or self._wrappers.any:
            transition = self.step(action)
            return transition.terminated, transition.truncated
        _, terminated, truncated = self._call("advance()", env.advance, self._action_value(action))
        self._has_advanced = True
        self._steps += 1
        return bool(terminated), bool(truncated)

    def pose(self) -> Pose | None:
        """Return the agent's pose; None if it is unknown."""
        if self._native:
            pose = self._call("pose()", self._native.pose)
        else:
            pose = None
        if pose is None or math.isnan(pose.x):
            return None
        return pose

    def subgoals(self) -> tuple[tuple[str, int], ...]:
        """Return the clauses of the episode's instruction, each with the step that fulfilled it, or 0 if not yet.

        The result is () for a world without such clauses.
        """
        if isinstance(self._native, NativeWorld):
            return self._call("subgoals()", self._native.subgoals)
        return ()

    def map(self) -> Map | None:
        """Return the floor plan; None where it is unknown."""
        if self._native and self.pose() is not None:
            return self._call("map()", self._native.map)
        return None

    def state_hash(self) -> int:
        """Return a uint64 hash of everything that determines the world's future.

        If the world does not reveal its state, the hash covers the observation, the random stream and the step count.
        """
        if self._native:
            return self._hash_with_wrappers(self._call("state_hash()", self._native.state_hash))
        random = self._call("np_random", self._random_state)
        observable = {"observation": self._observation_hash(), "random": random, "steps": self._steps}
        return self._hash_with_wrappers(hash64(observable))

    def scene_hash(self) -> int:
        """Return the hash of the state without the step count; if the state is unknown, the same as `state_hash`."""
        if not self._native:
            return self.state_hash()
        return self._hash_with_wrappers(self._call("scene_hash()", self._native.scene_hash))

    def _random_state(self) -> Any:
        """Return the state of the environment's random stream; raise a WorldError for another kind of stream."""
        stream = self._env.unwrapped.np_random
        if not isinstance(stream, np.random.Generator):
            raise WorldError(
                f"its np_random is a {type(stream).__name__}; call super().reset(seed=seed) in reset(), which makes it "
                "a numpy.random.Generator"
            )
        return stream.bit_generator.state

    def shortest_path(self) -> tuple[str, ...] | None:
        """Return the names of actions, turns included, that lead to success from here; () if none do.

        The result is None if the world has no planner.

        Raises:
            WorldError: if planning would take too long.
        """
        if self._native and self.actions.is_discrete:
            actions = self._call("shortest_path()", self._native.shortest_path)
        else:
            actions = None
        if actions is None:
            return None
        return tuple(self.action_names[action] for action in actions)

    def path_length_bounds(self) -> PathLengthBounds:
        """Return bounds on the number of steps from here to success, unknown for worlds without a discrete control."""
        # first-person worlds compute bounds from turns and steps ahead; a path with steps sideways can be shorter
        if self._native and getattr(self._native, "control", "discrete") == "discrete":
            return self._call("path_length_bounds()", self._native.path_length_bounds)
        return UNKNOWN_BOUNDS

    def frame(
        self,
        view: View | Literal["text"] = "partial",
        size_px: tuple[int, int] = (640, 480),
        palette: Palette = "classic",
    ) -> NDArray[np.uint8]:
        """Return what a person sees as uint8[H, W, 3], at most ``size_px`` (width, height) if the world can choose.

        If a wrapper redraws the picture, it is what the wrapper renders, in any view. The view "text" is a picture of
        `text`.

        Raises:
            WorldError: if the environment does not draw a picture, or has no text for the agent's observation.
        """
        if view == "text":
            return draw_text(self.text(), size_px)
        return self._call("render()", self._draw, view, size_px, palette)

    def _draw(self, view: View, size_px: tuple[int, int], palette: Palette) -> NDArray[np.uint8]:
        """Draw the picture: the environment's own if a wrapper redraws it or the environment is foreign."""
        if self._native and not self._wrappers.redraw:
            return read_picture(self._native.picture(view=view, size_px=size_px, palette=palette))
        return read_picture(self.render(size_px))

    @property
    def draws_itself(self) -> bool:
        """Return whether a participant sees what the environment's own ``render`` returns."""
        return self._native is None or self._wrappers.redraw

    def render(self, size_px: tuple[int, int]) -> Any:
        """Return the environment's own picture unchanged; within ``size_px`` if it can draw at any size."""
        if hasattr(self._env.unwrapped, "picture_size_px"):
            self._env.unwrapped.picture_size_px = size_px
        picture: Any = self._env.render()
        return picture

    def picture_tiles(
        self, view: View | Literal["text"], size_px: tuple[int, int], palette: Palette
    ) -> PictureTiles | None:
        """Return the picture of `frame` as tiles; None if the world is not a team world with tiles."""
        seat = self._env.unwrapped
        if not isinstance(seat, SeatEnv) or view == "text" or self._wrappers.redraw:
            return None
        return self._call("picture_tiles()", lambda: seat.team.picture_tiles(seat.seat, *size_px, palette=palette))

    def text(self) -> str:
        """Return the present observation of a grid world's agent, as a diagram and as sentences.

        Raises:
            WorldError: if the world has no grid observation.
        """
        native = self._env.unwrapped
        if self._has_advanced and hasattr(native, "observation"):
            observed = native.observation()
        else:
            observed = self._observation
        try:
            return describe_observation(observed, getattr(native, "kinds", ()))
        except WorldError as error:
            raise WorldError(f"{self.id}: {error}") from error

    def save(self) -> Any:
        """Return an exact copy of the state, also in the middle of an episode.

        Raises:
            WorldError: if the world cannot be copied.
        """
        if isinstance(self._env.unwrapped, NativeWorld):
            inside = self._call("save()", self._env.unwrapped.save)
        else:
            inside = self._copy_foreign()
        observed = self._copy_observation(self._observation), self._has_advanced
        return inside, elapsed_steps(self._env), self._wrappers.save(), observed, self._steps

    def _copy_foreign(self) -> dict[str, Any]:
        """Return a copy of all attributes of a foreign environment; many objects written in C cannot be copied."""
        if self._native:
            copy_state = self._native.save
        else:
            copy_state = self._copy_attributes
        try:
            return self._call("the copy of its attributes", copy_state)
        except WorldCodeError as error:
            reason = str(error).removeprefix(f"{self.id}: ")
            raise WorldError(f"{self.id} cannot be copied in the middle of an episode ({reason})") from error

    def _copy_attributes(self) -> dict[str, Any]:
        return copy.deepcopy(vars(self._env.unwrapped))

    def restore(self, saved: Any) -> None:
        """Restore a saved state, which can be restored again."""
        inside, limits, wrappers, observation, self._steps = saved
        self._observation = self._copy_observation(observation[0])
        self._has_advanced = observation[1]
        self._call("restore()", self._restore_inside, inside)
        self._wrappers.restore(wrappers)
        set_elapsed_steps(self._env, limits)

    def _restore_inside(self, inside: Any) -> None:
        if self._native:
            self._native.restore(inside)
        else:
            attributes = vars(self._env.unwrapped)
            for name in attributes.keys() - inside.keys():  # attributes that were added after the copy
                del attributes[name]
            attributes.update(copy.deepcopy(inside))

    def _copy_observation(self, observation: Any) -> Any:
        """Return a copy of the observation if its arrays can change: a native world makes new ones for each step."""
        if self._wrappers.any or self._native is not self.unwrapped:
            return copy.deepcopy(observation)
        return observation

    def close(self) -> None:
        """Close the environment."""
        try:
            self._call("close()", self._env.close)
        except WorldCodeError as error:  # no reason to fail: its episodes are over and recorded
            LOG.warning("the world did not close: %s: %s", type(error.__cause__).__name__, error.__cause__)

    def _action_value(self, action: Action) -> Any:
        """Return an action in the form that the environment's ``step`` takes; raise a WorldError for an unknown one."""
        try:
            return self.actions.value(action)
        except WorldError as error:
            raise WorldError(f"{self.id}: {error}") from error

    def _hash_with_wrappers(self, state_hash: int) -> int:
        """Return a hash of a state's hash and what wrappers have changed; the state's hash if they changed nothing."""
        changes = self._wrappers.changes()
        if changes:
            return hash64([state_hash, changes])
        return state_hash

    def _observation_hash(self) -> int:
        """Return the hash of the latest observation.

        Raises:
            WorldError: if a log cannot hash it.
        """
        try:
            return hash64(self._observation)
        except (TypeError, ValueError) as error:  # a ValueError for text with a lone surrogate
            reason = explain_unhashable(self._observation) or f"the observation cannot be hashed: {error}"
            raise WorldError(f"{self.id}: {reason}") from error
        except RecursionError as error:
            raise WorldError(f"{self.id}: the observation contains itself; return a copy of its parts") from error

    def _mission(self) -> str:
        """Return the episode's mission, as observed or as the environment states it; "" if it has none."""
        if isinstance(self._observation, dict):
            observed = self._observation.get("mission")
        else:
            observed = None
        if observed is not None:
            mission = observed
        else:
            mission = getattr(self._env.unwrapped, "mission", "")
        if isinstance(mission, str):
            return mission
        return ""


answer_to_old_names(World)


def _adapt_to_native(env: Any) -> NativeWorld | None:
    """Return an environment as a native world, in an adapter if it is not one; None if its state is unknown."""
    if isinstance(env, NativeWorld):
        return env
    if is_minigrid_like(env):
        return MinigridAdapter(env)
    if is_miniworld_like(env):
        return MiniworldAdapter(env)
    return None
