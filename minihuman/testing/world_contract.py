"""Contract test of worlds: equal seeds give equal episodes, saved states can be restored, and states can be drawn."""

import pickle
from collections import Counter, deque
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

from minihuman.errors import WorldError
from minihuman.testing.checks import ContractError, require
from minihuman.worlds.adapters.world import World
from minihuman.worlds.contract import NativeWorld
from minihuman.worlds.observation_spaces import find_outside
from minihuman.worlds.team import TeamWorld

SIZE_PX = (320, 240)
MAX_STEPS = 2_000  # that are played to reach an end
STRIDE = 4  # steps of the same action that the search takes in first person, where one is short
_CHECKED = "minihuman-testing/world-v0"

Step = tuple[float, bool, bool, int, int]  # reward, terminated, truncated, hashes of observation and state


@dataclass(slots=True)
class WorldSearch:
    """The coverage of the search for rare state changes."""

    steps: int = 0
    situations: int = 0  # a place and what is seen there
    rewarded: int = 0  # steps that earned something
    ended: int = 0  # steps that ended the episode
    changed: Counter[str] = field(default_factory=Counter)  # the world's own attributes, and how often each changed


@dataclass(frozen=True, slots=True)
class WorldReport:
    """The coverage of a world's contract test, as a printable report."""

    world: str
    steps: int  # of the episodes that were played twice
    search: WorldSearch
    refuses_after_end: bool  # False: no end was reached
    planned: str  # what the world offers a simulated participant

    def __str__(self) -> str:
        search = self.search
        own = ", ".join(f"{name} ({times} times)" for name, times in sorted(search.changed.items()))
        if self.refuses_after_end:
            after = "a step after the end is refused"
        else:
            after = f"none came within {MAX_STEPS} steps"
        return "\n".join(
            [
                f"{self.world} keeps what a world promises:",
                f"  seeds: two episodes, {self.steps} steps, the same again and after another episode",
                f"  save and restore: in mid-episode, and in {search.situations} situations, by {search.steps} steps",
                f"  own attributes that changed there, all restored: {own or 'none'}",
                f"  rewards and ends: {search.rewarded} steps there earned something, {search.ended} ended the episode",
                "  pictures: two views in two palettes, the same again, and drawing changes nothing",
                f"  after the end: {after}",
                f"  simulated participants: {self.planned}",
            ]
        )


def check_world(
    make: str | Callable[..., gymnasium.Env[Any, Any]],
    options: dict[str, Any] | None = None,
    *,
    seeds: tuple[int, int] = (0, 1),
    steps: int = 30,
    search_steps: int = 2_000,
) -> WorldReport:
    """Play a world, including its wrappers, as a session would, and check what its logs rely on.

    The check also searches the world by save and restore: it tries every action in every situation that it reaches,
    nearest first, so it reaches states that random actions seldom reach.

    Args:
        make: a Gymnasium id, with the module that registers it before a colon where needed; or a class or function that
            makes the world and takes Gymnasium's ``render_mode``.
        options: further arguments for making the world.
        seeds: the seeds of the two episodes that are played.
        steps: the maximum number of steps of each episode.
        search_steps: the maximum number of steps of the search; a large world may need more.

    Returns:
        A printable report of what was checked, and of what the world offers simulated participants.

    Raises:
        ContractError: if a guarantee is broken; the message says which.
        WorldError: if the world cannot be made or drawn.
    """
    with _register_temporarily(make) as world_id:
        chance = np.random.default_rng(seeds[0])
        world = World(world_id, options, trusted=True)
        actions = chance.integers(len(world.actions.numbers), size=steps).tolist()
        try:
            _check_description(world)
            played = _check_determinism(world, World(world_id, options, trusted=True), seeds, actions)
            _check_restore(world, seeds[0], actions)
            search = _search(world, seeds[0], search_steps)
            _check_drawing(world, seeds[0], actions)
            report = WorldReport(
                world_id if isinstance(make, str) else getattr(make, "__qualname__", str(make)),
                steps=played,
                search=search,
                refuses_after_end=_check_end(world, seeds[0]),
                planned=_describe_plan(world, seeds[0]),
            )
        finally:
            world.close()
        world.close()  # closing twice is closing once
        return report


