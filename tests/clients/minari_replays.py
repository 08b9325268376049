"""Every episode of a Minari export played again in the environment that Minari itself recovers."""

import os
import sys
from importlib.metadata import version
from pathlib import Path

import minari
import numpy as np


def same(one, other):
    if isinstance(one, dict):
        return set(one) == set(other) and all(same(one[key], other[key]) for key in one)
    return one == other if isinstance(one, str) else np.array_equal(one, other)


def at(column, row):
    return {key: at(value, row) for key, value in column.items()} if isinstance(column, dict) else column[row]


def replays(episode, seed, env):
    """Whether observations, rewards and flags come out as stored, but for where an unfinished episode was cut."""
    seen, _ = env.reset(seed=seed)
    if not same(at(episode.observations, 0), seen):
        return False
    for step, action in enumerate(episode.actions):
        seen, reward, terminated, truncated, _ = env.step(action)
        last = step + 1 == len(episode.actions)
        if not same(at(episode.observations, step + 1), seen) or reward != episode.rewards[step]:
            return False
        if terminated != episode.terminations[step] or (truncated != episode.truncations[step] and not last):
            return False
    return True


def main(folder: Path) -> int:
    """Say how many do, and give 1 if any does not."""
    played = right = 0
    for study in sorted((folder / "minari").iterdir()):
        os.environ["MINARI_DATASETS_PATH"] = str(study)
        for name in minari.list_local_datasets():
            dataset = minari.load_dataset(name)
            env = dataset.recover_environment()
            seeds = [
                int(facts["seed"]) for facts in dataset.storage.get_episode_metadata(range(dataset.total_episodes))
            ]
            found = [replays(episode, seed, env) for episode, seed in zip(dataset, seeds, strict=True)]
            print(f"{name}: {sum(found)} of {len(found)} episodes")
            played, right = played + len(found), right + sum(found)
    print(f"minari {version('minari')}: {right} of {played} episodes replay")
    return int(right != played or not played)


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
