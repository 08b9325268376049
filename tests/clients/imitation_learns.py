"""imitation's own reader takes every export, and its behaviour cloning trains on one. Runs without minihuman."""

import sys
from importlib.metadata import version
from pathlib import Path

import gymnasium
import numpy as np
from imitation.algorithms import bc
from imitation.data import serialize


def main(folder: Path) -> None:
    """Raise where one does not."""
    roots = sorted(path.parent for path in (folder / "imitation").glob("*/*/dataset_info.json"))
    assert roots, "nothing was exported"
    for root in roots:
        trajectories = list(serialize.load(root))
        assert all(len(one.obs) == len(one.acts) + 1 for one in trajectories)
        print(f"{root.parent.name}/{root.name}: {len(trajectories)} trajectories of {trajectories[0].obs.shape[1:]}")
        if root.parent.name != "plain":
            continue
        actions = gymnasium.spaces.Discrete(1 + max(int(one.acts.max()) for one in trajectories))
        space = gymnasium.spaces.Box(0, 255, trajectories[0].obs.shape[1:], trajectories[0].obs.dtype)
        rng = np.random.default_rng(0)
        cloning = bc.BC(observation_space=space, action_space=actions, demonstrations=trajectories, rng=rng)
        cloning.train(n_epochs=2, progress_bar=False)
    print(f"imitation {version('imitation')}: {len(roots)} datasets, trained on one")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