def _check_description(world: World) -> None:
    names = world.action_names
    space = world.action_space
    has_all_names = not isinstance(space, gymnasium.spaces.Discrete) or len(names) == int(space.n)
    require(has_all_names, f"{world.id}: {len(names)} action names for {space}")
    require(len(set(names)) == len(names), f"{world.id}: two actions share a name: {', '.join(names)}")
    observed = world.reset(0)
    _require_inside(world, "reset")
    require(isinstance(observed.mission, str), f"{world.id}: its mission is not text")
    pose = world.pose()
    if pose is not None:
        is_finite = bool(np.isfinite((pose.x, pose.y, pose.z, pose.yaw_rad)).all())
        require(is_finite, f"{world.id}: its pose is {pose}")
        require(world.map() is not None, f"{world.id}: it has a pose and no map")


def _require_inside(world: World, call: str) -> None:
    """Require that a world's observation is in its space after a call of "reset" or "step".

    The error names the code that makes the observation.
    """
    outside = find_outside(world.observation, world.observation_space)
    require(not outside, f"{world.id}: after a {call}, {outside}{_locate_observation(world, call)}")


def _locate_observation(world: World, call: str) -> str:
    """Return a clause that names the code that makes observations: "; Patrol.observation (patrol.py:31) makes it".

    It is the first method with a usual name in the classes of the wrappers and the world that are not libraries'.
    """
    env = world.env
    layers: list[Any] = [env]
    while isinstance(env, gymnasium.Wrapper):
        env = env.env
        layers.append(env)
    layers.append(getattr(env, "team", env))
    classes = [cls for layer in layers for cls in type(layer).__mro__]
    for cls in classes:
        if cls.__module__.startswith(("minihuman.", "gymnasium.", "builtins", "abc")):
            continue
        for name in ("observation", "observe", "look", call):
            if (code := getattr(vars(cls).get(name), "__code__", None)) is not None:
                source_line = f"{Path(code.co_filename).name}:{code.co_firstlineno}"
                return f"; {cls.__qualname__}.{name} ({source_line}) makes it, and observation_space has to say so"
    return "; correct observation_space"


def _play(world: World, seed: int, actions: list[int]) -> list[Step]:
    """Reset a world, make steps with the actions, and return them; the first is the reset, a step without reward."""
    observed = world.reset(seed)
    _require_inside(world, "reset")
    steps: list[Step] = [(0.0, False, False, observed.observation_hash, world.state_hash())]
    return steps + list(_step_through(world, actions))


def _step_through(world: World, actions: list[int]) -> Iterator[Step]:
    """Make steps with the given actions until they or the episode end, and yield each step."""
    for action in actions:
        transition = world.step(action)
        _require_inside(world, "step")
        is_terminated = transition.terminated
        is_truncated = transition.truncated
        yield transition.reward, is_terminated, is_truncated, transition.observation_hash, world.state_hash()
        if is_terminated or is_truncated:
            return


def _check_determinism(world: World, other: World, seeds: tuple[int, int], actions: list[int]) -> int:
    """Check that equal seeds give equal episodes; return the number of steps of the two different episodes.

    ``other`` is the same world, made once more, in which the second episode is played before the first.
    """
    first = _play(world, seeds[0], actions)
    hashes = [step[-1] for step in first]
    require(
        len(set(hashes)) == len(hashes),
        f"{world.id}: two moments of one episode have one state hash; a step counts, and belongs to the state",
    )
    _require_same(f"{world.id}: reset again with seed {seeds[0]}", first, _play(world, seeds[0], actions))
    second = _play(other, seeds[1], actions)
    first_afterwards = _play(other, seeds[0], actions)
    context = f"{world.id}: after another episode (a wrapper or the world keeps something from it)"
    _require_same(context, first, first_afterwards)
    other.close()
    return len(first) + len(second) - 2  # without the resets


