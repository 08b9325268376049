"""Export Minari 0.5 datasets in HDF5, one per study and world, without JPEG: `OUT/minihuman/<study>/<world>/data`.

With `MINARI_DATASETS_PATH=OUT`, `minari.load_dataset("minihuman/demo/minigrid-fourrooms-v0")` reads one. An
unfinished episode ends truncated, so that no reader joins it to the next one.
"""

import errno
import json
import os
import pickle
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import packages_distributions, version
from pathlib import Path
from typing import Any

import gymnasium
import minari
from minari.data_collector import EpisodeBuffer
from minari.dataset.minari_storage import MinariStorage

from minihuman import __version__
from minihuman.dataset.included_episodes import IncludedEpisode, IncludedEpisodes
from minihuman.dataset.study_facts import read_study_facts
from minihuman.errors import ExportError
from minihuman.experiment.protocol.specs import AboutSpec
from minihuman.exporters.environment_specs import build_environment_spec
from minihuman.exporters.exporter import ExportResult
from minihuman.exporters.flat_observations import (
    ReplayedEpisode,
    ReplayedStudy,
    build_steering_columns,
    stack_observations,
    to_standard_space,
)
from minihuman.exporters.study_metadata import get_action_names, get_plain_facts
from minihuman.exporters.world_info import add_reset, build_info_columns
from minihuman.plugins import DISTRIBUTION

NAMESPACE = "minihuman"
_WAITING_EPISODES = 20  # that are written together
_WAITING_BYTES = 16 * 2**20  # of waiting episodes, beyond which they are written
_RESERVE_BYTES = 2**20  # an episode's groups and attributes, and the files of JSON


@contextmanager
def _restore_system_errors() -> Iterator[None]:
    """Raise, for an error in the context whose text has an error number of the system, the system's error.

    HDF5 reports such errors as the text of a RuntimeError when it closes a file.

    Raises:
        OSError: with the error number from the text.
    """
    try:
        yield
    except (OSError, RuntimeError) as error:
        match = re.search(r"errno = (\d+)", str(error))
        if match is None:
            raise
        raise OSError(int(match[1]), os.strerror(int(match[1]))) from error


def export(chosen: IncludedEpisodes, out: Path) -> ExportResult:
    """Write every episode that has a step; the session's participant, group, keys and outcome become its metadata.

    Raises:
        ExportError: if an episode does not replay, or its world's observation space has no standard form.
        OSError: if the files cannot be written.
    """
    with _restore_system_errors():
        return _write_datasets(chosen, out)


def _write_datasets(chosen: IncludedEpisodes, out: Path) -> ExportResult:
    """Write one dataset per study and world, as for `export`."""
    replayed = ReplayedStudy(chosen, "has no step, and Minari keeps none without")
    datasets: dict[str, _Dataset] = {}
    for world, included, demonstration in replayed:
        name = f"{included.log.plan.study}/{_add_version(world)}"
        if name not in datasets:
            _require_room(out, _RESERVE_BYTES)
            datasets[name] = _Dataset(out, _begin_dataset(out, name, included, demonstration))
        datasets[name].add(included, demonstration)
    for dataset in datasets.values():
        dataset.finish()
    return replayed.result(out / NAMESPACE / name for name in datasets)


class _Dataset:
    """A dataset that is being written, several episodes at once, since Minari reads and writes its JSON for each call.

    Args:
        out: the export's folder.
        storage: the dataset's files.
    """

    def __init__(self, out: Path, storage: MinariStorage) -> None:
        self._out = out
        self._storage = storage
        self._players: set[str] = set()
        self._buffers: list[EpisodeBuffer] = []
        self._facts: list[dict[str, Any]] = []
        self._n_bytes = 0  # of the waiting episodes

    def add(self, included: IncludedEpisode, demonstration: ReplayedEpisode) -> None:
        """Add an episode, and write the waiting episodes if there are enough of them."""
        self._players.add(included.log.player)
        buffer = _build_buffer(demonstration)
        facts = get_plain_facts(included)
        del facts["seed"]  # Minari has its own place for it
        self._buffers.append(buffer)
        self._facts.append(facts)
        self._n_bytes += len(pickle.dumps(buffer))  # about what its arrays take
        if self._n_bytes > _WAITING_BYTES or len(self._buffers) >= _WAITING_EPISODES:
            self._write_waiting()

    def _write_waiting(self) -> None:
        """Write the waiting episodes."""
        if not self._buffers:
            return
        _require_room(self._out, 2 * self._n_bytes + len(self._buffers) * _RESERVE_BYTES)
        first = int(self._storage.total_episodes)
        self._storage.update_episodes(self._buffers)
        self._storage.update_episode_metadata(self._facts, range(first, first + len(self._facts)))
        self._buffers = []
        self._facts = []
        self._n_bytes = 0

    def finish(self) -> None:
        """Write the waiting episodes, and the names of the players as the dataset's algorithm."""
        self._write_waiting()
        players = ", ".join(sorted(self._players))
        self._storage.update_metadata({"algorithm_name": f"minihuman sessions played by: {players}"})


def _add_version(world: str) -> str:
    """Return a world's id, with "-v0" if it has no version, since Minari's ids must end with one."""
    has_version = world.rpartition("-v")[2].isdigit()
    return world if has_version else f"{world}-v0"


def _require_room(out: Path, needed_bytes: int) -> None:
    """Raise OSError if there is too little space for what HDF5 is about to write.

    A failed write can end the process when HDF5 closes the file.
    """
    if shutil.disk_usage(out).free < needed_bytes:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(out))


