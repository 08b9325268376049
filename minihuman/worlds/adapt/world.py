"""World: any Gymnasium environment with discrete actions, as a session needs it.

Our own worlds answer for themselves; worlds built like Minigrid's or Miniworld's are read from their attributes;
any other world plays too, without pose and map. It knows nothing of keys, step limits or time.
"""

import copy
from collections.abc import Callable
from dataclasses import dataclass
from enum import EnumMeta
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.adapt.minigrid_like import MinigridLike, is_minigrid_like
from minihuman.worlds.adapt.miniworld_like import MiniworldLike, is_miniworld_like
from minihuman.worlds.adapt.wrappers import Wrappers
from minihuman.worlds.contract import UNKNOWN, Bounds, NativeWorld, Palette, View
from minihuman.worlds.hashing import hash64
from minihuman.worlds.pose import Map, Pose


@dataclass(frozen=True, slots=True)
class Observed:
    """What a reset gave."""

    observation_hash: int
    mission: str  # "" where the world states none


@dataclass(frozen=True, slots=True)
class Transition:
    """What a step gave."""

    reward: float
    terminated: bool
    truncated: bool  # the environment's own limit; a session adds its plan's
    observation_hash: int


class World:
    """A Gymnasium environment behind one face. Made at once; ``reset`` before anything else.

    Args:
        world_id: a Gymnasium id, with the module that registers it before a colon where needed.
        options: keyword arguments of ``gymnasium.make``.

    Raises:
        WorldError: if it cannot be made, has no discrete actions or cannot draw itself.
    """

    def __init__(self, world_id: str, options: dict[str, Any] | None = None) -> None:
        self.id = world_id
        self._env = _make(world_id, options or {})
        native = self._env.unwrapped
        self.drawn = isinstance(native, NativeWorld) and native.drawn  # see there
        space = self._env.action_space
        if not isinstance(space, gymnasium.spaces.Discrete):
            raise WorldError(f"{world_id}: its actions are {space}; a session needs Discrete actions, one a key")
        self._first_action = int(space.start)
        self.action_names = _action_names(self._env.unwrapped, int(space.n), self._first_action)
        self._wrappers = Wrappers(self._env)
        self._known: NativeWorld | None = None
        self._observation: Any = None
        self._steps = 0

    @property
    def unwrapped(self) -> Any:
        """The environment itself: for players that may look behind the picture."""
        return self._env.unwrapped

    @property
    def env(self) -> gymnasium.Env[Any, Any]:
        """The environment with its wrappers: for checks of what they change."""
        return self._env

    @property
    def compile_apart(self) -> tuple[Callable[[], None], ...]:
        """Calls that each compile a piece of its code; none where that does not take long, or cannot be split."""
        env = self._env.unwrapped
        return env.compile_apart if isinstance(env, NativeWorld) else ()

    @property
    def observation(self) -> Any:
        """The latest observation, for players that see what an agent sees."""
        return self._observation

    @property
    def observation_space(self) -> gymnasium.Space[Any]:
        """Where its observations lie."""
        return self._env.observation_space

    @property
    def action_space(self) -> gymnasium.spaces.Discrete:
        """Where its actions lie."""
        space = self._env.action_space
        assert isinstance(space, gymnasium.spaces.Discrete)  # checked when made
        return space

    @property
    def step_limit(self) -> int | None:
        """How many steps the environment itself gives an episode; None where it says of none."""
        spec = self._env.spec
        said = (getattr(self.unwrapped, "max_steps", None), spec.max_episode_steps if spec else None)
        return min((int(limit) for limit in said if limit is not None), default=None)

    def reset(self, seed: int) -> Observed:
        """Begin an episode from a seed, with wrappers as they were made."""
        self._wrappers.begin()
        self._observation, _ = self._env.reset(seed=seed)
        self._known = _known(self._env.unwrapped)
        self._steps = 0
        return Observed(self._observation_hash(), self._mission())

    def step(self, action: int) -> Transition:
        """Do an action, counted from 0 in the order of ``action_names``.

        Raises:
            WorldError: if there is no such action.
        """
        if not 0 <= action < len(self.action_names):
            raise WorldError(f"{self.id}: action {action!r} does not exist; it has {len(self.action_names)}, from 0")
        self._observation, reward, terminated, truncated, _ = self._env.step(self._first_action + action)
        self._steps += 1
        return Transition(float(reward), bool(terminated), bool(truncated), self._observation_hash())

    def advance(self, action: int) -> tuple[bool, bool]:
        """Do an action without making its observation, where it is a world of ours and no wrapper needs one.

        Returns:
            Whether the episode terminated and whether it was truncated. `observation` stays what it was.

        Raises:
            WorldError: as ``step``.
        """
        env = self._env.unwrapped
        if not isinstance(env, NativeWorld) or self._wrappers.any:
            transition = self.step(action)
            return transition.terminated, transition.truncated
        _, terminated, truncated = env.advance(self._first_action + action)
        self._steps += 1
        return bool(terminated), bool(truncated)

    def pose(self) -> Pose | None:
        """Where the agent stands; None where the world cannot tell."""
        return self._known.pose() if self._known else None

    def clauses(self) -> tuple[tuple[str, int], ...]:
        """The clauses of the episode's instruction, each with the step that did it; 0 for none yet."""
        return self._known.clauses() if isinstance(self._known, NativeWorld) else ()

    def map(self) -> Map | None:
        """The floor plan; None where the world cannot tell."""
        return self._known.map() if self._known else None

    def state_hash(self) -> int:
        """A uint64 over all that decides the future.

        Where a world keeps its state to itself it covers what can be seen of it: observation, random stream, steps.
        """
        if self._known:
            return self._with_wrappers(self._known.state_hash())
        random = self._env.unwrapped.np_random.bit_generator.state
        seen = {"observation": self._observation_hash(), "random": random, "steps": self._steps}
        return self._with_wrappers(hash64(seen))

    def scene_hash(self) -> int:
        """The same without the number of steps taken, where the world tells them apart."""
        return self._with_wrappers(self._known.scene_hash()) if self._known else self.state_hash()

    def way(self) -> tuple[str, ...] | None:
        """Names of actions that lead to success from here, turns counted; empty if there are none.

        None where the world cannot tell.

        Raises:
            WorldError: if it would take too long to tell.
        """
        found = self._known.way() if self._known else None
        return None if found is None else tuple(self.action_names[action] for action in found)

    def bounds(self) -> Bounds:
        """How many steps success takes from here."""
        return self._known.bounds() if self._known else UNKNOWN

    def frame(
        self, view: View = "partial", size_px: tuple[int, int] = (640, 480), palette: Palette = "classic"
    ) -> NDArray[np.uint8]:
        """The picture a person sees, uint8[H, W, 3], at most ``size_px`` (width, height) where the world can choose.

        Where a wrapper draws anew, it is what the wrapper renders, whatever the view.

        Raises:
            WorldError: if the environment draws something else than a picture.
        """
        if self._known and not self._wrappers.redraw:
            return self._known.picture(view=view, size_px=size_px, palette=palette)
        picture: Any = self._env.render()
        if not isinstance(picture, np.ndarray) or picture.ndim != 3 or picture.shape[2] != 3:
            raise WorldError(f"{self.id}: render() gave {type(picture).__name__}, not a picture uint8[H, W, 3]")
        return picture.astype(np.uint8, copy=False)

    def save(self) -> Any:
        """An exact copy of the state in mid-episode.

        Raises:
            WorldError: if the world cannot be copied.
        """
        if isinstance(self._env.unwrapped, NativeWorld):
            inside = self._env.unwrapped.save()
        else:
            inside = self._known.save() if self._known else copy.deepcopy(vars(self._env.unwrapped))
        return inside, _limits(self._env), self._wrappers.save(), copy.deepcopy(self._observation), self._steps

    def restore(self, saved: Any) -> None:
        """Go back to a saved state; the copy is not consumed."""
        inside, limits, wrappers, observation, self._steps = saved
        self._observation = copy.deepcopy(observation)
        if self._known:
            self._known.restore(inside)
        else:
            vars(self._env.unwrapped).update(copy.deepcopy(inside))
        self._wrappers.restore(wrappers)
        for wrapper, elapsed in zip(_time_limits(self._env), limits, strict=True):
            wrapper._elapsed_steps = elapsed

    def close(self) -> None:
        """Let go of the environment."""
        self._env.close()

    def _with_wrappers(self, hashed: int) -> int:
        changes = self._wrappers.changes()
        return hash64([hashed, changes]) if changes else hashed

    def _observation_hash(self) -> int:
        try:
            return hash64(self._observation)
        except TypeError as error:
            raise WorldError(f"{self.id}: its observation cannot be hashed: {error}") from error

    def _mission(self) -> str:
        told = self._observation.get("mission") if isinstance(self._observation, dict) else None
        mission = told if told is not None else getattr(self._env.unwrapped, "mission", "")
        return mission if isinstance(mission, str) else ""


