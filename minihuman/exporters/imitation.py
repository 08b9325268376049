"""Export trajectories for the `imitation` library as Hugging Face `datasets` on disk.

Observations are flat; pictures have the order (channels, rows, columns) that Stable-Baselines3's `CnnPolicy` takes.
There is one dataset per world, `OUT/<world>`, which `imitation.data.serialize.load` and `datasets.load_from_disk` read.
Trajectories are written a few at a time, so that a large study needs no more memory than a small one. Compared
fragments are another dataset, `OUT/<world>-preferences`, with one row per pair, for `PreferenceDataset.push`.
"""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import datasets
import numpy as np
from datasets.arrow_writer import ArrowWriter
from numpy.typing import NDArray

from minihuman.activities.episode_clips import EpisodeClip
from minihuman.activities.preferences.events import PairAnswer
from minihuman.dataset.included_episodes import IncludedEpisode, IncludedEpisodes
from minihuman.errors import ExportError
from minihuman.exporters.exporter import ExportResult
from minihuman.exporters.flat_observations import (
    ReplayedEpisode,
    ReplayedStudy,
    flatten_observation,
    get_step_steering,
    is_picture,
)
from minihuman.log.model.session_log import SessionLog
from minihuman.storage.durable_files import hash_file

# How much the left fragment is preferred; "cannot tell" says nothing.
PREFERENCES: dict[PairAnswer, float] = {"left": 1.0, "equal": 0.5, "right": 0.0}
SIDES = ("left", "right")

_FragmentKey = tuple[int, int, int, int]  # episode, attempt, first step and last


class FragmentWriter:
    """Collects the fragments that participants compared, and yields them as pairs, one session after the other."""

    def __init__(self) -> None:
        self._log: SessionLog | None = None
        self._compared: set[_FragmentKey] = set()
        self._fragments: dict[_FragmentKey, dict[str, Any]] = {}
        self._worlds: dict[_FragmentKey, str] = {}

    def take(
        self, included: IncludedEpisode, dataset: str, trajectory: dict[str, Any]
    ) -> Iterator[tuple[str, dict[str, Any]]]:
        """Collect the compared fragments of an episode's trajectory.

        When a session begins, yield the previous session's pairs as ``close`` does.

        Args:
            included: the episode.
            dataset: the name of the episode's dataset.
            trajectory: the episode as a row of that dataset.
        """
        if self._log is None or self._log.path != included.log.path:
            yield from self.close()
            self._log = included.log
            comparisons = included.log.comparisons
            self._compared = {
                _make_key(side) for comparison in comparisons for side in (comparison.left, comparison.right)
            }
        plan = included.episode.plan
        for key in self._compared:
            if key[:2] == (plan.episode, included.episode.attempt):
                self._fragments[key] = _cut_fragment(trajectory, *key[2:])
                self._worlds[key] = dataset

    def close(self) -> Iterator[tuple[str, dict[str, Any]]]:
        """Yield the pairs of the last session, each as the name of the trajectories' dataset and a row."""
        if self._log is None:
            return
        for comparison in self._log.comparisons:
            keys = [_make_key(side) for side in (comparison.left, comparison.right)]
            if comparison.preference.answer in PREFERENCES and all(key in self._fragments for key in keys):
                row: dict[str, Any] = {
                    "preference": PREFERENCES[comparison.preference.answer],
                    "t_ns": comparison.preference.t_ns,
                }
                for side, key in zip(SIDES, keys, strict=True):
                    row |= {f"{side}_{name}": part for name, part in self._fragments[key].items()}
                yield self._worlds[keys[0]], row
        self._fragments = {}
        self._worlds = {}


def preference_features(trajectory: datasets.Features) -> datasets.Features:
    """Return the features of a pair: its preference, its time, and the features of a trajectory for both fragments."""
    columns = {f"{side}_{name}": kind for side in SIDES for name, kind in trajectory.items()}
    return datasets.Features({"preference": datasets.Value("float64"), "t_ns": datasets.Value("int64")} | columns)


def _make_key(side: EpisodeClip) -> _FragmentKey:
    return side.episode, side.attempt, side.first, side.last


def _cut_fragment(trajectory: dict[str, Any], first: int, last: int) -> dict[str, Any]:
    """Cut a fragment out of a trajectory: observations ``first`` to ``last``, and the actions between them.

    Both are numbers of observations; 0 is that of the reset.
    """
    steps = slice(first, last)
    states = slice(first, last + 1)
    reaches_end = last == len(trajectory["acts"])
    return {
        "obs": trajectory["obs"][states],
        "acts": trajectory["acts"][steps],
        "infos": trajectory["infos"][steps],
        "terminal": trajectory["terminal"] and reaches_end,
        "rews": trajectory["rews"][steps],
    }


_BATCH_TRAJECTORIES = 8  # written at once: with pictures, some tens of megabytes


