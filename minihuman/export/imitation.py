"""Trajectories as the ``imitation`` library keeps them: Hugging Face ``datasets`` on disk, flat observations.

One dataset a world, ``OUT/<world>``; ``imitation.data.serialize.load`` and ``datasets.load_from_disk`` read it.
"""

import json
from collections import defaultdict
from pathlib import Path
from typing import Any

import datasets
import numpy as np

from minihuman.data.chosen import Chosen, ChosenEpisodes
from minihuman.export.datasets_by_world import dataset_name
from minihuman.export.observations import flat
from minihuman.export.port import Written
from minihuman.export.resimulate import Demonstration, Resimulator


def export(chosen: ChosenEpisodes, out: Path) -> Written:
    """Write every episode as a trajectory with rewards; what else is known of a step is in its ``infos``.

    Raises:
        ExportError: if an episode does not replay.
    """
    resimulate = Resimulator()
    rows: dict[str, list[dict[str, Any]]] = defaultdict(list)
    steps = 0
    for item in chosen:
        rows[dataset_name(item)].append(_trajectory(item, resimulate(item)))
        steps += len(item.episode.actions)
    for name, trajectories in rows.items():
        _save(trajectories, out / name)
    return Written(tuple(out / name for name in rows), sum(map(len, rows.values())), steps)


def _trajectory(item: Chosen, demonstration: Demonstration) -> dict[str, Any]:
    episode = item.episode
    infos = [
        {**(item.facts if step == 1 else {}), "t_ns": int(episode.t_ns[step]), "key": episode.step_keys[step - 1]}
        for step in range(1, len(episode.actions) + 1)
    ]
    return {
        "obs": np.stack(
            [flat(observation, demonstration.observation_space) for observation in demonstration.observations]
        ),
        "acts": episode.actions,
        "infos": [json.dumps(info) for info in infos],
        "terminal": bool(episode.terminated[-1]) if len(episode.actions) else False,
        "rews": episode.rewards,
    }


def _save(trajectories: list[dict[str, Any]], path: Path) -> None:
    datasets.disable_progress_bars()  # our own command says how far it is
    number = datasets.Value(str(trajectories[0]["obs"].dtype))
    features = datasets.Features(
        {
            "obs": datasets.List(datasets.List(number)),
            "acts": datasets.List(datasets.Value("int64")),
            "infos": datasets.List(datasets.Value("string")),
            "terminal": datasets.Value("bool"),
            "rews": datasets.List(datasets.Value("float64")),
        }
    )
    columns = {name: [trajectory[name] for trajectory in trajectories] for name in features}
    datasets.Dataset.from_dict(columns, features=features).save_to_disk(str(path))
