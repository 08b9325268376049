"""World: any Gymnasium environment, as a session needs it.

Native worlds answer for themselves; worlds built like Minigrid's or Miniworld's are read from their attributes; any
other world plays too, without pose and map. Knows no keys and no time. A world is imported only from a trusted module.
"""

import copy
import math
import tomllib
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from enum import EnumMeta
from functools import cache
from importlib.resources import files
from typing import Any, Literal

import gymnasium
import numpy as np
from gymnasium import wrappers
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.trust import locate_world
from minihuman.worlds.adapters.seat import SeatEnv, make_seat
from minihuman.worlds.adapters.spaces import Action, ActionInterface, DiscreteActions, VectorActions, find_chords
from minihuman.worlds.adapters.upstream import MinigridAdapter, MiniworldAdapter, is_minigrid_like, is_miniworld_like
from minihuman.worlds.adapters.world_text import describe_observation, draw_text
from minihuman.worlds.contract import (
    UNKNOWN_BOUNDS,
    NativeWorld,
    Palette,
    PathLengthBounds,
    View,
    answer_to_old_names,
)
from minihuman.worlds.hashing import hash64, resolve_files
from minihuman.worlds.pose import Map, Pose
from minihuman.worlds.step_limit import elapsed_steps, set_elapsed_steps, step_limit_of
from minihuman.worlds.team import PictureTiles


@dataclass(frozen=True, slots=True)
class ResetResult:
    """What a reset gave."""

    observation_hash: int
    mission: str  # "" where the world states none
    onset: bool = False  # info["onset"]: the first picture shows a stimulus onset


@dataclass(frozen=True, slots=True)
class StepResult:
    """What a step gave."""

    reward: float
    terminated: bool
    truncated: bool  # the environment's own limit; a session adds its plan's
    observation_hash: int
    onset: bool = False  # info["onset"]: the picture after the step shows a stimulus onset


