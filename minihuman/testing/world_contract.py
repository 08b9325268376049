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
    wrong = isinstance(space, gymnasium.spaces.Discrete) and len(names) != int(space.n)
    require(not wrong, f"{world.id}: {len(names)} action names for {space}")
    require(len(set(names)) == len(names), f"{world.id}: two actions share a name: {', '.join(names)}")
    observed = world.reset(0)
    _require_inside(world, "reset")
    require(isinstance(observed.mission, str), f"{world.id}: its mission is not text")
    if world.pose() is not None:
        pose = world.pose()
        plan = world.map()
        assert pose is not None
        require(bool(np.isfinite((pose.x, pose.y, pose.z, pose.yaw_rad)).all()), f"{world.id}: its pose is {pose}")
        require(plan is not None, f"{world.id}: it has a pose and no map")


def _require_inside(world: World, call: str) -> None:
    """Require that the observation is in its space; the error names the line of code that makes it."""
    outside = find_outside(world.observation, world.observation_space)
    require(not outside, f"{world.id}: after a {call}, {outside}{_locate_observation(world, call)}")


def _locate_observation(world: World, call: str) -> str:
    """Return a clause that names the code that makes observations: "; Patrol.observation (patrol.py:31) makes it"."""
    env = world.env
    layers: list[Any] = [env]
    while isinstance(env, gymnasium.Wrapper):
        env = env.env
        layers.append(env)
    layers.append(getattr(env, "team", env))
    kinds = [kind for layer in layers for kind in type(layer).__mro__]
    for kind in kinds:
        if kind.__module__.startswith(("minihuman.", "gymnasium.", "builtins", "abc")):
            continue
        for name in ("observation", "observe", "look", call):
            if (code := getattr(vars(kind).get(name), "__code__", None)) is not None:
                place = f"{Path(code.co_filename).name}:{code.co_firstlineno}"
                return f"; {kind.__qualname__}.{name} ({place}) makes it, and observation_space has to say so"
    return "; correct observation_space"


def _play(world: World, seed: int, actions: list[int]) -> list[Step]:
    """Play the first steps of an episode and return them, with the reset as a first step without reward."""
    observed = world.reset(seed)
    _require_inside(world, "reset")
    steps: list[Step] = [(0.0, False, False, observed.observation_hash, world.state_hash())]
    return steps + list(_step_through(world, actions))


def _step_through(world: World, actions: list[int]) -> Iterator[Step]:
    for action in actions:
        change = world.step(action)
        _require_inside(world, "step")
        yield change.reward, change.terminated, change.truncated, change.observation_hash, world.state_hash()
        if change.terminated or change.truncated:
            return


def _check_determinism(world: World, other: World, seeds: tuple[int, int], actions: list[int]) -> int:
    """Check that equal seeds give equal episodes; return the number of steps of the two episodes that were played."""
    first = _play(world, seeds[0], actions)
    hashes = [step[-1] for step in first]
    require(
        len(set(hashes)) == len(hashes),
        f"{world.id}: two moments of one episode have one state hash; a step counts, and belongs to the state",
    )
    _require_same(f"{world.id}: reset again with seed {seeds[0]}", first, _play(world, seeds[0], actions))
    between = _play(other, seeds[1], actions)
    later = _play(other, seeds[0], actions)
    _require_same(f"{world.id}: after another episode (a wrapper or the world keeps something from it)", first, later)
    other.close()
    return len(first) + len(between) - 2


