"""A world in a separate process with the interface of `World`, and the factory that decides which worlds need it.

Worlds of the catalogue run in the session's process. So do other worlds whose steps a page can compute, since only our
compiled kernels step and draw them, and worlds of several bodies, whose seats share one state.
"""

import logging
import math
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Literal, TypeVar

import gymnasium
import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.trust import locate_world
from minihuman.worlds.adapters.foreign_code import RemoteCodeError
from minihuman.worlds.adapters.registered_module import find_registered_module
from minihuman.worlds.adapters.spaces import Action, ActionInterface, DiscreteActions, VectorActions
from minihuman.worlds.adapters.transition import ResetResult, StepResult
from minihuman.worlds.adapters.world import World
from minihuman.worlds.contract import Palette, PathLengthBounds, View, answer_to_old_names
from minihuman.worlds.hashing import resolve_files
from minihuman.worlds.isolation import messages
from minihuman.worlds.isolation.process_pool import DEFAULT_LIMITS, WorldLimits, WorldProcessPool
from minihuman.worlds.isolation.space_codec import decode_space
from minihuman.worlds.outcomes import OutcomeRule
from minihuman.worlds.pose import Map, Pose
from minihuman.worlds.value_codec import decode_value, encode_value

LOG = logging.getLogger("minihuman")
T = TypeVar("T")
WorldMaker = Callable[[str, dict[str, Any]], World]


class ElsewhereError(AttributeError):
    """An error for access to an environment that runs in another process."""


class RemoteEnvironment:
    """A placeholder, without attributes, for an environment that runs in another process."""

    def __init__(self, world_id: str) -> None:
        self._world_id = world_id

    def __getattr__(self, name: str) -> Any:
        raise ElsewhereError(
            f"{self._world_id} runs in a process of its own, where {name!r} cannot be reached; run it in the session's "
            "process with --worlds-in-process"
        )


class SavedState:
    """A reference to a copy of a world's state, which the world's process keeps as long as the reference exists."""

    __slots__ = ("_forgotten", "number")

    def __init__(self, number: int, forgotten: list[int]) -> None:
        self.number = number
        self._forgotten = forgotten

    def __del__(self) -> None:
        self._forgotten.append(self.number)


@dataclass(frozen=True, slots=True)
class RemoteStepResult(StepResult):
    """The result of a step in another process; its ``info`` stays there and can be read until the next step."""

    world: "IsolatedWorld | None" = None

    def find_success(self, rule: OutcomeRule) -> bool | None:
        """Return whether the world says that the episode succeeded, as `StepResult.find_success`."""
        if not rule.asks_world:
            return None
        assert self.world is not None
        stated = self.world.read_success(rule.info_key)
        if stated is not None or rule.info_key or not self.is_own:
            return stated
        return self.terminated and self.reward > 0

    def encode_info(self, keys: Sequence[str]) -> str:
        """Return chosen keys of ``info`` as JSON."""
        assert self.world is not None
        return self.world.encode_info(keys)