def _begin_dataset(out: Path, name: str, included: IncludedEpisode, demonstration: ReplayedEpisode) -> MinariStorage:
    """Create a dataset's files, as its first episode describes it, and its namespaces; ``name`` is "STUDY/WORLD".

    Raises:
        ExportError: if the observation has a key that HDF5 cannot name.
    """
    study_facts = read_study_facts(included.log.path, included.log.plan.protocol_toml)
    study = included.log.plan.study
    _make_namespace(out / NAMESPACE, "exported by minihuman")
    _make_namespace(out / NAMESPACE / study, study_facts.title or f"the study {study}")
    data = out / NAMESPACE / name / "data"
    data.mkdir(parents=True)
    key = find_invalid_key(demonstration.observation_space)
    if key:
        raise ExportError(
            f"{included.log.path}: {included.episode.name}: the observation's part {key} cannot be named in HDF5, "
            "whose names are text without a slash; export as lerobot, robomimic, rlds or imitation"
        )
    spec = build_environment_spec(included)
    storage = MinariStorage.new(
        data,
        observation_space=to_standard_space(demonstration.observation_space),
        action_space=demonstration.action_space,
        env_spec=spec,
        data_format="hdf5",
        jpeg_encoding=False,
    )
    metadata: dict[str, Any] = {
        "dataset_id": f"{NAMESPACE}/{name}",
        "minari_version": minari.__version__,
        "description": _describe_dataset(included, study_facts, recoverable=spec is not None),
        "requirements": _list_requirements(included),
        "action_names": list(included.episode.start.action_names),  # of the whole action space, from its start
        "actions_offered": list(get_action_names(included)),  # those that participants had a key for
    }
    if spec is not None:
        metadata["eval_env_spec"] = spec.to_json()  # as it was played, its step limit included
    storage.update_metadata(metadata | _list_publication_facts(study_facts))
    return storage


def _list_publication_facts(study_facts: AboutSpec) -> dict[str, Any]:
    """Return a dataset's metadata about the publication, under Minari's names."""
    facts: dict[str, Any] = {}
    if study_facts.authors:
        facts["author"] = {author.name for author in study_facts.authors}  # Minari takes nothing but sets of texts
    emails = {author.email for author in study_facts.authors if author.email}
    if emails:
        facts["author_email"] = emails
    if study_facts.licence:
        facts["license"] = study_facts.licence
    if study_facts.doi:
        facts["doi"] = study_facts.doi
    if study_facts.references:
        facts["references"] = list(study_facts.references)
    return facts


def find_invalid_key(space: gymnasium.Space[Any]) -> str:
    """Return the first key of an observation that is not a valid HDF5 name: not text, empty, or with a slash.

    The key is returned as Python writes it; "" if all keys are valid.
    """
    parts: list[gymnasium.Space[Any]] = []
    if isinstance(space, gymnasium.spaces.Dict):
        for key in space.spaces:
            is_name = isinstance(key, str) and key and "/" not in key
            if not is_name:
                return repr(key)
        parts += space.spaces.values()
    elif isinstance(space, gymnasium.spaces.Tuple):
        parts += space.spaces
    for part in parts:
        invalid_key = find_invalid_key(part)
        if invalid_key:
            return invalid_key
    return ""


def _make_namespace(folder: Path, description: str) -> None:
    """Create a namespace's folder with its description, unless it exists."""
    if not folder.exists():
        folder.mkdir(parents=True)
        (folder / "namespace_metadata.json").write_text(
            json.dumps({"description": description}), encoding="utf-8", newline="\n"
        )


def _describe_dataset(included: IncludedEpisode, study_facts: AboutSpec, *, recoverable: bool) -> str:
    """Return the text that describes a dataset.

    Args:
        included: the first episode of the dataset.
        study_facts: the facts about the study.
        recoverable: whether another machine can create the environment by its name.
    """
    lines = [study_facts.description or study_facts.title or f"The study {included.log.plan.study}."]
    lines.append(f"Sessions recorded with minihuman {__version__}, every observation checked against its hash.")
    if not recoverable:
        lines.append(f"Its environment, {included.episode.plan.world}, cannot be made by name elsewhere.")
    return " ".join(lines)


def _list_requirements(included: IncludedEpisode) -> list[str]:
    """Return the pip requirements of the episode's environment: this package, and the one that has the world."""
    module, colon, _ = included.episode.plan.world.partition(":")
    if colon:
        distributions = packages_distributions().get(module.partition(".")[0], [])
    else:
        distributions = []
    return [
        f"{DISTRIBUTION}>={__version__}",
        *(f"{package}=={version(package)}" for package in dict.fromkeys(distributions)),
    ]


def _build_buffer(demonstration: ReplayedEpisode) -> EpisodeBuffer:
    """Build the episode buffer that Minari stores; an episode that did not terminate ends truncated."""
    episode = demonstration.episode
    truncated = episode.truncated.copy()
    truncated[-1] |= not episode.terminated[-1]
    return EpisodeBuffer(
        seed=episode.plan.seed,
        observations=stack_observations(demonstration.observations),
        actions=demonstration.actions,
        rewards=episode.rewards,
        terminations=episode.terminated,
        truncations=truncated,
        infos={
            "t_ns": episode.t_ns,
            "pose": episode.poses,
            **build_steering_columns(episode, with_reset=True),
            **{key: add_reset(column) for key, column in build_info_columns(episode).items()},
        },
    )
