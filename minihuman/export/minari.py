"""Minari 0.5 datasets in HDF5, one a world, never JPEG: ``OUT/minihuman/<world>/data``.

With ``MINARI_DATASETS_PATH=OUT``, ``minari.load_dataset("minihuman/minigrid-fourrooms-v0")`` reads one.
"""

import json
from pathlib import Path
from typing import Any

import minari
from minari.data_collector import EpisodeBuffer
from minari.dataset.minari_storage import MinariStorage

from minihuman import __version__
from minihuman.data.chosen import Chosen, ChosenEpisodes
from minihuman.export.datasets_by_world import dataset_name, env_spec
from minihuman.export.observations import plain_space, stack
from minihuman.export.port import Written
from minihuman.export.resimulate import Demonstration, Resimulator

NAMESPACE = "minihuman"


def export(chosen: ChosenEpisodes, out: Path) -> Written:
    """Write every episode; a session's subject, group, keys and outcome are metadata of its episodes.

    Raises:
        ExportError: if an episode does not replay, or its world's observations have no plain space.
    """
    resimulate = Resimulator()
    datasets: dict[str, MinariStorage] = {}
    episodes = steps = 0
    for item in chosen:
        demonstration = resimulate(item)
        name = dataset_name(item)
        if name not in datasets:
            datasets[name] = _begin(out, name, item, demonstration)
        storage = datasets[name]
        storage.update_episodes([_buffer(demonstration)])
        storage.update_episode_metadata([_attributes(item)], [int(storage.total_episodes) - 1])
        episodes += 1
        steps += len(item.episode.actions)
    return Written(tuple(out / NAMESPACE / name for name in datasets), episodes, steps)


def _begin(out: Path, name: str, item: Chosen, demonstration: Demonstration) -> MinariStorage:
    root = out / NAMESPACE
    if not root.exists():
        root.mkdir(parents=True)
        (root / "namespace_metadata.json").write_text(json.dumps({"description": "exported by minihuman"}))
    data = root / _versioned(name) / "data"
    data.mkdir(parents=True)
    storage = MinariStorage.new(
        data,
        observation_space=plain_space(demonstration.observation_space),
        action_space=demonstration.action_space,
        env_spec=env_spec(item),
        data_format="hdf5",
        jpeg_encoding=False,
    )
    storage.update_metadata(
        {
            "dataset_id": f"{NAMESPACE}/{_versioned(name)}",
            "minari_version": minari.__version__,
            "algorithm_name": "minihuman sessions",
            "description": f"Sessions recorded with minihuman {__version__}, observations replayed and checked.",
        }
    )
    return storage


def _versioned(name: str) -> str:
    """Minari ids end in a version."""
    return name if name.rpartition("-v")[2].isdigit() else f"{name}-v0"


def _buffer(demonstration: Demonstration) -> EpisodeBuffer:
    episode = demonstration.episode
    return EpisodeBuffer(
        seed=episode.plan.seed,
        observations=stack(demonstration.observations),
        actions=episode.actions,
        rewards=episode.rewards,
        terminations=episode.terminated,
        truncations=episode.truncated,
        infos={
            "t_ns": episode.t_ns,
            "pose": episode.poses,
        },
    )


def _attributes(item: Chosen) -> dict[str, Any]:
    """The facts as HDF5 attributes: plain values, mappings and lists as JSON text."""
    return {
        name: value if isinstance(value, (str, int)) else json.dumps(value)
        for name, value in item.facts.items()
        if name != "seed"  # Minari has its own place for it
    }