class IsolatedWorld(World):
    """A world in a separate process, which must be reset before any other use.

    Copies of its state can be restored in this world only. If the world fails, takes too long or ends its process, that
    call and all later ones raise `WorldError`.

    Args:
        world_id: the Gymnasium id of a trusted world
        options: the keyword arguments of ``gymnasium.make``, with the contents of the files to which they refer
        own_options: the same options as in the plan
        pool: the pool from which the process is taken and to which it returns

    Raises:
        WorldError: in the same cases as `World`.
    """

    has_portable_copies = False  # copies stay in the world's process

    def __init__(
        self, world_id: str, options: Mapping[str, Any], own_options: dict[str, Any], pool: WorldProcessPool
    ) -> None:
        self.id = world_id
        self.options = own_options
        self.is_built_in = False
        self._pool = pool
        self._process = pool.take(world_id)
        self._is_open = True
        self._moment: messages.StateReport | None = None
        self._copies = 0
        self._forgotten: list[int] = []
        try:
            construct = messages.Construct(world_id, encode_value(options), sys.path, find_registered_module(world_id))
            self._description = self._ask(construct, messages.Description, "its construction")
        except BaseException:
            self.close()
            raise
        self.drawn = self._description.drawn
        self.reward_means_success = self._description.reward_means_success
        self.actions = _build_actions(self._description)
        self.action_names = self.actions.names

    def _ask(self, request: messages.AnyRequest, answer: type[T], call: str) -> T:
        """Send a request to the world's process and return the answer; copies no longer needed are deleted first.

        Args:
            request: the request
            answer: the type of the answer
            call: the call that the request runs, such as "step()", for errors
        """
        limits = self._pool.limits
        is_long = isinstance(request, messages.Construct | messages.Reset) or call == "shortest_path()"
        if is_long:
            limit_s = limits.construction_s
        else:
            limit_s = limits.step_s
        if self._forgotten:
            numbers = self._forgotten[:]
            del self._forgotten[: len(numbers)]
            self._process.ask(messages.Forget(numbers), object, world_id=self.id, call=call, limit_s=limit_s)
        return self._process.ask(request, answer, world_id=self.id, call=call, limit_s=limit_s)

    def _query(self, name: str, answer: type[T]) -> T:
        """Return an attribute of the world, or the result of calling it."""
        return self._ask(messages.Query(name), answer, f"{name}()")

    @property
    def _present(self) -> messages.StateReport:
        """Return the latest report of the world's state."""
        assert self._moment is not None, "reset() comes first"
        return self._moment

    @property
    def pid(self) -> int:
        """Return the id of the world's process."""
        return self._process.pid

    @property
    def unwrapped(self) -> Any:
        """Return an object without attributes, since the environment is in another process."""
        return RemoteEnvironment(self.id)

    @property
    def env(self) -> Any:
        """Return an object without attributes, since the environment is in another process."""
        return RemoteEnvironment(self.id)

    @property
    def can_isolate(self) -> bool:
        """Return whether the world may stay in a separate process; a compiled world or a seat of a team may not."""
        return self._description.can_isolate

    @property
    def is_compiled(self) -> bool:
        """Return False, since compiled worlds are not isolated."""
        return False

    @property
    def knows_state(self) -> bool:
        """Return whether the environment reveals its whole state."""
        return self._present.scene_hash is None

    @property
    def observation(self) -> Any:
        """Return the latest observation."""
        return decode_value(self._query("observation", bytes))

    @property
    def observation_space(self) -> gymnasium.Space[Any]:
        """Return the space of the world's observations."""
        return decode_space(self._description.observation_space)

    @property
    def action_space(self) -> gymnasium.Space[Any]:
        """Return the space of the world's actions."""
        return decode_space(self._description.action_space)

    @property
    def step_limit(self) -> int | None:
        """Return the environment's own step limit per episode; None if it has none."""
        return self._query("step_limit", int | None)  # type: ignore[arg-type]

    @property
    def draws_itself(self) -> bool:
        """Return whether a participant sees what the environment's own ``render`` returns."""
        return self._query("draws_itself", bool)

    def reset(self, seed: int) -> ResetResult:
        """Begin an episode from a seed, with the wrappers in their initial state."""
        report = self._ask(messages.Reset(seed), messages.ResetReport, "reset()")
        self._moment = report.moment
        return ResetResult(report.observation_hash, report.mission, report.onset)

    def step(self, action: Action) -> StepResult:
        """Step the world by an action, as `World.step`."""
        report = self._ask(messages.Step(action), messages.StepReport, "step()")
        self._moment = report.moment
        return RemoteStepResult(
            report.reward,
            report.terminated,
            report.truncated,
            report.observation_hash,
            report.onset,
            is_own=report.is_own,
            world=self,
        )

    def read_success(self, key: str) -> bool | None:
        """Return whether the last step's ``info`` says that the episode succeeded; the key "" reads the usual keys."""
        return self._ask(messages.ReadSuccess(key), bool | None, "info")  # type: ignore[arg-type]

    def encode_info(self, keys: Sequence[str]) -> str:
        """Return chosen keys of the last step's ``info`` as JSON."""
        return self._ask(messages.EncodeInfo(list(keys)), str, "info")

    def advance(self, action: Action) -> tuple[bool, bool]:
        """Step the world without computing an observation, as `World.advance`."""
        terminated, truncated, self._moment = self._ask(
            messages.Advance(action), tuple[bool, bool, messages.StateReport], "advance()"
        )
        return terminated, truncated

    def pose(self) -> Pose | None:
        """Return the agent's pose; None if it is unknown."""
        if self._present.pose is None:
            return None
        return Pose(*self._present.pose)

    def subgoals(self) -> tuple[tuple[str, int], ...]:
        """Return the clauses of the episode's instruction, each with the step that fulfilled it, or 0 if not yet."""
        return self._present.subgoals

    def map(self) -> Map | None:
        """Return the floor plan; None where it is unknown."""
        return self._query("map", Map | None)  # type: ignore[arg-type]

    def state_hash(self) -> int:
        """Return a uint64 hash of everything that determines the world's future."""
        return self._present.state_hash

    def scene_hash(self) -> int:
        """Return the hash of the state without the step count; if the state is unknown, the same as `state_hash`."""
        scene_hash = self._present.scene_hash
        if scene_hash is None:
            return self._query("scene_hash", int)
        return scene_hash

    def shortest_path(self) -> tuple[str, ...] | None:
        """Return the names of actions that lead to success from here; None if the world has no planner."""
        names = self._query("shortest_path", tuple[str, ...] | None)  # type: ignore[arg-type]
        if names is None:
            return None
        return tuple(self.action_names[self.actions.names.index(name)] for name in names)

    def path_length_bounds(self) -> PathLengthBounds:
        """Return bounds on the number of steps from here to success."""
        return self._query("path_length_bounds", PathLengthBounds)

    def text(self) -> str:
        """Return the present observation of a grid world's agent, as a diagram and as sentences."""
        return self._query("text", str)

    def frame(
        self,
        view: View | Literal["text"] = "partial",
        size_px: tuple[int, int] = (640, 480),
        palette: Palette = "classic",
    ) -> NDArray[np.uint8]:
        """Return the picture that a person sees, as `World.frame`.

        Raises:
            WorldError: in the same cases as `World.frame`, or if pictures get larger with each request.
        """
        for _ in range(2):  # the second time with enough memory
            memory = self._process.memory
            name = "" if memory is None else memory.name
            draw = messages.Draw(view, size_px, palette, name)
            shape, is_there = self._ask(draw, tuple[tuple[int, int, int], bool], "render()")
            if is_there:
                break
            self._process.reserve_memory(math.prod(shape))
        if memory is None or not is_there:
            raise WorldError(f"{self.id}: render() returns a larger picture each time; return pictures of one size")
        return np.ndarray(shape, np.uint8, memory.buf).copy()

    def render(self, size_px: tuple[int, int]) -> Any:
        """Return the picture that a participant sees."""
        return self.frame(size_px=size_px)

    def picture_tiles(self, view: View | Literal["text"], size_px: tuple[int, int], palette: Palette) -> None:
        """Return None, since team worlds are not isolated."""

    def save(self) -> SavedState:
        """Save the state, also in the middle of an episode; only this world can restore it.

        Raises:
            WorldError: if the world cannot be copied.
        """
        self._copies += 1
        self._ask(messages.Save(self._copies), object, "save()")
        return SavedState(self._copies, self._forgotten)

    def restore(self, saved: SavedState) -> None:
        """Restore a saved state, which can be restored again."""
        self._moment = self._ask(messages.Restore(saved.number), messages.StateReport, "restore()")

    def close(self) -> None:
        """Close the environment, and return its process to the pool."""
        if not self._is_open:
            return
        self._is_open = False
        process = self._process
        if process.is_healthy:
            try:
                process.ask(
                    messages.Close(), object, world_id=self.id, call="close()", limit_s=self._pool.limits.step_s
                )
            except RemoteCodeError as error:  # no reason to fail: its episodes are over and recorded
                LOG.warning("the world did not close: %s", error)
        self._pool.give_back(process)


