"""A tape of what built-in worlds did, so that a proof steps each episode of a log once.

A log's episodes are replayed twice: for their numbers, and as part of the session that they were played in. A built-in
world does the same whenever it is reset with the same seed and given the same actions, so the second replay reads what
the first one computed. Anything that is not on the tape is computed by the world. Third-party worlds, teams and worlds
with wrappers are not taped, because they may not repeat themselves.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal

import gymnasium
import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.adapters.seat import SeatEnv
from minihuman.worlds.adapters.spaces import Action
from minihuman.worlds.adapters.transition import ResetResult, StepResult
from minihuman.worlds.adapters.world import World
from minihuman.worlds.contract import Palette, View
from minihuman.worlds.hashing import hash64
from minihuman.worlds.pose import Pose

_MAX_IDLE = 32  # different worlds that are kept idle
_EpisodeKey = tuple[str, int, int]  # world id, hash of its options, seed


@dataclass(slots=True)
class _Moment:
    """A state of an episode's world: the facts computed of it, and the recorded steps from it."""

    steps: dict[Action, tuple[StepResult, "_Moment"]] = field(default_factory=dict)
    state_hash: int | None = None
    pose: tuple[Pose | None] | None = None  # in a tuple, because a pose may be None
    subgoals: tuple[tuple[str, int], ...] | None = None


class WorldTape:
    """Records what worlds returned for each seed and sequence of actions during the proof of one log."""

    def __init__(self) -> None:
        self._episodes: dict[_EpisodeKey, _Moment] = {}

    def make_world(self, world_id: str, options: dict[str, Any] | None = None) -> World:
        """Make a world that writes to this tape and reads from it.

        Args:
            world_id: a Gymnasium id.
            options: the options of the world; None for none.

        Raises:
            WorldError: if the world cannot be created here.
        """
        return _TapedWorld(world_id, options, self)

    def find_episode(self, world_id: str, options: Mapping[str, Any], seed: int) -> _Moment:
        """Return the moment at which an episode begins, after adding it to the tape if it is not there yet.

        Args:
            world_id: a Gymnasium id.
            options: the options of the world.
            seed: the seed with which the world is reset.
        """
        return self._episodes.setdefault((world_id, hash64(options), seed), _Moment())


class _TapedWorld(World):
    """A world whose environment is stepped only where the tape has no answer.

    Args:
        world_id: a Gymnasium id.
        options: the keyword arguments of ``gymnasium.make``.
        tape: where its steps are written and read.
    """

    def __init__(self, world_id: str, options: dict[str, Any] | None, tape: WorldTape) -> None:
        self._unmade_steps: list[Action] = []  # read from the tape; the environment has not made them
        self._moment: _Moment | None = None  # None while the tape is not used
        self._tape = tape
        super().__init__(world_id, options)
        self._can_be_taped = (
            self.is_built_in and not self._wrappers.any and not isinstance(self._env.unwrapped, SeatEnv)
        )

    def reset(self, seed: int) -> ResetResult:
        """Begin an episode with a seed; the tape is used from here on if the world can be taped."""
        self._unmade_steps.clear()
        self._moment = None
        reset = super().reset(seed)
        if self._can_be_taped:
            self._moment = self._tape.find_episode(self.id, self.options, seed)
        return reset

    def step(self, action: Action) -> StepResult:
        """Step the world by an action; read the result from the tape if it is there."""
        moment = self._moment
        if moment is None:
            return super().step(action)
        if action in moment.steps:
            result, self._moment = moment.steps[action]
            self._unmade_steps.append(action)
            return result
        self._catch_up()
        result = super().step(action)
        self._moment = _Moment(subgoals=super().subgoals())  # recorded now, as only the second replay reads them
        moment.steps[action] = (result, self._moment)
        return result

    def _catch_up(self) -> None:
        """Let the environment make the steps whose results were read from the tape."""
        steps = self._unmade_steps
        self._unmade_steps = []
        for action in steps:
            super().step(action)

    def _leave_tape(self) -> None:
        """Stop reading the tape and use the environment itself, which the caller may now change."""
        self._catch_up()
        self._moment = None

    def _call(self, name: str, function: Any, *arguments: Any) -> Any:
        self._catch_up()
        return super()._call(name, function, *arguments)

    def pose(self) -> Pose | None:
        """Return the agent's pose; None if it is unknown."""
        if self._moment is None:
            return super().pose()
        if self._moment.pose is None:
            self._moment.pose = (super().pose(),)
        return self._moment.pose[0]

    def state_hash(self) -> int:
        """Return the hash of the state."""
        if self._moment is None:
            return super().state_hash()
        if self._moment.state_hash is None:
            self._moment.state_hash = super().state_hash()
        return self._moment.state_hash

    def subgoals(self) -> tuple[tuple[str, int], ...]:
        """Return the clauses of the episode's instruction, each with the step that fulfilled it, or 0 if not yet."""
        if self._moment is None or self._moment.subgoals is None:
            return super().subgoals()
        return self._moment.subgoals

    @property
    def observation(self) -> Any:
        """Return the latest observation."""
        self._catch_up()
        return super().observation

    @property
    def unwrapped(self) -> Any:
        """Return the environment itself."""
        self._leave_tape()
        return super().unwrapped

    @property
    def env(self) -> gymnasium.Env[Any, Any]:
        """Return the environment with its wrappers."""
        self._leave_tape()
        return super().env

    def advance(self, action: Action) -> tuple[bool, bool]:
        """Step the world without computing an observation; return whether the episode terminated, and was truncated."""
        self._leave_tape()
        return super().advance(action)

    def save(self) -> Any:
        """Return an exact copy of the state, for ``restore``."""
        self._catch_up()
        return super().save()

    def restore(self, saved: Any) -> None:
        """Restore a state that ``save`` returned."""
        self._leave_tape()
        super().restore(saved)

    def frame(
        self,
        view: View | Literal["text"] = "partial",
        size_px: tuple[int, int] = (640, 480),
        palette: Palette = "classic",
    ) -> NDArray[np.uint8]:
        """Return what a person sees as uint8[H, W, 3], as ``World.frame`` does."""
        self._catch_up()
        return super().frame(view, size_px, palette)

    def render(self, size_px: tuple[int, int]) -> Any:
        """Return the environment's own picture."""
        self._catch_up()
        return super().render(size_px)

    def close(self) -> None:
        """Close the environment, which need not make the steps that were read from the tape."""
        self._unmade_steps.clear()
        super().close()

    def text(self) -> str:
        """Return the present observation as text."""
        self._catch_up()
        return super().text()