def _make(world_id: str, options: dict[str, Any]) -> gymnasium.Env[Any, Any]:
    try:
        env = gymnasium.make(world_id, render_mode="rgb_array", disable_env_checker=True, **options)
    except ModuleNotFoundError as error:
        raise WorldError(f"{world_id}: {error}; install the package that brings this world") from error
    except gymnasium.error.Error as error:
        raise WorldError(f"{world_id}: {error}") from error
    except WorldError as error:
        raise WorldError(f"{world_id}: {error}") from error
    except TypeError as error:
        raise WorldError(f"{world_id}: options {options!r} do not fit: {error}") from error
    except Exception as error:  # a constructor may raise whatever it likes of an id or an option
        raise WorldError(f"{world_id}: options {options!r}: {type(error).__name__}: {error}") from error
    if "rgb_array" not in env.metadata.get("render_modes", ()):
        env.close()
        raise WorldError(f"{world_id}: it has no render mode 'rgb_array', so there is no picture to show a person")
    return env


def _known(env: Any) -> NativeWorld | None:
    if isinstance(env, NativeWorld):
        return env
    if is_minigrid_like(env):
        return MinigridLike(env)
    return MiniworldLike(env) if is_miniworld_like(env) else None


def _action_names(env: Any, count: int, first: int) -> tuple[str, ...]:
    """The world's own names, in order; numbers where it has none."""
    names = getattr(env, "action_names", None)
    if names is not None:
        return tuple(str(name) for name in names)[:count]
    kinds = getattr(env, "actions", getattr(env, "Actions", None))
    if isinstance(kinds, EnumMeta):
        named = {int(kind.value): str(kind.name) for kind in kinds}  # type: ignore[var-annotated]
        return tuple(named.get(first + action, str(action)) for action in range(count))
    meanings = getattr(env, "get_action_meanings", None)  # the Atari worlds' way
    if callable(meanings):
        return tuple(str(name).lower() for name in meanings())[:count]
    return tuple(str(action) for action in range(count))


def _time_limits(env: gymnasium.Env[Any, Any]) -> list[Any]:
    """Gymnasium's own step-counting wrappers around an environment, from outside in."""
    found = []
    while isinstance(env, gymnasium.Wrapper):
        if isinstance(env, gymnasium.wrappers.TimeLimit):
            found.append(env)
        env = env.env
    return found


def _limits(env: gymnasium.Env[Any, Any]) -> list[int]:
    return [wrapper._elapsed_steps for wrapper in _time_limits(env)]