class World:
    """A Gymnasium environment behind one face. Made at once; ``reset`` before anything else.

    Args:
        world_id: a Gymnasium id, with the module that registers it before a colon where needed.
        options: keyword arguments of ``gymnasium.make``.
        trusted: the user named it, not a protocol or a log: import it from any module.

    Raises:
        WorldError: if it cannot be made, is not trusted, has actions that keys cannot do, or cannot draw itself.
    """

    def __init__(self, world_id: str, options: dict[str, Any] | None = None, *, trusted: bool = False) -> None:
        self.id = world_id
        self.options = options or {}
        self._env = _make(world_id, self.options if trusted else locate_world(world_id, self.options))
        native = self._env.unwrapped
        self.drawn = isinstance(native, NativeWorld) and native.drawn  # see there
        self.actions = _build_actions(world_id, self._env)
        self.action_names = self.actions.names
        self._wrappers = WrapperState(self._env)
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
        """The environment's own limit on an episode's steps; None where it has none."""
        return step_limit_of(self._env)

    def name_actions(self, chosen: Iterable[str]) -> None:
        """Call the actions by number where a plan does, as it may be older than their names; else by name."""
        numbers = tuple(str(number) for number in range(len(self.actions.names)))
        named = set(chosen)
        self.action_names = numbers if named and named <= set(numbers) else self.actions.names

    def reset(self, seed: int) -> ResetResult:
        """Begin an episode from a seed, with wrappers as they were made."""
        self._wrappers.begin()
        self._observation, info = self._env.reset(seed=seed)
        self._known = _known(self._env.unwrapped)
        self._steps, self._has_advanced = 0, False
        return ResetResult(self._observation_hash(), self._mission(), bool(info.get("onset")))

    def step(self, action: Action) -> StepResult:
        """Do an action: a number from 0 in the order of ``action_names``, or a vector where actions are vectors.

        Raises:
            WorldError: if there is no such action.
        """
        self._observation, reward, terminated, truncated, info = self._env.step(self._action_value(action))
        self._has_advanced = False
        self._steps += 1
        hashed = self._observation_hash()
        return StepResult(float(reward), bool(terminated), bool(truncated), hashed, bool(info.get("onset")))

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
        _, terminated, truncated = env.advance(self._action_value(action))
        self._has_advanced = True
        self._steps += 1
        return bool(terminated), bool(truncated)

    def pose(self) -> Pose | None:
        """Where the agent stands; None where that is unknown."""
        pose = self._known.pose() if self._known else None
        return None if pose is None or math.isnan(pose.x) else pose

    def subgoals(self) -> tuple[tuple[str, int], ...]:
        """The clauses of the episode's instruction, each with the step that did it; 0 for none yet."""
        return self._known.subgoals() if isinstance(self._known, NativeWorld) else ()

    def map(self) -> Map | None:
        """The floor plan; None where it is unknown."""
        return self._known.map() if self._known and self.pose() is not None else None

    def state_hash(self) -> int:
        """A uint64 over everything that decides the future.

        Of a world that does not reveal its state it covers observation, random stream and steps.
        """
        if self._known:
            return self._with_wrappers(self._known.state_hash())
        random = self._env.unwrapped.np_random.bit_generator.state
        seen = {"observation": self._observation_hash(), "random": random, "steps": self._steps}
        return self._with_wrappers(hash64(seen))

    def scene_hash(self) -> int:
        """The same without the number of steps taken, where the state is known."""
        return self._with_wrappers(self._known.scene_hash()) if self._known else self.state_hash()

    def shortest_path(self) -> tuple[str, ...] | None:
        """Names of actions that lead to success from here, turns counted; empty if there are none.

        None where the world has no planner.

        Raises:
            WorldError: if planning would take too long.
        """
        found = self._known.shortest_path() if self._known else None
        return None if found is None else tuple(self.action_names[action] for action in found)

    def path_length_bounds(self) -> PathLengthBounds:
        """Bounds on the steps that success takes from here."""
        return self._known.path_length_bounds() if self._known else UNKNOWN_BOUNDS

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
        if self._known and not self._wrappers.redraw:
            return self._known.picture(view=view, size_px=size_px, palette=palette)
        if hasattr(self._env.unwrapped, "picture_size_px"):  # it draws at any size
            self._env.unwrapped.picture_size_px = size_px
        picture: Any = self._env.render()
        if not isinstance(picture, np.ndarray) or picture.ndim != 3 or picture.shape[2] != 3:
            raise WorldError(
                f"{self.id}: render() returned a {type(picture).__name__}; it must return a uint8 array of shape [H, "
                "W, 3]"
            )
        return picture.astype(np.uint8, copy=False)

    def picture_tiles(
        self, view: View | Literal["text"], size_px: tuple[int, int], palette: Palette
    ) -> PictureTiles | None:
        """The picture of `frame` as tiles; None where it is not a team world's that has some."""
        seat = self._env.unwrapped
        if not isinstance(seat, SeatEnv) or view == "text" or self._wrappers.redraw:
            return None
        return seat.team.picture_tiles(seat.seat, *size_px, palette=palette)

    def text(self) -> str:
        """What the agent of a grid world observes now, as a diagram and as sentences.

        Raises:
            WorldError: if the world has no grid observation.
        """
        native = self._env.unwrapped
        observed = native.observation() if self._has_advanced and hasattr(native, "observation") else self._observation
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
            inside = self._env.unwrapped.save()
        else:
            inside = self._known.save() if self._known else self._copy_foreign()
        observed = self._copy_observation(self._observation), self._has_advanced
        return inside, elapsed_steps(self._env), self._wrappers.save(), observed, self._steps

    def _copy_foreign(self) -> dict[str, Any]:
        """A copy of all that a foreign environment keeps; much of what is written in C cannot be copied."""
        try:
            return copy.deepcopy(vars(self._env.unwrapped))
        except Exception as error:  # whatever its parts raise
            raise WorldError(
                f"{self.id} cannot be copied in the middle of an episode ({type(error).__name__}: {error})"
            ) from error

    def restore(self, saved: Any) -> None:
        """Go back to a saved state; the copy is not consumed."""
        inside, limits, wrappers, observation, self._steps = saved
        self._observation, self._has_advanced = self._copy_observation(observation[0]), observation[1]
        if self._known:
            self._known.restore(inside)
        else:
            vars(self._env.unwrapped).update(copy.deepcopy(inside))
        self._wrappers.restore(wrappers)
        set_elapsed_steps(self._env, limits)

    def _copy_observation(self, observation: Any) -> Any:
        """A copy, as a foreign world or a wrapper may use its arrays again; a native world makes others each time."""
        return copy.deepcopy(observation) if self._wrappers.any or self._known is not self.unwrapped else observation

    def close(self) -> None:
        """Close the environment."""
        self._env.close()

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
        except TypeError as error:
            raise WorldError(f"{self.id}: the observation cannot be hashed: {error}") from error

    def _mission(self) -> str:
        observed = self._observation.get("mission") if isinstance(self._observation, dict) else None
        mission = observed if observed is not None else getattr(self._env.unwrapped, "mission", "")
        return mission if isinstance(mission, str) else ""


