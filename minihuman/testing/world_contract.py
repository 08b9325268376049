"""Contract test of worlds: equal seeds give equal episodes, saved states are restored, and states are drawn."""

import pickle
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import gymnasium
import numpy as np

from minihuman.errors import WorldError
from minihuman.testing.checks import ContractError, require
from minihuman.worlds.adapters.world import World
from minihuman.worlds.contract import NativeWorld

SIZE_PX = (320, 240)
MAX_STEPS = 2_000  # that are played to reach an end
_CHECKED = "minihuman-testing/world-v0"

Step = tuple[float, bool, bool, int, int]  # reward, terminated, truncated, hashes of observation and state


def check_world(
    make: str | Callable[..., gymnasium.Env[Any, Any]],
    options: dict[str, Any] | None = None,
    *,
    seeds: tuple[int, int] = (0, 1),
    steps: int = 30,
) -> None:
    """Play a world, wrappers included, as a session would, and check what a log of it stands on.

    Args:
        make: a Gymnasium id, with the module that registers it before a colon where needed; or what makes the world,
            a class or a function that takes Gymnasium's ``render_mode``.
        options: further arguments of its making.
        seeds: of the two episodes that are played.
        steps: of each, at most.

    Raises:
        ContractError: if a promise is not kept; it says which.
        WorldError: if the world cannot be made or drawn.
    """
    with _registered(make) as world_id:
        chance = np.random.default_rng(seeds[0])
        world = World(world_id, options, trusted=True)
        actions = chance.integers(len(world.action_names), size=steps).tolist()
        try:
            _says_what_it_is(world)
            _plays_alike(world, World(world_id, options, trusted=True), seeds, actions)
            _comes_back(world, seeds[0], actions)
            _is_drawn(world, seeds[0], actions)
            _ends(world, seeds[0])
        finally:
            world.close()
        world.close()  # closing twice is closing once


def _says_what_it_is(world: World) -> None:
    names = world.action_names
    require(
        len(names) == int(world.action_space.n), f"{world.id}: {len(names)} action names, not {world.action_space.n}"
    )
    require(len(set(names)) == len(names), f"{world.id}: two actions share a name: {', '.join(names)}")
    observed = world.reset(0)
    inside = world.observation in world.observation_space
    require(inside, f"{world.id}: the first observation is not in the observation space")
    require(isinstance(observed.mission, str), f"{world.id}: its mission is not text")
    if world.pose() is not None:
        pose, plan = world.pose(), world.map()
        assert pose is not None
        require(bool(np.isfinite((pose.x, pose.y, pose.z, pose.yaw_rad)).all()), f"{world.id}: its pose is {pose}")
        require(plan is not None, f"{world.id}: it has a pose and no map")


def _play(world: World, seed: int, actions: list[int]) -> list[Step]:
    """An episode's first steps; the reset comes first, as a step that earns nothing."""
    observed = world.reset(seed)
    said: list[Step] = [(0.0, False, False, observed.observation_hash, world.state_hash())]
    return said + list(_go_on(world, actions))


def _go_on(world: World, actions: list[int]) -> Iterator[Step]:
    for action in actions:
        change = world.step(action)
        yield change.reward, change.terminated, change.truncated, change.observation_hash, world.state_hash()
        if change.terminated or change.truncated:
            return


def _plays_alike(world: World, other: World, seeds: tuple[int, int], actions: list[int]) -> None:
    first = _play(world, seeds[0], actions)
    hashes = [step[-1] for step in first]
    require(
        len(set(hashes)) == len(hashes),
        f"{world.id}: two moments of one episode have one state hash; a step counts, and belongs to the state",
    )
    _same(f"{world.id}: reset again with seed {seeds[0]}", first, _play(world, seeds[0], actions))
    _play(other, seeds[1], actions)
    later = _play(other, seeds[0], actions)
    _same(f"{world.id}: after another episode (a wrapper or the world keeps something from it)", first, later)
    other.close()


