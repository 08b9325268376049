"""World: any Gymnasium environment, as a session needs it.

Native worlds answer for themselves; worlds built like Minigrid's or Miniworld's are read from their attributes; any
other world plays too, without pose and map. Knows no keys and no time. A world is imported only from a trusted module.
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
from minihuman.worlds.adapters.construction import make_environment, require_space
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
from minihuman.worlds.contract import (
    UNKNOWN_BOUNDS,
    NativeWorld,
    Palette,
    PathLengthBounds,
    View,
    answer_to_old_names,
)
from minihuman.worlds.hashing import hash64
from minihuman.worlds.pose import Map, Pose
from minihuman.worlds.step_limit import elapsed_steps, set_elapsed_steps, step_limit_of
from minihuman.worlds.team import PictureTiles

LOG = logging.getLogger("minihuman")
T = TypeVar("T")


class World:
    """A Gymnasium environment behind one face. Made at once; ``reset`` before anything else.

    Args:
        world_id: a Gymnasium id, with the module that registers it before a colon where needed.
        options: keyword arguments of ``gymnasium.make``.
        trusted: the user named it, not a protocol or a log: import it from any module.

    Raises:
        WorldError: if it cannot be made, is not trusted, has actions that keys cannot do, or cannot draw itself.
    """

    has_portable_copies: ClassVar[bool] = True  # another world of its id and options can restore its copies

    def __init__(self, world_id: str, options: dict[str, Any] | None = None, *, trusted: bool = False) -> None:
        self.id = world_id
        self.options = options or {}
        with contain_errors(world_id, "its code"):
            self._env = make_environment(world_id, self.options if trusted else locate_world(world_id, self.options))
            self.is_built_in = _is_built_in(self._env)  # its class and its wrappers are this package's
            native = self._env.unwrapped
            self.drawn = isinstance(native, NativeWorld) and native.drawn  # see there
            self.reward_means_success = _has_own_rule(native)
            require_space(world_id, self._env, "action_space")
            self.actions = build_actions(world_id, self._env)
            require_space(world_id, self._env, "observation_space")
            self._wrappers = WrapperState(self._env)
        self.action_names = self.actions.names
        self._known: NativeWorld | None = None
        self._observation: Any = None
        self._has_advanced = False  # since the observation was made
        self._steps = 0

    @property
    def unwrapped(self) -> Any:
        """The environment itself: for agents that may look behind the picture."""
        return self._env.unwrapped

    @property
    def env(self) -> gymnasium.Env[Any, Any]:
        """The environment with its wrappers: for checks of what they change."""
        return self._env

    @property
    def is_compiled(self) -> bool:
        """Whether compiled kernels alone step and draw it, and no wrapper changes that: then a page can, too."""
        env = self._env.unwrapped
        return isinstance(env, NativeWorld) and env.is_compiled and not self._wrappers.any

    @property
    def knows_state(self) -> bool:
        """Whether the environment reveals all its state; else hashes cover what is seen of it."""
        return self._known is not None

    @property
    def observation(self) -> Any:
        """The latest observation."""
        return self._observation

    @property
    def observation_space(self) -> gymnasium.Space[Any]:
        """The space of its observations."""
        return self._env.observation_space

    @property
    def action_space(self) -> gymnasium.Space[Any]:
        """The space of its actions."""
        return self._env.action_space

    @property
    def step_limit(self) -> int | None:
        """The environment's own limit on an episode's steps; None where it has none, or states no number."""
        if self.is_built_in:
            return step_limit_of(self._env)
        own = self._call("max_steps", getattr, self._env.unwrapped, "max_steps", None)
        registered = self._env.spec.max_episode_steps if self._env.spec else None
        limits = [limit for limit in (own, registered) if isinstance(limit, int | float | np.number)]
        return min((int(limit) for limit in limits if math.isfinite(limit)), default=None)

    def name_actions(self, chosen: Iterable[str]) -> None:
        """Call the actions by number where a plan does, as it may be older than their names; else by name."""
        numbers = tuple(str(number) for number in range(len(self.actions.names)))
        named = set(chosen)
        if named and named <= set(numbers):
            self.action_names = numbers
        else:
            self.action_names = self.actions.names

    def reset(self, seed: int) -> ResetResult:
        """Begin an episode from a seed, with wrappers as they were made."""
        self._wrappers.begin()
        self._observation, onset = self._call("reset()", self._reset_env, seed)
        self._known = self._call("its code", _known, self._env.unwrapped)
        self._steps = 0
        self._has_advanced = False
        return ResetResult(self._observation_hash(), self._call("mission", self._mission), onset)

    def _reset_env(self, seed: int) -> tuple[Any, bool]:
        observation, info = read_reset(self._env.reset(seed=seed))
        return observation, read_onset(info)

    def step(self, action: Action) -> StepResult:
        """Do an action: a number from 0 in the order of ``action_names``, or a vector where actions are vectors.

        Raises:
            WorldError: if there is no such action; or if a foreign world raises, or returns what no session can hold.
        """
        value = self._action_value(action)
        info: Mapping[str, Any]
        if self.is_built_in:  # without what reads foreign values: a fifth of a step of the grid
            self._observation, reward, terminated, truncated, info = self._env.step(value)
            onset = bool(info.get("onset"))
        else:
            stepped = self._call("step()", self._step_env, value)
            self._observation, reward, terminated, truncated, onset, info = stepped
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
        observation, reward, terminated, truncated, info = read_step(self._env.step(value))
        return observation, reward, terminated, truncated, read_onset(info), info

    def _call(self, name: str, function: Callable[..., T], *arguments: Any) -> T:
        """Call what runs the world's code: a foreign world's errors are named, those of ours are bugs."""
        if self.is_built_in:
            return function(*arguments)
        with contain_errors(self.id, name):
            try:
                return function(*arguments)
            except WorldCodeError:
                raise
            except WorldError as error:
                raise self._named(error) from error

    def _named(self, error: WorldError) -> WorldError:
        """The error with the world's id in front."""
        if str(error).startswith(f"{self.id}: "):
            return error
        return WorldError(f"{self.id}: {error}")

    def advance(self, action: Action) -> tuple[bool, bool]:
        """Act without making an observation, where the world is native and no wrapper needs one.

        Returns:
            Whether the episode terminated and whether it was truncated. `observation` stays what it was.

        Raises:
            WorldError: as ``step``.
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
        """Where the agent stands; None where that is unknown."""
        pose = self._call("pose()", self._known.pose) if self._known else None
        return None if pose is None or math.isnan(pose.x) else pose

    def subgoals(self) -> tuple[tuple[str, int], ...]:
        """The clauses of the episode's instruction, each with the step that did it; 0 for none yet."""
        if isinstance(self._known, NativeWorld):
            return self._call("subgoals()", self._known.subgoals)
        return ()

    def map(self) -> Map | None:
        """The floor plan; None where it is unknown."""
        if self._known and self.pose() is not None:
            return self._call("map()", self._known.map)
        return None

    def state_hash(self) -> int:
        """A uint64 over everything that decides the future.

        Of a world that does not reveal its state it covers observation, random stream and steps.
        """
        if self._known:
            return self._with_wrappers(self._call("state_hash()", self._known.state_hash))
        random = self._call("np_random", self._random_state)
        seen = {"observation": self._observation_hash(), "random": random, "steps": self._steps}
        return self._with_wrappers(hash64(seen))

    def scene_hash(self) -> int:
        """The same without the number of steps taken, where the state is known."""
        if not self._known:
            return self.state_hash()
        return self._with_wrappers(self._call("scene_hash()", self._known.scene_hash))

    def _random_state(self) -> Any:
        stream = self._env.unwrapped.np_random
        if not isinstance(stream, np.random.Generator):
            raise WorldError(
                f"its np_random is a {type(stream).__name__}; call super().reset(seed=seed) in reset(), which makes it "
                "a numpy.random.Generator"
            )
        return stream.bit_generator.state

    def shortest_path(self) -> tuple[str, ...] | None:
        """Names of actions that lead to success from here, turns counted; empty if there are none.

        None where the world has no planner.

        Raises:
            WorldError: if planning would take too long.
        """
        if self._known:
            found = self._call("shortest_path()", self._known.shortest_path)
        else:
            found = None
        if found is None:
            return None
        return tuple(self.action_names[action] for action in found)

    def path_length_bounds(self) -> PathLengthBounds:
        """Bounds on the steps that success takes from here."""
        if self._known:
            return self._call("path_length_bounds()", self._known.path_length_bounds)
        return UNKNOWN_BOUNDS

    def frame(
        self,
        view: View | Literal["text"] = "partial",
        size_px: tuple[int, int] = (640, 480),
        palette: Palette = "classic",
    ) -> NDArray[np.uint8]:
        """The picture a person sees, uint8[H, W, 3], at most ``size_px`` (width, height) where the world can choose.

        Where a wrapper draws anew, it is what the wrapper renders, whatever the view; ``text`` is a picture of `text`.

        Raises:
            WorldError: if the environment does not draw a picture, or has no words for what the agent observes.
        """
        if view == "text":
            return draw_text(self.text(), size_px)
        return self._call("render()", self._draw, view, size_px, palette)

    def _draw(self, view: View, size_px: tuple[int, int], palette: Palette) -> NDArray[np.uint8]:
        if self._known and not self._wrappers.redraw:
            return read_picture(self._known.picture(view=view, size_px=size_px, palette=palette))
        return read_picture(self.render(size_px))

    @property
    def draws_itself(self) -> bool:
        """Whether a participant sees what its own ``render`` returns."""
        return self._known is None or self._wrappers.redraw

    def render(self, size_px: tuple[int, int]) -> Any:
        """What the environment itself draws, as it returns it; within ``size_px`` where it draws at any size."""
        if hasattr(self._env.unwrapped, "picture_size_px"):
            self._env.unwrapped.picture_size_px = size_px
        picture: Any = self._env.render()
        return picture

    def picture_tiles(
        self, view: View | Literal["text"], size_px: tuple[int, int], palette: Palette
    ) -> PictureTiles | None:
        """The picture of `frame` as tiles; None where it is not a team world's that has some."""
        seat = self._env.unwrapped
        if not isinstance(seat, SeatEnv) or view == "text" or self._wrappers.redraw:
            return None
        return self._call("picture_tiles()", lambda: seat.team.picture_tiles(seat.seat, *size_px, palette=palette))

    def text(self) -> str:
        """What the agent of a grid world observes now, as a diagram and as sentences.

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
        """An exact copy of the state in mid-episode.

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
        """A copy of all that a foreign environment keeps; much of what is written in C cannot be copied."""
        try:
            return self._call("the copy of its attributes", self._known.save if self._known else self._copy_attributes)
        except WorldCodeError as error:
            reason = str(error).removeprefix(f"{self.id}: ")
            raise WorldError(f"{self.id} cannot be copied in the middle of an episode ({reason})") from error

    def _copy_attributes(self) -> dict[str, Any]:
        return copy.deepcopy(vars(self._env.unwrapped))

    def restore(self, saved: Any) -> None:
        """Go back to a saved state; the copy is not consumed."""
        inside, limits, wrappers, observation, self._steps = saved
        self._observation, self._has_advanced = self._copy_observation(observation[0]), observation[1]
        self._call("restore()", self._restore_inside, inside)
        self._wrappers.restore(wrappers)
        set_elapsed_steps(self._env, limits)

    def _restore_inside(self, inside: Any) -> None:
        if self._known:
            self._known.restore(inside)
        else:
            attributes = vars(self._env.unwrapped)
            for name in attributes.keys() - inside.keys():  # they came after the copy
                del attributes[name]
            attributes.update(copy.deepcopy(inside))

    def _copy_observation(self, observation: Any) -> Any:
        """A copy, as a foreign world or a wrapper may use its arrays again; a native world makes others each time."""
        if self._wrappers.any or self._known is not self.unwrapped:
            return copy.deepcopy(observation)
        return observation

    def close(self) -> None:
        """Close the environment."""
        try:
            self._call("close()", self._env.close)
        except WorldCodeError as error:  # its episodes are over, and what was recorded of them counts
            LOG.warning("the world did not close: %s: %s", type(error.__cause__).__name__, error.__cause__)

    def _action_value(self, action: Action) -> Any:
        try:
            return self.actions.value(action)
        except WorldError as error:
            raise WorldError(f"{self.id}: {error}") from error

    def _with_wrappers(self, hashed: int) -> int:
        changes = self._wrappers.changes()
        return hash64([hashed, changes]) if changes else hashed

    def _observation_hash(self) -> int:
        try:
            return hash64(self._observation)
        except (TypeError, ValueError) as error:  # of text with half a character, a ValueError
            reason = explain_unhashable(self._observation) or f"the observation cannot be hashed: {error}"
            raise WorldError(f"{self.id}: {reason}") from error
        except RecursionError as error:
            raise WorldError(f"{self.id}: the observation contains itself; return a copy of its parts") from error

    def _mission(self) -> str:
        if isinstance(self._observation, dict):
            observed = self._observation.get("mission")
        else:
            observed = None
        if observed is not None:
            mission = observed
        else:
            mission = getattr(self._env.unwrapped, "mission", "")
        return mission if isinstance(mission, str) else ""


answer_to_old_names(World)


def _has_own_rule(native: Any) -> bool:
    """Whether a world's author says, by the ``reward_and_done`` of our classes, which end earns a reward."""
    # seen from inside
    if isinstance(native, SeatEnv):
        inner = native.team
    else:
        inner = vars(native).get("grid", native)
    return isinstance(native, NativeWorld) and hasattr(inner, "reward_and_done")


def _is_built_in(env: gymnasium.Env[Any, Any]) -> bool:
    """Tell whether a world and all wrappers around it are this package's own, or Gymnasium's wrappers."""
    while isinstance(env, gymnasium.Wrapper):
        if not type(env).__module__.startswith(("minihuman.", "gymnasium.wrappers.")):
            return False
        env = env.env
    team = getattr(env, "team", env)  # of a seat
    return type(env).__module__.startswith("minihuman.") and type(team).__module__.startswith("minihuman.")


def _known(env: Any) -> NativeWorld | None:
    if isinstance(env, NativeWorld):
        return env
    if is_minigrid_like(env):
        return MinigridAdapter(env)
    if is_miniworld_like(env):
        return MiniworldAdapter(env)
    return None