answer_to_old_names(World)


def _make(world_id: str, options: dict[str, Any]) -> gymnasium.Env[Any, Any]:
    try:
        seat = make_seat(world_id, options)
        env = (
            seat
            if seat is not None
            else gymnasium.make(world_id, render_mode="rgb_array", disable_env_checker=True, **resolve_files(options))
        )
    except ModuleNotFoundError as error:
        raise WorldError(
            f"{world_id}: {error}; install the package that provides this world, or trust the protocol's folder that "
            "has it: minihuman check PROTOCOL"
        ) from error
    except gymnasium.error.Error as error:
        raise WorldError(f"{world_id}: {error}") from error
    except WorldError as error:
        raise WorldError(f"{world_id}: {error}") from error
    except TypeError as error:
        raise WorldError(f"{world_id}: the options {options!r} are invalid: {error}") from error
    except Exception as error:  # a constructor may raise whatever it likes of an id or an option
        raise WorldError(
            f"{world_id} cannot be created with the options {options!r} ({type(error).__name__}: {error})"
        ) from error
    if "rgb_array" not in env.metadata.get("render_modes", ()):
        env.close()
        raise WorldError(f"{world_id} has no render mode 'rgb_array', which a session needs to show pictures; add it")
    return env


def _build_actions(world_id: str, env: gymnasium.Env[Any, Any]) -> ActionInterface:
    space, native = env.action_space, env.unwrapped
    if not isinstance(space, gymnasium.spaces.Discrete):
        try:
            return VectorActions(space)
        except WorldError as error:
            raise WorldError(f"{world_id}: {error}") from error
    count, first = int(space.n), int(space.start)
    return DiscreteActions(_action_names(native, count, first), first, find_chords(native, count, first))


def _known(env: Any) -> NativeWorld | None:
    if isinstance(env, NativeWorld):
        return env
    if is_minigrid_like(env):
        return MinigridAdapter(env)
    return MiniworldAdapter(env) if is_miniworld_like(env) else None


def _action_names(env: Any, count: int, first: int) -> tuple[str, ...]:
    """The world's own names, in order; numbers where it has none."""
    names = getattr(env, "action_names", None)
    if names is not None:
        return tuple(str(name) for name in names)[:count]
    kinds = getattr(env, "actions", getattr(env, "Actions", None))
    if isinstance(kinds, EnumMeta):
        named = {int(kind.value): str(kind.name) for kind in kinds}  # type: ignore[var-annotated]
        return tuple(named.get(first + action, str(action)) for action in range(count))
    by_number = getattr(getattr(env, "action_type", None), "actions", None)  # highway-env's way
    if isinstance(by_number, dict):
        return tuple(str(by_number.get(first + action, action)).lower() for action in range(count))
    meanings = getattr(env, "get_action_meanings", None)  # the Atari worlds' way
    if callable(meanings):
        return tuple(str(name).lower() for name in meanings())[:count]
    if type(env).__module__.startswith("gymnasium.envs.") and type(env).__name__ in _load_names():
        return tuple(_load_names()[type(env).__name__])
    return tuple(str(action) for action in range(count))


