"""Wrappers against Minigrid's of the same purpose, and their spaces."""

from operator import itemgetter

import gymnasium
import minigrid.wrappers as theirs
import numpy as np
import pytest
from gymnasium.wrappers import TransformObservation

import minihuman  # noqa: F401
from minihuman.errors import WorldError
from minihuman.worlds.catalogue import GRID_WORLDS
from minihuman.worlds.grid import wrappers
from tests.machine import needs

NAME = "MiniGrid-DoorKey-6x6-v0"


def make(name=NAME, **options):
    return gymnasium.make(f"minihuman/{name}", **options)


def episode(env, actions, seed=4):
    yield env.reset(seed=seed)[0], 0.0
    for action in actions:
        observation, reward, terminated, truncated, _ = env.step(action)
        yield observation, reward
        if terminated or truncated:
            return


ACTIONS = np.random.default_rng(0).integers(0, 7, 150).tolist()
SAME = {
    "one-hot": (wrappers.OneHot, theirs.OneHotPartialObsWrapper, {}),
    "fully observed": (wrappers.FullyObserved, theirs.FullyObsWrapper, {}),
    "symbolic": (wrappers.Symbolic, theirs.SymbolicObsWrapper, {}),
    "larger view": (lambda env: wrappers.ViewSize(env, 9), lambda env: theirs.ViewSizeWrapper(env, 9), {}),
    "flat": (wrappers.Flat, theirs.FlatObsWrapper, {}),
    "slope": (wrappers.GoalDirection, theirs.DirectionObsWrapper, {}),
    "angle": (
        lambda env: wrappers.GoalDirection(env, "angle"),
        lambda env: theirs.DirectionObsWrapper(env, "angle"),
        {},
    ),
    "full angle": (
        lambda env: wrappers.GoalDirection(env, "angle_atan2"),
        lambda env: theirs.DirectionObsWrapper(env, "angle_atan2"),
        {},
    ),
    "position bonus": (wrappers.PositionBonus, theirs.PositionBonus, {}),
    "action bonus": (wrappers.ActionBonus, theirs.ActionBonus, {}),
}


@pytest.mark.parametrize(("wrap", "wrap_theirs", "options"), SAME.values(), ids=SAME)
def test_a_wrapper_gives_what_minigrids_gives(wrap, wrap_theirs, options):
    env, other = wrap(make(**options)), wrap_theirs(gymnasium.make(NAME, **options))
    steps = 0
    for (mine, reward), (its, its_reward) in zip(episode(env, ACTIONS), episode(other, ACTIONS), strict=True):
        assert mine in env.observation_space
        assert reward == its_reward
        if isinstance(mine, dict):
            assert set(mine) == set(its)
            for part in mine:
                np.testing.assert_array_equal(mine[part], its[part])
        else:
            np.testing.assert_array_equal(mine, its)
        steps += 1
    assert steps > 100


def test_a_stochastic_action_is_drawn_as_minigrid_draws_it():
    env, other = wrappers.StochasticAction(make(), 0.6), theirs.StochasticActionWrapper(gymnasium.make(NAME), 0.6)
    for (mine, _), (its, _) in zip(episode(env, ACTIONS), episode(other, ACTIONS), strict=True):
        np.testing.assert_array_equal(mine["image"], its["image"])
    always = wrappers.StochasticAction(make(), 0.0, random_action=1)
    always.reset(seed=0)
    before = always.unwrapped.state.direction
    always.step(2)
    assert always.unwrapped.state.direction == (before + 1) % 4


@pytest.mark.parametrize(
    ("wrap", "shape"),
    [
        (lambda env: wrappers.PictureObservation(env), (56, 56, 3)),
        (lambda env: wrappers.PictureObservation(env, tile_px=3), (21, 21, 3)),
        (lambda env: wrappers.PictureObservation(env, view="full", palette="colour-safe"), (48, 96, 3)),
    ],
)
def test_pictures_are_observations(wrap, shape):
    env = wrap(make("MiniGrid-RedBlueDoors-6x6-v0"))
    observation, _ = env.reset(seed=0)
    assert observation["image"].shape == env.observation_space["image"].shape == shape
    assert observation in env.observation_space


@needs("learn")
@pytest.mark.filterwarnings("ignore:.*out of date")
def test_stable_baselines_takes_every_world_flat():
    from stable_baselines3.common.env_checker import check_env

    for entry in GRID_WORLDS:
        check_env(wrappers.Flat(make(entry.name)))
    picture = wrappers.PictureObservation(make())
    check_env(TransformObservation(picture, itemgetter("image"), picture.observation_space["image"]))


@pytest.mark.parametrize(
    ("wrap", "complaint"),
    [
        (lambda: wrappers.OneHot(gymnasium.make("CartPole-v1")), "not a minihuman grid world|has the observations Box"),
        (lambda: wrappers.OneHot(wrappers.Flat(make())), "apply this wrapper before"),
        (lambda: wrappers.ViewSize(make(), 4), "it must be an odd number"),
        (lambda: wrappers.GoalDirection(make(), "north"), "unknown direction measure 'north'"),
        (lambda: wrappers.StochasticAction(make(), 1.5), "use a probability from 0 to 1"),
        (lambda: wrappers.GoalDirection(make("MiniGrid-Fetch-5x5-N2-v0")).reset(seed=0), "no goal to point to"),
        (lambda: wrappers.Flat(make(), letters=10).reset(seed=0), "letters=53"),
    ],
)
def test_a_wrapper_around_the_wrong_world_says_so(wrap, complaint):
    with pytest.raises(WorldError, match=complaint):
        wrap()