class WorldPool:
    """Makes worlds for one proof, and reuses built-in worlds that other proofs of this process have closed.

    A built-in world keeps nothing over a reset but its id and options, so a session's own episodes share one, too.

    Attributes:
        all_repeat: whether all worlds that were made are known to do the same again from the same seed and actions.
    """

    _idle: ClassVar[dict[tuple[str, int], list["_PooledWorld"]]] = {}  # by id and options, the least recent first

    def __init__(self) -> None:
        self.all_repeat = True

    def make_world(self, world_id: str, options: dict[str, Any] | None = None) -> World:
        """Make a world, or take one that is idle and has the same id and options.

        Args:
            world_id: a Gymnasium id.
            options: the options of the world; None for none.

        Raises:
            WorldError: if the world cannot be created here.
        """
        key = (world_id, hash64(options or {}))
        idle = self._idle.get(key)
        if idle:
            return idle.pop()
        world = _PooledWorld(world_id, options, self._keep)
        self.all_repeat &= world.can_repeat
        return world

    @classmethod
    def _keep(cls, world: "_PooledWorld") -> bool:
        """Keep a closed world for the next proof; return False if it is not kept and its environment is to be closed.

        One world is kept for each id and options, and the one that was kept first is closed if there are too many.
        """
        if not world.can_repeat:
            return False
        key = (world.id, hash64(world.options))
        idle = cls._idle.pop(key, [])
        cls._idle[key] = [world]
        for surplus in idle:
            surplus.close_finally()
        while len(cls._idle) > _MAX_IDLE:
            for surplus in cls._idle.pop(next(iter(cls._idle))):
                surplus.close_finally()
        return True


class _PooledWorld(World):
    """A world that returns to its pool when it is closed.

    Args:
        world_id: a Gymnasium id.
        options: the keyword arguments of ``gymnasium.make``.
        keep: keeps a closed world, or returns False.
    """

    def __init__(self, world_id: str, options: dict[str, Any] | None, keep: Callable[["_PooledWorld"], bool]) -> None:
        super().__init__(world_id, options)
        self._keep = keep
        self.can_repeat = self.is_built_in and not self._wrappers.any and not isinstance(self._env.unwrapped, SeatEnv)

    def close(self) -> None:
        """Return to the pool; close the environment if it is not kept."""
        if not self._keep(self):
            super().close()

    def close_finally(self) -> None:
        """Close the environment, so that the world cannot be used again."""
        super().close()