answer_to_old_names(IsolatedWorld)


def _build_actions(description: messages.Description) -> ActionInterface:
    """Return the actions of a world from its description."""
    space = decode_space(description.action_space)
    if isinstance(space, gymnasium.spaces.Discrete):
        chords = {frozenset(keys): action for keys, action in description.chords}
        return DiscreteActions(description.action_names, description.first_action, chords)
    names = description.action_names[1:-1]  # without rest and chord
    return VectorActions(space, element_names=names, resolution=description.action_resolution)


class IsolatedWorlds:
    """A factory that makes foreign worlds in separate processes, and all others in the session's process.

    Args:
        make_world: a function that makes a world in the session's process
        limits: the limits of each isolated world
    """

    def __init__(self, make_world: WorldMaker, limits: WorldLimits = DEFAULT_LIMITS) -> None:
        self.pool = WorldProcessPool(limits)
        self._make_world = make_world
        self._stays: set[str] = set()  # ids of worlds that cannot be isolated

    def __call__(self, world_id: str, options: dict[str, Any]) -> World:
        """Make a world.

        Raises:
            WorldError: if the world cannot be made.
        """
        if not self.isolates(world_id):
            return self._make_world(world_id, options)
        located = locate_world(world_id, options)
        world = IsolatedWorld(world_id, resolve_files(located), options, self.pool)
        if world.can_isolate:
            return world
        world.close()
        self._stays.add(world_id)
        return self._make_world(world_id, options)

    def isolates(self, world_id: str) -> bool:
        """Return whether a world will run in a separate process, judged before the world is made."""
        return world_id not in self._stays and not is_from_catalogue(world_id)

    def close(self) -> None:
        """End all processes."""
        self.pool.close()


@contextmanager
def choose_world_factory(isolates: bool) -> Iterator[WorldMaker]:
    """Yield the factory of a session's worlds; if ``isolates``, foreign worlds run in separate processes."""
    if not isolates:
        yield World
        return
    worlds = IsolatedWorlds(World)
    try:
        yield worlds
    finally:
        worlds.close()


def is_from_catalogue(world_id: str) -> bool:
    """Return whether only this package's code makes a world, according to the registry; import nothing for it."""
    module, _, name = world_id.rpartition(":")
    if module and module.partition(".")[0] != "minihuman":
        return False
    return find_registered_module(name).partition(".")[0] == "minihuman"