@cache
def _load_names() -> dict[str, list[str]]:
    """The names that Gymnasium's own environments do not have, by class."""
    return tomllib.loads(files(__package__).joinpath("action_names.toml").read_text(encoding="utf-8"))


_HOUSEKEEPING = (
    *(wrappers.OrderEnforcing, wrappers.PassiveEnvChecker, wrappers.TimeLimit, wrappers.RecordEpisodeStatistics),
    *(wrappers.RecordVideo, wrappers.HumanRendering, wrappers.RenderCollection),
)
# what Gymnasium keeps on every wrapper
_NOT_STATE = frozenset(
    {"env", "_action_space", "_observation_space", "_metadata", "_cached_spec", "_saved_kwargs", "spec"}
    | {"action_space", "observation_space", "metadata"}
)
_ABSENT = object()


class WrapperState:
    """What the wrappers around a world keep, from outside in, and whether they redraw the picture.

    An episode begins with wrappers as they were made, so that nothing leaks from one to the next; what they change in
    it counts as state: numbers, texts, arrays, tuples, lists, dicts, sets and deques of them, and random streams.
    """

    def __init__(self, env: gymnasium.Env[Any, Any]) -> None:
        self._each: list[Any] = []
        while isinstance(env, gymnasium.Wrapper):
            if not isinstance(env, _HOUSEKEEPING):
                self._each.append(env)
            env = env.env
        self.any = bool(self._each)
        self.redraw = any(type(each).render is not gymnasium.Wrapper.render for each in self._each)
        self._made = [dict(_attributes(each)) for each in self._each]  # by reference, to know them again
        self._digests = [{name: _digest(value) for name, value in made.items()} for made in self._made]
        self._copies = self.save()

    def begin(self) -> None:
        """Bring the wrappers back to how they were made."""
        if self.changes():
            self.restore(self._copies)

    def changes(self) -> list[Any]:
        """The attributes that changed since the wrappers were made, to be hashed; empty if none did.

        Raises:
            WorldError: if a wrapper holds something that cannot be hashed.
        """
        found = []
        for place, wrapper in enumerate(self._each):
            made, digests = self._made[place], self._digests[place]
            for name, value in _attributes(wrapper):
                digest = _digest(value)
                if digest is None and value is not made.get(name, _ABSENT):
                    raise WorldError(
                        f"{type(wrapper).__name__}.{name} is a {type(value).__name__}; a wrapper's state may hold only "
                        "numbers, strings, arrays, tuples, lists and dicts"
                    )
                if digest is not None and digest != digests.get(name):
                    found.append((place, name, _plain(value)))
        return found

    def save(self) -> list[dict[str, Any]]:
        """A copy of all that they keep and that can change."""
        return [
            {name: copy.deepcopy(value) for name, value in _attributes(each) if _digest(value) is not None}
            for each in self._each
        ]

    def restore(self, saved: list[dict[str, Any]]) -> None:
        """Go back to a copy, which is not consumed."""
        for wrapper, kept in zip(self._each, saved, strict=True):
            for name, value in list(_attributes(wrapper)):
                if name not in kept and _digest(value) is not None:
                    delattr(wrapper, name)
            vars(wrapper).update(copy.deepcopy(kept))


def _attributes(wrapper: Any) -> list[tuple[str, Any]]:
    return sorted((name, value) for name, value in vars(wrapper).items() if name not in _NOT_STATE)


def _digest(value: Any) -> int | None:
    try:
        return hash64(_plain(value))
    except TypeError:
        return None


def _plain(value: Any) -> Any:
    match value:
        case set() | frozenset():
            return sorted(value)
        case deque():
            return list(value)
        case np.random.Generator():
            return value.bit_generator.state
        case _:
            return value
