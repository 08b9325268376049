"""d3rlpy trains on a Minari export. Runs without minihuman."""

import os
import sys
from importlib.metadata import version
from pathlib import Path

import d3rlpy
import minari
import numpy as np


def main(folder: Path) -> None:
    """Raise where it does not."""
    os.environ["MINARI_DATASETS_PATH"] = str(folder / "minari/plain")
    dataset = minari.load_dataset("minihuman/plain/minigrid-fourrooms-v0")
    rows = []
    for episode in dataset:
        seen = episode.observations["image"][:-1].reshape(len(episode.actions), -1).astype(np.float32)
        rows.append(
            (seen, episode.actions[:, None], episode.rewards[:, None], episode.terminations, episode.truncations)
        )
    seen, actions, rewards, terminals, timeouts = (np.concatenate(part) for part in zip(*rows, strict=True))
    demonstrations = d3rlpy.dataset.MDPDataset(seen, actions, rewards, terminals, timeouts=timeouts)
    assert len(demonstrations.episodes) == dataset.total_episodes
    algorithm = d3rlpy.algos.DiscreteBCConfig(batch_size=16).create(device="cpu:0")
    algorithm.fit(
        demonstrations,
        n_steps=20,
        n_steps_per_epoch=10,
        show_progress=False,
        logger_adapter=d3rlpy.logging.NoopAdapterFactory(),
    )
    print(f"d3rlpy {version('d3rlpy')}: trained on {demonstrations.size()} episodes")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