def export(chosen: IncludedEpisodes, out: Path) -> ExportResult:
    """Write every episode that has a step as a trajectory with rewards; further facts are in its ``infos``.

    Raises:
        ExportError: if an episode does not replay.
    """
    datasets.disable_progress_bars()  # the command reports its own progress
    replayed = ReplayedStudy(chosen, "has no step, and a trajectory needs one")
    files = _ArrowFiles(out)
    fragments = FragmentWriter()
    for name, included, demonstration in replayed:
        trajectory = _build_trajectory(included, demonstration)
        files.write(name, _build_features(trajectory["obs"], trajectory["acts"]), trajectory)
        for world, pair in fragments.take(included, name, trajectory):
            files.write_pair(world, pair)
    for world, pair in fragments.close():
        files.write_pair(world, pair)
    return replayed.result(files.close())


class _ArrowFiles:
    """One Arrow file per dataset, opened when the dataset's first row is written."""

    def __init__(self, out: Path) -> None:
        self._out = out
        self._open: dict[str, tuple[ArrowWriter, datasets.Features]] = {}

    def write(self, name: str, features: datasets.Features, row: dict[str, Any]) -> None:
        if name not in self._open:
            path = str(self._out / f"{name}.arrow")
            writer = ArrowWriter(features=features, path=path, writer_batch_size=_BATCH_TRAJECTORIES)
            self._open[name] = writer, features
        self._open[name][0].write(row)

    def write_pair(self, name: str, row: dict[str, Any]) -> None:
        self.write(f"{name}-preferences", preference_features(self._open[name][1]), row)

    def close(self) -> tuple[Path, ...]:
        """Close all files, turn each into a dataset's folder, and return the folders."""
        for name, (writer, features) in self._open.items():
            writer.finalize()
            _make_dataset_folder(self._out / f"{name}.arrow", self._out / name, features)
        return tuple(self._out / name for name in self._open)


def _build_trajectory(included: IncludedEpisode, demonstration: ReplayedEpisode) -> dict[str, Any]:
    """Build an episode's trajectory as a row of its dataset, by the names of columns of the imitation library.

    Raises:
        ExportError: if the actions are not arrays.
    """
    episode = included.episode
    if not isinstance(demonstration.actions, np.ndarray):
        raise ExportError(
            f"{included.log.path}: {episode.name}: an action of {demonstration.action_space} is no array, which "
            "imitation needs; export as minari, lerobot, robomimic or rlds"
        )
    infos = []
    for index, key in enumerate(episode.step_keys):
        facts = included.facts if index == 0 else {}  # the first step alone has the episode's facts
        info = {**facts, "t_ns": int(episode.t_ns[index + 1]), "key": key}
        infos.append(json.dumps(info | get_step_steering(episode, index)))
    return {
        "obs": _stack_observations(demonstration),
        "acts": demonstration.actions,
        "infos": infos,
        "terminal": bool(episode.terminated[-1]),
        "rews": episode.rewards,
    }


def _stack_observations(demonstration: ReplayedEpisode) -> NDArray[Any]:
    """Return the n + 1 observations of n steps: an array (n + 1, numbers), or pictures (n + 1, 3, rows, columns)."""
    space = demonstration.observation_space
    if is_picture(space):
        return np.stack(demonstration.observations).transpose(0, 3, 1, 2)
    return np.stack([flatten_observation(observation, space) for observation in demonstration.observations])


def _build_features(observations: NDArray[Any], actions: NDArray[Any]) -> datasets.Features:
    """Build the types of a data set's columns from examples of its arrays."""
    _, *shape = observations.shape
    dtype = str(observations.dtype)
    observation: Any = datasets.List(datasets.Value(dtype))
    if len(shape) == 3:  # pictures
        observation = datasets.Array3D(tuple(shape), dtype)
    action_type = "int64" if actions.ndim == 1 else str(actions.dtype)
    return datasets.Features(
        {
            "obs": datasets.List(observation),
            "acts": _build_list_feature(action_type, actions.ndim),
            "infos": datasets.List(datasets.Value("string")),
            "terminal": datasets.Value("bool"),
            "rews": datasets.List(datasets.Value("float64")),
        }
    )


def _build_list_feature(dtype: str, depth: int) -> Any:
    """Return the feature of an array with ``depth`` dimensions, as nested lists."""
    feature: Any = datasets.Value(dtype)
    for _ in range(depth):
        feature = datasets.List(feature)
    return feature


def _make_dataset_folder(arrow_file: Path, path: Path, features: datasets.Features) -> None:
    """Turn an Arrow file into a dataset folder with the layout of ``save_to_disk``, without reading it into memory."""
    path.mkdir()
    data = path / "data-00000-of-00001.arrow"
    arrow_file.rename(data)
    datasets.DatasetInfo(features=features).write_to_directory(str(path))
    state: dict[str, Any] = {
        "_data_files": [{"filename": data.name}],
        "_fingerprint": hash_file(data)[:16],
        "_format_columns": None,
        "_format_kwargs": {},
        "_format_type": None,
        "_output_all_columns": False,
        "_split": None,
    }
    (path / "state.json").write_text(json.dumps(state, indent=2, sort_keys=True), encoding="utf-8", newline="\n")
