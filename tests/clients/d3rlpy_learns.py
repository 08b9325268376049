"""d3rlpy trains on Minari exports: of demonstrations, and of what people did who took over. Runs without minihuman."""

import os
import sys
from importlib.metadata import version
from pathlib import Path

import d3rlpy
import minari
import numpy as np


def main(folder: Path) -> None:
    """Raise where it does not."""
    for study in ("plain", "taught"):
        os.environ["MINARI_DATASETS_PATH"] = str(folder / "minari" / study)
        for name in minari.list_local_datasets():
            train(name, minari.load_dataset(name))


def train(name, dataset):
    """Clone from all steps, or from those of the person where an agent had a part in the episode."""
    rows = []
    for episode in dataset:
        seen = episode.observations["image"][:-1].reshape(len(episode.actions), -1).astype(np.float32)
        steered = episode.infos.get("intervention")
        kept = slice(None) if steered is None else np.asarray(steered)[1:]
        timeouts = episode.truncations.copy()
        if steered is not None:
            assert len(episode.infos["policy_action"]) == len(steered) == len(seen) + 1
            timeouts[np.flatnonzero(kept)[-1:]] |= not episode.terminations[-1] or not kept[-1]
        actions, rewards = episode.actions[:, None], episode.rewards[:, None]
        rows.append(tuple(part[kept] for part in (seen, actions, rewards, episode.terminations, timeouts)))
    seen, actions, rewards, terminals, timeouts = (np.concatenate(part) for part in zip(*rows, strict=True))
    demonstrations = d3rlpy.dataset.MDPDataset(seen, actions, rewards, terminals, timeouts=timeouts)
    algorithm = d3rlpy.algos.DiscreteBCConfig(batch_size=16).create(device="cpu:0")
    algorithm.fit(
        demonstrations,
        n_steps=20,
        n_steps_per_epoch=10,
        show_progress=False,
        logger_adapter=d3rlpy.logging.NoopAdapterFactory(),
    )
    print(f"d3rlpy {version('d3rlpy')}: {name}: trained on {len(seen)} steps of {dataset.total_episodes} episodes")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