def _check_restore(world: World, seed: int, actions: list[int]) -> None:
    """Check that save and restore cover everything that an episode changes: the logged state is the whole state."""
    lasts = len(_play(world, seed, actions)) - 1
    for at in sorted({max(1, lasts * quarter // 4) for quarter in (1, 2, 3)}):
        _check_restore_from(world, seed, actions[:at], actions[at:])


def _check_restore_from(world: World, seed: int, before_it: list[int], after_it: list[int]) -> None:
    """Check that a state saved in mid-episode can be restored, also after pickling, and played on equally."""
    if any(step[1] or step[2] for step in _play(world, seed, before_it)):
        return  # over with its first step: there is no middle to come back to
    saved = world.save()
    before = world.state_hash()
    own = _own_attributes(world)
    first = list(_step_through(world, after_it))
    world.restore(saved)
    require(world.state_hash() == before, f"{world.id}: restored, it has another state hash")
    _require_restored(world, own)
    _require_same(f"{world.id}: restored", first, list(_step_through(world, after_it)))
    world.restore(pickle.loads(pickle.dumps(saved)))
    require(world.state_hash() == before, f"{world.id}: restored from a pickle, it has another state hash")


def _require_restored(world: World, own: dict[str, bytes]) -> None:
    changed = [name for name, value in _own_attributes(world).items() if value != own.get(name, value)]
    require(
        not changed,
        f"{world.id}: {', '.join(changed)} changes in an episode and does not come back; "
        "name it in the world's kept = (...), or keep it where save() finds it",
    )


def _search(world: World, seed: int, most_steps: int) -> WorldSearch:
    """Try every action in every situation, nearest first; check that each change can be restored and repeated."""
    search = WorldSearch()
    if not isinstance(world.unwrapped, NativeWorld):
        return search
    first = world.reset(seed)
    waiting = deque([world.save()])
    situations = {_situation(world, first.observation_hash)}
    while waiting and search.steps < most_steps:
        saved = waiting.popleft()
        world.restore(saved)
        own = _own_attributes(world)
        for action in range(len(world.action_names)):
            steps = list(_step_through(world, [action] * (STRIDE if world.drawn else 1)))
            reward, terminated, truncated, observed, _ = steps[-1]
            search.steps += len(steps)
            search.rewarded += reward != 0
            search.ended += terminated
            place = _situation(world, observed)
            if not (terminated or truncated or place in situations):
                situations.add(place)
                waiting.append(world.save())
            changed = [name for name, value in _own_attributes(world).items() if value != own.get(name)]
            search.changed.update(changed)
            world.restore(saved)
            if changed or reward != 0:
                _require_restored(world, own)
                again = list(_step_through(world, [action] * len(steps)))
                _require_same(f"{world.id}: {world.action_names[action]} after a restore", steps, again)
                world.restore(saved)
    search.situations = len(situations)
    return search


def _situation(world: World, observation_hash: int) -> Hashable:
    """Return the agent's rough pose and its observation's hash; in a drawn world, the objects' places instead of it."""
    pose = world.pose()
    assert pose is not None
    place = round(2 * pose.x), round(2 * pose.z), round(4 * pose.yaw_rad / np.pi) % 8
    if not world.drawn:
        return place, observation_hash
    plan = world.map()
    assert plan is not None
    return place, tuple((thing.name, round(thing.x), round(thing.z)) for thing in plan.things)


def _own_attributes(world: World) -> dict[str, bytes]:
    """Return the pickled values of the attributes that a world's class adds to minihuman's base classes, by name."""
    env = getattr(world.unwrapped, "team", world.unwrapped)
    if not isinstance(env, NativeWorld | TeamWorld):
        return {}
    kinds = [kind for kind in type(env).__mro__ if kind.__module__.startswith("minihuman.")]
    functions = [value for kind in kinds for value in vars(kind).values() if hasattr(value, "__code__")]
    ours = {name for function in functions for name in function.__code__.co_names}  # what their code may set on self
    own = {}
    for name, value in vars(env).items():
        if name not in ours and not name.startswith("_"):
            try:
                own[name] = pickle.dumps(value)
            except Exception as error:
                raise ContractError(
                    f"{world.id}: attribute {name} cannot be pickled ({error}); "
                    "store only plain values in it, such as numbers and arrays"
                ) from error
    return own


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
    """Check that our worlds refuse a step after the end and stay unchanged; return whether an end was reached."""
    if not isinstance(world.unwrapped, NativeWorld):
        return False
    chance = np.random.default_rng(seed)
    actions = chance.integers(len(world.action_names), size=MAX_STEPS).tolist()
    steps = _play(world, seed, actions)
    if not (steps[-1][1] or steps[-1][2]):
        return False  # an episode without an end in sight
    before = world.state_hash()
    try:
        world.step(0)
    except WorldError:
        require(world.state_hash() == before, f"{world.id}: a step after the end is refused, and changes the state")
    else:
        raise ContractError(
            f"{world.id}: step() is accepted after the end of an episode; raise a WorldError that asks for a reset"
        )
    return True


def _describe_plan(world: World, seed: int) -> str:
    """Return a description of the path that the world offers to simulated participants."""
    world.reset(seed)
    try:
        path = world.shortest_path()
        bounds = world.path_length_bounds()
    except WorldError as error:
        return f"shortest_path() says {error}; they play at random where it does"
    if path is None:
        return (
            "only --player random, for the world has no shortest_path(self) -> list of actions; define it, and "
            "path_length_bounds(self) where a lower bound is known"
        )
    return f"shortest_path() has {len(path)} steps, path_length_bounds() {bounds.at_least} to {bounds.feasible}"


def _require_same(when: str, expected: list[Step], actual: list[Step]) -> None:
    """Require that two episodes agree in everything that a step returns, and in their lengths."""
    names = ("reward", "terminated", "truncated", "observation", "state")
    for number, (expected_step, actual_step) in enumerate(zip(expected, actual, strict=False)):
        for name, before, now in zip(names, expected_step, actual_step, strict=True):
            require(before == now, f"{when}: step {number} has another {name}: {before} before, {now} now")
    n_expected = len(expected) - 1  # the first is the reset
    n_actual = len(actual) - 1
    require(n_expected == n_actual, f"{when}: it ends after {n_actual} steps, not {n_expected}")


@contextmanager
def _register_temporarily(make: str | Callable[..., gymnasium.Env[Any, Any]]) -> Iterator[str]:
    """Yield the id of a world; a function that makes one is registered meanwhile."""
    if isinstance(make, str):
        yield make
        return
    gymnasium.register(_CHECKED, entry_point=make, order_enforce=False, disable_env_checker=True)
    try:
        yield _CHECKED
    finally:
        gymnasium.registry.pop(_CHECKED, None)
