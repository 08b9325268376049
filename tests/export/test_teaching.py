"""The exported demonstrations teach what they should: a policy cloned from them beats chance."""

import numpy as np
import pytest
import scipy

from minihuman.dataset.selection import Selection
from minihuman.exporters.exporter import export_study
from minihuman.worlds.adapters.world import World
from tests.counts import count
from tests.export.study import recorded

WORLD = "minihuman/MiniGrid-FourRooms-v0"
EPISODES = 40
TOML = f"""
[study]
name = "teaching"
version = "1"
seed = 1
[keys]
keyboard_check = false
[[groups]]
name = "all"
blocks = ["grid"]
[[blocks]]
name = "grid"
world = "{WORLD}"
episodes = {EPISODES}
actions = ["left", "right", "forward"]
max_steps = 100
""".encode()


def features(flat: np.ndarray) -> np.ndarray:
    """One-hot: which kind of thing is in each cell of the view; (rows, 148) numbers to (rows, 49 * 11 + 1)."""
    kinds = flat[:, 1:].reshape(len(flat), 49, 3)[:, :, 0]
    one_hot = (kinds[:, :, None] == np.arange(11)).reshape(len(flat), -1)
    return np.hstack([one_hot, np.ones((len(flat), 1))]).astype(float)


def cloned(seen: np.ndarray, actions: np.ndarray) -> np.ndarray:
    """Weights of a softmax regression from view to action."""
    inputs, targets = features(seen), np.eye(3)[actions]

    def loss(weights):
        scores = inputs @ weights.reshape(-1, 3)
        scores -= scores.max(axis=1, keepdims=True)
        chances = np.exp(scores) / np.exp(scores).sum(axis=1, keepdims=True)
        value = -np.log(chances[targets == 1]).mean() + 1e-4 * (weights**2).sum()
        return value, (inputs.T @ (chances - targets) / len(inputs)).ravel() + 2e-4 * weights

    start = np.zeros(inputs.shape[1] * 3)
    return scipy.optimize.minimize(loss, start, jac=True, method="L-BFGS-B", options={"maxiter": 200}).x.reshape(-1, 3)


def successes(weights: np.ndarray, seeds: range) -> int:
    world, rng, reached = World(WORLD), np.random.default_rng(0), 0
    for seed in seeds:
        world.reset(seed)
        for _ in range(100):
            view = world.observation
            flat = np.concatenate([[view["direction"]], view["image"].ravel()])
            scores = (features(flat[None]) @ weights)[0]
            chances = np.exp(scores - scores.max())
            done = world.step(int(rng.choice(3, p=chances / chances.sum())))
            if done.terminated or done.truncated:
                reached += done.reward > 0
                break
    return reached


@pytest.mark.nightly
def test_a_policy_cloned_from_optimal_demonstrations_finds_the_goal_more_often_than_chance(tmp_path):
    import datasets

    study = recorded(tmp_path / "data", participants=count(3, 10), toml=TOML)
    (path,) = export_study("imitation", study, tmp_path / "out", Selection(outcome=("goal",)))[0].paths
    demonstrations = datasets.load_from_disk(str(path))
    seen = np.concatenate([np.array(row["obs"][:-1]) for row in demonstrations])
    actions = np.concatenate([np.array(row["acts"]) for row in demonstrations])
    seeds = range(10_000_000, 10_000_000 + count(60, 400))
    taught, chance = successes(cloned(seen, actions), seeds), successes(np.zeros((49 * 11 + 1, 3)), seeds)
    print(f"cloned {taught} of {len(seeds)}, random {chance} of {len(seeds)}")
    assert taught > chance + 3 * np.sqrt(len(seeds) / 4)