def _check_restore(world: World, seed: int, actions: list[int]) -> None:
    """Check at up to three points of an episode that save and restore cover everything that the episode changes."""
    n_steps = len(_play(world, seed, actions)) - 1
    for save_step in sorted({max(1, n_steps * quarter // 4) for quarter in (1, 2, 3)}):
        _check_restore_from(world, seed, actions[:save_step], actions[save_step:])


def _check_restore_from(world: World, seed: int, actions_before: list[int], actions_after: list[int]) -> None:
    """Check that a state saved in mid-episode can be restored, also after pickling, and played on equally."""
    if any(terminated or truncated for _, terminated, truncated, *_ in _play(world, seed, actions_before)):
        return  # over with its first step: there is no middle to come back to
    saved = world.save()
    saved_hash = world.state_hash()
    saved_attributes = _pickle_own_attributes(world)
    steps = list(_step_through(world, actions_after))
    world.restore(saved)
    require(world.state_hash() == saved_hash, f"{world.id}: restored, it has another state hash")
    _require_restored(world, saved_attributes)
    _require_same(f"{world.id}: restored", steps, list(_step_through(world, actions_after)))
    world.restore(pickle.loads(pickle.dumps(saved)))
    require(world.state_hash() == saved_hash, f"{world.id}: restored from a pickle, it has another state hash")


def _require_restored(world: World, saved_attributes: dict[str, bytes]) -> None:
    """Require that a world's own attributes are as in ``saved_attributes``, pickled when its state was saved."""
    attributes = _pickle_own_attributes(world)
    changed = [name for name, pickled in attributes.items() if pickled != saved_attributes.get(name, pickled)]
    require(
        not changed,
        f"{world.id}: {', '.join(changed)} changes in an episode and does not come back; "
        "name it in the world's kept = (...), or keep it where save() finds it",
    )


def _search(world: World, seed: int, max_steps: int) -> WorldSearch:
    """Try every action in every situation, nearest first, and check restores; return how much the search covered.

    A world that is not written with minihuman's classes is not searched. The search ends after ``max_steps`` steps.
    """
    search = WorldSearch()
    if not isinstance(world.unwrapped, NativeWorld):
        return search
    first = world.reset(seed)
    unexplored = deque([world.save()])
    situations = {_identify_situation(world, first.observation_hash)}
    while unexplored and search.steps < max_steps:
        saved = unexplored.popleft()
        world.restore(saved)
        saved_attributes = _pickle_own_attributes(world)
        for action in range(len(world.action_names)):
            steps = list(_step_through(world, [action] * (STRIDE if world.drawn else 1)))
            reward, terminated, truncated, observation_hash, _ = steps[-1]
            search.steps += len(steps)
            search.rewarded += reward != 0
            search.ended += terminated
            situation = _identify_situation(world, observation_hash)
            if not (terminated or truncated or situation in situations):
                situations.add(situation)
                unexplored.append(world.save())
            attributes = _pickle_own_attributes(world)
            changed = [name for name, pickled in attributes.items() if pickled != saved_attributes.get(name)]
            search.changed.update(changed)
            world.restore(saved)
            if changed or reward != 0:
                _require_restored(world, saved_attributes)
                repeated_steps = list(_step_through(world, [action] * len(steps)))
                _require_same(f"{world.id}: {world.action_names[action]} after a restore", steps, repeated_steps)
                world.restore(saved)
    search.situations = len(situations)
    return search


def _identify_situation(world: World, observation_hash: int) -> Hashable:
    """Return a key that is equal for states that the search treats as the same situation.

    It has the agent's rough pose and the observation's hash; in a drawn world, whose pictures differ at each pose, it
    has the objects' rough places instead of the hash.
    """
    pose = world.pose()
    assert pose is not None
    # in half units of the map, and eighths of a turn
    rough_pose = round(2 * pose.x), round(2 * pose.z), round(4 * pose.yaw_rad / np.pi) % 8
    if not world.drawn:
        return rough_pose, observation_hash
    plan = world.map()
    assert plan is not None
    return rough_pose, tuple((thing.name, round(thing.x), round(thing.z)) for thing in plan.things)


def _pickle_own_attributes(world: World) -> dict[str, bytes]:
    """Return, by name, the pickled attributes that a world's class adds to those of minihuman's base classes.

    Raises:
        ContractError: if an attribute cannot be pickled.
    """
    env = getattr(world.unwrapped, "team", world.unwrapped)
    if not isinstance(env, NativeWorld | TeamWorld):
        return {}
    base_classes = [cls for cls in type(env).__mro__ if cls.__module__.startswith("minihuman.")]
    methods = [member for cls in base_classes for member in vars(cls).values() if hasattr(member, "__code__")]
    base_names = {name for method in methods for name in method.__code__.co_names}  # what they may set on self
    pickled_attributes = {}
    for name, attribute in vars(env).items():
        if name not in base_names and not name.startswith("_"):
            try:
                pickled_attributes[name] = pickle.dumps(attribute)
            except Exception as error:
                raise ContractError(
                    f"{world.id}: attribute {name} cannot be pickled ({error}); "
                    "store only plain values in it, such as numbers and arrays"
                ) from error
    return pickled_attributes


def _check_drawing(world: World, seed: int, actions: list[int]) -> None:
    """Check that drawing does not change the world, and that participants see what the wrappers draw."""
    _play(world, seed, actions[:3])
    before = world.state_hash()
    for view in ("partial", "full"):
        for palette in ("classic", "colour-safe"):
            picture = world.frame(view, SIZE_PX, palette)
            require(
                isinstance(picture, np.ndarray) and picture.dtype == np.uint8 and picture.shape[2:] == (3,),
                f"{world.id}: its picture is not uint8[H, W, 3]",
            )
            again = world.frame(view, SIZE_PX, palette)
            require(np.array_equal(picture, again), f"{world.id}: drawn twice, it looks different")
    require(world.state_hash() == before, f"{world.id}: drawing it changes its state")
    layer = world.env
    while isinstance(layer, gymnasium.Wrapper):
        if "render" in vars(type(layer)) and not type(layer).__module__.startswith("gymnasium."):
            require(
                np.array_equal(world.frame("partial", SIZE_PX), np.asarray(world.env.render())),
                f"{world.id}: the wrapper {type(layer).__name__} draws another picture than the participant sees",
            )
            return
        layer = layer.env


def _check_end(world: World, seed: int) -> bool:
    """Check that a world refuses a step after an episode's end and stays unchanged; return whether an end was reached.

    Only worlds written with minihuman's classes are checked; for others, return False.
    """
    if not isinstance(world.unwrapped, NativeWorld):
        return False
    chance = np.random.default_rng(seed)
    actions = chance.integers(len(world.action_names), size=MAX_STEPS).tolist()
    _, terminated, truncated, *_ = _play(world, seed, actions)[-1]
    if not (terminated or truncated):
        return False  # an episode without an end in sight
    final_hash = world.state_hash()
    try:
        world.step(0)
    except WorldError:
        is_unchanged = world.state_hash() == final_hash
        require(is_unchanged, f"{world.id}: a step after the end is refused, and changes the state")
    else:
        raise ContractError(
            f"{world.id}: step() is accepted after the end of an episode; raise a WorldError that asks for a reset"
        )
    return True


def _describe_plan(world: World, seed: int) -> str:
    """Return a text about the shortest path that a world offers to simulated participants, or why it offers none."""
    world.reset(seed)
    method = "shortest_path()"
    try:
        path = world.shortest_path()
        method = "path_length_bounds()"
        bounds = world.path_length_bounds()
    except WorldError as error:
        return f"{method} raises {error}; simulated participants play at random where it does"
    if path is None:
        return (
            "only --player random, for the world has no shortest_path(self) -> list of actions; define it, and "
            "path_length_bounds(self) where a lower bound is known"
        )
    return f"shortest_path() has {len(path)} steps, path_length_bounds() {bounds.at_least} to {bounds.feasible}"


def _require_same(when: str, expected: list[Step], actual: list[Step]) -> None:
    """Require that two lists of steps agree in all that a step returns, and in length; ``when`` begins the error."""
    names = ("reward", "terminated", "truncated", "observation", "state")
    for number, (expected_step, actual_step) in enumerate(zip(expected, actual, strict=False)):
        for name, before, now in zip(names, expected_step, actual_step, strict=True):
            require(before == now, f"{when}: step {number} has another {name}: {before} before, {now} now")
    n_expected = len(expected) - 1  # the first is the reset
    n_actual = len(actual) - 1
    require(n_expected == n_actual, f"{when}: it ends after {n_actual} steps, not {n_expected}")


@contextmanager
def _register_temporarily(make: str | Callable[..., gymnasium.Env[Any, Any]]) -> Iterator[str]:
    """Yield the id of a world; a class or function that makes a world is registered under an id until the exit."""
    if isinstance(make, str):
        yield make
        return
    gymnasium.register(_CHECKED, entry_point=make, order_enforce=False, disable_env_checker=True)
    try:
        yield _CHECKED
    finally:
        gymnasium.registry.pop(_CHECKED, None)
