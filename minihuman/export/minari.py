"""Minari 0.5 datasets in HDF5, one a study and world, never JPEG: ``OUT/minihuman/<study>/<world>/data``.

With ``MINARI_DATASETS_PATH=OUT``, ``minari.load_dataset("minihuman/demo/minigrid-fourrooms-v0")`` reads one. An episode
that nobody finished ends truncated, so that no reader runs it into the next one.
"""

import json
from collections import defaultdict
from importlib.metadata import packages_distributions, version
from pathlib import Path
from typing import Any

import minari
from minari.data_collector import EpisodeBuffer
from minari.dataset.minari_storage import MinariStorage

from minihuman import __version__
from minihuman.data.chosen import Chosen, ChosenEpisodes
from minihuman.export.asked import about_of, actions_of, called
from minihuman.export.datasets_by_world import dataset_name, env_spec
from minihuman.export.observations import plain_space, stack
from minihuman.export.port import Written
from minihuman.export.resimulate import Demonstration, Resimulator
from minihuman.export.taught import taught_columns
from minihuman.study.about import About

NAMESPACE = "minihuman"


def export(chosen: ChosenEpisodes, out: Path) -> Written:
    """Write every episode that has a step; a session's subject, group, keys and outcome are its metadata.

    Raises:
        ExportError: if an episode does not replay, or its world's observations have no plain space.
    """
    resimulate = Resimulator()
    datasets: dict[str, MinariStorage] = {}
    players: defaultdict[str, set[str]] = defaultdict(set)  # of each dataset
    episodes = steps = 0
    left_out: list[str] = []
    for item in chosen:
        if not len(item.episode.actions):
            left_out.append(f"{called(item)} has no step, and Minari keeps none without")
            continue
        demonstration = resimulate(item)
        name = f"{item.log.plan.study}/{_versioned(dataset_name(item))}"
        if name not in datasets:
            datasets[name] = _begin(out, name, item, demonstration)
        storage = datasets[name]
        players[name].add(item.log.player)
        storage.update_episodes([_buffer(demonstration)])
        storage.update_episode_metadata([_attributes(item)], [int(storage.total_episodes) - 1])
        episodes += 1
        steps += len(item.episode.actions)
    for name, storage in datasets.items():
        storage.update_metadata({"algorithm_name": f"minihuman sessions played by: {', '.join(sorted(players[name]))}"})
    return Written(tuple(out / NAMESPACE / name for name in datasets), episodes, steps, tuple(left_out))


def _begin(out: Path, name: str, item: Chosen, demonstration: Demonstration) -> MinariStorage:
    about, study = about_of(item), item.log.plan.study
    _namespace(out / NAMESPACE, "exported by minihuman")
    _namespace(out / NAMESPACE / study, about.title or f"the study {study}")
    data = out / NAMESPACE / name / "data"
    data.mkdir(parents=True)
    spec = env_spec(item)
    storage = MinariStorage.new(
        data,
        observation_space=plain_space(demonstration.observation_space),
        action_space=demonstration.action_space,
        env_spec=spec,
        data_format="hdf5",
        jpeg_encoding=False,
    )
    storage.update_metadata(
        {
            "dataset_id": f"{NAMESPACE}/{name}",
            "minari_version": minari.__version__,
            "description": _description(item, about, recoverable=spec is not None),
            "requirements": _requirements(item),
            "action_names": list(item.episode.start.action_names),  # of the whole action space, from its start
            "actions_offered": list(actions_of(item)),  # those that participants had a key for
        }
        | ({"author": [author.name for author in about.authors]} if about.authors else {})
        | ({"author_email": emails} if (emails := [author.email for author in about.authors if author.email]) else {})
        | ({"license": about.licence} if about.licence else {})
        | ({"code_permalink": about.references[0]} if about.references else {})
    )
    return storage


def _namespace(folder: Path, description: str) -> None:
    if not folder.exists():
        folder.mkdir(parents=True)
        (folder / "namespace_metadata.json").write_text(json.dumps({"description": description}))


def _description(item: Chosen, about: About, *, recoverable: bool) -> str:
    lines = [about.description or about.title or f"The study {item.log.plan.study}."]
    lines.append(f"Sessions recorded with minihuman {__version__}, every observation checked against its hash.")
    if not recoverable:
        lines.append(f"Its environment, {item.episode.plan.world}, cannot be made by name elsewhere.")
    return " ".join(lines)


def _requirements(item: Chosen) -> list[str]:
    """What to install before the environment can be made, as pip takes it."""
    module, colon, _ = item.episode.plan.world.partition(":")
    theirs = packages_distributions().get(module.partition(".")[0], []) if colon else []
    return [f"minihuman>={__version__}", *(f"{package}=={version(package)}" for package in dict.fromkeys(theirs))]


def _versioned(name: str) -> str:
    """Minari ids end in a version."""
    return name if name.rpartition("-v")[2].isdigit() else f"{name}-v0"


def _buffer(demonstration: Demonstration) -> EpisodeBuffer:
    episode = demonstration.episode
    truncated = episode.truncated.copy()
    truncated[-1] |= not episode.terminated[-1]
    return EpisodeBuffer(
        seed=episode.plan.seed,
        observations=stack(demonstration.observations),
        actions=demonstration.actions,
        rewards=episode.rewards,
        terminations=episode.terminated,
        truncations=truncated,
        infos={
            "t_ns": episode.t_ns,
            "pose": episode.poses,
            **taught_columns(episode, with_reset=True),
        },
    )


def _attributes(item: Chosen) -> dict[str, Any]:
    """The facts as HDF5 attributes: plain values, mappings and lists as JSON text."""
    return {
        name: value if isinstance(value, (str, int)) else json.dumps(value)
        for name, value in item.facts.items()
        if name != "seed"  # Minari has its own place for it
    }