def _comes_back(world: World, seed: int, actions: list[int]) -> None:
    """Whatever an episode changes is saved and restored: what the log calls the state is the state."""
    lasts = len(_play(world, seed, actions)) - 1
    for at in sorted({max(1, lasts * quarter // 4) for quarter in (1, 2, 3)}):
        _comes_back_from(world, seed, actions[:at], actions[at:])


def _comes_back_from(world: World, seed: int, before_it: list[int], after_it: list[int]) -> None:
    if any(step[1] or step[2] for step in _play(world, seed, before_it)):
        return  # over with its first step: there is no middle to come back to
    saved, before, own = world.save(), world.state_hash(), _own_attributes(world)
    first = list(_go_on(world, after_it))
    world.restore(saved)
    require(world.state_hash() == before, f"{world.id}: restored, it has another state hash")
    changed = [name for name, value in _own_attributes(world).items() if value != own.get(name, value)]
    require(
        not changed,
        f"{world.id}: {', '.join(changed)} changes in an episode and does not come back; "
        "name it in the world's kept = (...), or keep it where save() finds it",
    )
    _same(f"{world.id}: restored", first, list(_go_on(world, after_it)))
    world.restore(pickle.loads(pickle.dumps(saved)))
    require(world.state_hash() == before, f"{world.id}: restored from a pickle, it has another state hash")


def _own_attributes(world: World) -> dict[str, bytes]:
    """The attributes that a world's own class adds to ours, as bytes."""
    env = world.unwrapped
    if not isinstance(env, NativeWorld):
        return {}
    ours = {name for kind in type(env).__mro__ if kind.__module__.startswith("minihuman.") for name in _set_by(kind)}
    own = {}
    for name, value in vars(env).items():
        if name not in ours and not name.startswith("_"):
            try:
                own[name] = pickle.dumps(value)
            except Exception as error:
                raise ContractError(
                    f"{world.id}: attribute {name} cannot be pickled ({error}); keep plain values"
                ) from error
    return own


def _set_by(kind: type) -> set[str]:
    """The attributes that a class's own methods set on self: the names that their code stores."""
    functions = [value for value in vars(kind).values() if hasattr(value, "__code__")]
    return {name for function in functions for name in function.__code__.co_names}


def _is_drawn(world: World, seed: int, actions: list[int]) -> None:
    """Drawing changes nothing, and a participant sees what the wrappers show."""
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
    shown = world.env
    while isinstance(shown, gymnasium.Wrapper):
        if "render" in vars(type(shown)) and not type(shown).__module__.startswith("gymnasium."):
            require(
                np.array_equal(world.frame("partial", SIZE_PX), np.asarray(world.env.render())),
                f"{world.id}: the wrapper {type(shown).__name__} draws another picture than the participant sees",
            )
            return
        shown = shown.env


def _ends(world: World, seed: int) -> None:
    """A step after the end is refused and changes nothing, in worlds of ours."""
    if not isinstance(world.unwrapped, NativeWorld):
        return
    chance = np.random.default_rng(seed)
    actions = chance.integers(len(world.action_names), size=MAX_STEPS).tolist()
    said = _play(world, seed, actions)
    if not (said[-1][1] or said[-1][2]):
        return  # an episode without an end in sight
    before = world.state_hash()
    try:
        world.step(0)
    except WorldError:
        require(world.state_hash() == before, f"{world.id}: a step after the end is refused, and changes the state")
    else:
        raise ContractError(f"{world.id}: a step after the end is accepted; raise a WorldError that asks for a reset")


def _same(when: str, expected: list[Step], found: list[Step]) -> None:
    names = "reward", "terminated", "truncated", "observation", "state"
    for number, (one, other) in enumerate(zip(expected, found, strict=False)):
        for name, a, b in zip(names, one, other, strict=True):
            require(a == b, f"{when}: step {number} has another {name}: {a} before, {b} now")
    require(len(expected) == len(found), f"{when}: it ends after {len(found) - 1} steps, not {len(expected) - 1}")


@contextmanager
def _registered(make: str | Callable[..., gymnasium.Env[Any, Any]]) -> Iterator[str]:
    if isinstance(make, str):
        yield make
        return
    gymnasium.register(_CHECKED, entry_point=make, order_enforce=False, disable_env_checker=True)
    try:
        yield _CHECKED
    finally:
        gymnasium.registry.pop(_CHECKED, None)
