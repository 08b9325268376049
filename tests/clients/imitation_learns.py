"""imitation's own reader takes every export; its behaviour cloning trains on demonstrations and on what a person did
when they took over from an agent, its reward network on comparisons. Runs without minihuman.
"""

import sys
from importlib.metadata import version
from pathlib import Path

import datasets
import gymnasium
import numpy as np
from imitation.algorithms import bc, preference_comparisons
from imitation.data import serialize
from imitation.data.types import TrajectoryWithRew, Transitions
from imitation.rewards.reward_nets import BasicRewardNet


def main(folder: Path) -> None:
    """Raise where one does not."""
    roots = sorted(path.parent for path in (folder / "imitation").glob("*/*/dataset_info.json"))
    assert roots, "nothing was exported"
    for root in roots:
        if root.name.endswith("-preferences"):
            learn_reward(root)
            continue
        trajectories = list(serialize.load(root))
        assert all(len(one.obs) == len(one.acts) + 1 for one in trajectories)
        print(f"{root.parent.name}/{root.name}: {len(trajectories)} trajectories of {trajectories[0].obs.shape[1:]}")
        if root.parent.name == "plain":
            clone(trajectories, trajectories)
        if root.parent.name == "taught":
            clone(trajectories, taken_over(trajectories))
    assert any(root.name.endswith("-preferences") for root in roots), "no comparison was exported"
    print(f"imitation {version('imitation')}: {len(roots)} datasets, trained on three")


def clone(trajectories, demonstrations):
    """Train on them."""
    observations, actions = spaces(trajectories)
    rng = np.random.default_rng(0)
    cloning = bc.BC(
        observation_space=observations, action_space=actions, demonstrations=demonstrations, rng=rng, batch_size=4
    )
    cloning.train(n_epochs=2, progress_bar=False)


def taken_over(trajectories):
    """The steps at which a person steered, where there was a policy."""
    steps = [
        (one.obs[at], action, one.infos[at], one.obs[at + 1], one.terminal and at + 1 == len(one.acts))
        for one in trajectories
        for at, action in enumerate(one.acts)
        if one.infos[at].get("intervention") and one.infos[at]["policy_action"] >= 0
    ]
    print(f"{len(steps)} steps of a person who took over")
    obs, acts, infos, after, dones = (np.array(part) for part in zip(*steps, strict=True))
    return Transitions(obs=obs, acts=acts, infos=infos, next_obs=after, dones=dones)


def learn_reward(root):
    """Fill a ``PreferenceDataset`` and fit a reward network to it."""
    rows = datasets.load_from_disk(str(root)).with_format("numpy")
    pairs = [tuple(fragment(row, side) for side in ("left", "right")) for row in rows]
    compared = preference_comparisons.PreferenceDataset()
    compared.push(pairs, np.array([row["preference"] for row in rows], np.float32))
    observations, actions = spaces([one for pair in pairs for one in pair])
    network = BasicRewardNet(observations, actions)
    trainer = preference_comparisons.BasicRewardTrainer(
        preference_comparisons.PreferenceModel(network),
        preference_comparisons.CrossEntropyRewardLoss(),
        rng=np.random.default_rng(0),
        epochs=2,
    )
    trainer.train(compared)
    print(f"{root.parent.name}/{root.name}: {len(compared)} comparisons, a reward network trained on them")


def fragment(row, side):
    """One side of a pair."""
    obs, acts, terminal, rews = (row[f"{side}_{name}"] for name in ("obs", "acts", "terminal", "rews"))
    return TrajectoryWithRew(
        obs=np.array(obs), acts=np.array(acts), infos=None, terminal=bool(terminal), rews=np.array(rews)
    )


def spaces(trajectories):
    """Spaces of observations and actions that hold these."""
    actions = gymnasium.spaces.Discrete(1 + max(int(one.acts.max()) for one in trajectories))
    return gymnasium.spaces.Box(0, 255, trajectories[0].obs.shape[1:], trajectories[0].obs.dtype), actions


if __name__ == "__main__":
    main(Path(sys.argv[1]))
