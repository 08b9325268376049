"""Minigrid's own wrappers around our worlds give what they give around Minigrid's."""

import gymnasium
import minigrid  # noqa: F401
import numpy as np
import pytest
from minigrid import wrappers

import minihuman  # noqa: F401
from minihuman.errors import WorldError
from tests.counts import count

pytestmark = pytest.mark.filterwarnings("ignore:.*out of date", "ignore:.*Overriding environment")

WRAPPERS = {
    "RGBImgObs": wrappers.RGBImgObsWrapper,
    "RGBImgObs, tiles of 12": lambda env: wrappers.RGBImgObsWrapper(env, tile_size=12),
    "RGBImgPartialObs": wrappers.RGBImgPartialObsWrapper,
    "RGBImgPartialObs of ViewSize 5": lambda env: wrappers.RGBImgPartialObsWrapper(wrappers.ViewSizeWrapper(env, 5)),
    "FullyObs": wrappers.FullyObsWrapper,
    "FlatObs": lambda env: wrappers.FlatObsWrapper(env, maxStrLen=400),
    "SymbolicObs": wrappers.SymbolicObsWrapper,
    "DictObservationSpace": wrappers.DictObservationSpaceWrapper,
    "ViewSize 3": lambda env: wrappers.ViewSizeWrapper(env, 3),
    "ViewSize 11": lambda env: wrappers.ViewSizeWrapper(env, 11),
    "DirectionObs": wrappers.DirectionObsWrapper,
    "DirectionObs, atan2": lambda env: wrappers.DirectionObsWrapper(env, type="angle_atan2"),
    "ImgObs": wrappers.ImgObsWrapper,
    "ImgObs of OneHotPartialObs": lambda env: wrappers.ImgObsWrapper(wrappers.OneHotPartialObsWrapper(env)),
    "Reseed": lambda env: wrappers.ReseedWrapper(env, seeds=(11, 12)),
    "PositionBonus": wrappers.PositionBonus,
    "ActionBonus": wrappers.ActionBonus,
    "StochasticAction": lambda env: wrappers.StochasticActionWrapper(env, prob=0.6),
    "StochasticAction, forward": lambda env: wrappers.StochasticActionWrapper(env, prob=0.6, random_action=2),
    "NoDeath": lambda env: wrappers.NoDeath(env, no_death_types=("lava", "ball")),
}
IDS = tuple(id for id in gymnasium.registry if id.startswith(("MiniGrid-", "BabyAI-")))
IDS = tuple(
    id for id in IDS if f"minihuman/{id}" in gymnasium.registry and "WFC" not in id
)  # whose pictures Minigrid lacks
SOME = ("MiniGrid-DoorKey-6x6-v0", "MiniGrid-LavaCrossingS9N1-v0", "MiniGrid-ObstructedMaze-1Q-v1")


def played(id, wrapper, steps):
    """What a seeded episode gives: observations, rewards and ends, or the error that ended it."""
    env = gymnasium.make(id)
    chance, given = np.random.default_rng(7), []
    try:
        env = WRAPPERS[wrapper](env)
        given.append(env.reset(seed=None if wrapper == "Reseed" else 5)[0])
        for _ in range(steps):
            observation, *rest = env.step(int(chance.choice(env.action_space.n)))
            given.append((observation, *rest))
            if rest[1] or rest[2]:
                given.append(env.reset()[0])
    except (AssertionError, ValueError, WorldError) as error:
        given.append(error)
    return given


def same(ours, theirs):
    if isinstance(theirs, dict):
        return list(ours) == list(theirs) and all(same(ours[name], theirs[name]) for name in theirs)
    if isinstance(theirs, tuple):
        return len(ours) == len(theirs) and all(same(*pair) for pair in zip(ours, theirs, strict=True))
    if isinstance(theirs, np.ndarray):
        return ours.dtype == theirs.dtype and np.array_equal(ours, theirs)
    return bool(ours == theirs)


def check_equal(id, wrapper, steps):
    ours, theirs = (played(name, wrapper, steps) for name in (f"minihuman/{id}", id))
    for number, (mine, other) in enumerate(zip(ours, theirs, strict=False)):
        if isinstance(mine, WorldError) and wrapper == "NoDeath":
            assert "wrappers.NoDeath" in str(mine)  # an episode that has ended does not go on
            assert number > 0
            return
        if isinstance(other, Exception):
            assert type(mine) is type(other)
            assert str(mine) == str(other)
            return
        assert same(mine, other), f"{wrapper} on {id}: step {number}: {mine} is not {other}"
    assert len(ours) == len(theirs)


@pytest.mark.nightly(sample=True)
@pytest.mark.parametrize("wrapper", WRAPPERS)
def test_a_wrapper_of_minigrids_gives_what_it_gives_there(wrapper):
    for id in count(SOME, IDS):
        check_equal(id, wrapper, count(12, 60))


def test_minigrids_way_past_a_death_is_refused_with_the_way_out():
    env = wrappers.NoDeath(gymnasium.make("minihuman/MiniGrid-LavaGapS5-v0"), no_death_types=("lava",))
    env.reset(seed=0)
    chance, died = np.random.default_rng(1), False
    while not died:
        _, reward, terminated, truncated, _ = env.step(int(chance.integers(3)))
        died = reward == -1
        assert not (died and terminated)  # the step is as there; only what follows is refused
        if terminated or truncated:
            env.reset()
    with pytest.raises(WorldError, match=r"use minihuman\.worlds\.grid\.wrappers\.NoDeath"):
        env.step(0)
