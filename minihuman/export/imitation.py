"""Trajectories as the ``imitation`` library keeps them: Hugging Face ``datasets`` on disk, flat observations.

One dataset a world, ``OUT/<world>``; ``imitation.data.serialize.load`` and ``datasets.load_from_disk`` read it. It is
written a few trajectories at a time, so that a large study takes no more memory than a small one. What was compared is
another dataset, ``OUT/<world>-preferences``: a row a pair, for ``PreferenceDataset.push``.
"""

import hashlib
import json
from pathlib import Path
from typing import Any

import datasets
import numpy as np
from datasets.arrow_writer import ArrowWriter

from minihuman.data.chosen import Chosen, ChosenEpisodes
from minihuman.export.asked import called
from minihuman.export.compared import Fragments, pair_features
from minihuman.export.datasets_by_world import dataset_name
from minihuman.export.observations import flat
from minihuman.export.port import Written
from minihuman.export.resimulate import Demonstration, Resimulator
from minihuman.export.taught import taught_at

_TOGETHER = 8  # trajectories written at once: of pictures, some tens of megabytes
_NO_STEP = "has no step, and a trajectory needs one"


def export(chosen: ChosenEpisodes, out: Path) -> Written:
    """Write every episode that has a step as a trajectory with rewards; what else is known is in its ``infos``.

    Raises:
        ExportError: if an episode does not replay.
    """
    datasets.disable_progress_bars()  # our own command says how far it is
    resimulate = Resimulator()
    writers = _Writers(out)
    fragments = Fragments()
    episodes = steps = 0
    left_out: list[str] = []
    for item in chosen:
        if not len(item.episode.actions):
            left_out.append(f"{called(item)} {_NO_STEP}")
            continue
        name = dataset_name(item)
        trajectory = _trajectory(item, resimulate(item))
        features = _features(str(trajectory["obs"].dtype))
        writers.write(name, features, trajectory)
        for world, pair in fragments.take(item, name, trajectory):
            writers.write_pair(world, pair)
        episodes, steps = episodes + 1, steps + len(item.episode.actions)
    for world, pair in fragments.close():
        writers.write_pair(world, pair)
    return Written(writers.close(), episodes, steps, tuple(left_out))


class _Writers:
    """A file a dataset, opened when its first row comes."""

    def __init__(self, out: Path) -> None:
        self._out = out
        self._open: dict[str, tuple[ArrowWriter, datasets.Features]] = {}

    def write(self, name: str, features: datasets.Features, row: dict[str, Any]) -> None:
        if name not in self._open:
            path = str(self._out / f"{name}.arrow")
            self._open[name] = ArrowWriter(features=features, path=path, writer_batch_size=_TOGETHER), features
        self._open[name][0].write(row)

    def write_pair(self, name: str, row: dict[str, Any]) -> None:
        self.write(f"{name}-preferences", pair_features(self._open[name][1]), row)

    def close(self) -> tuple[Path, ...]:
        for name, (writer, features) in self._open.items():
            writer.finalize()
            _settle(self._out / f"{name}.arrow", self._out / name, features)
        return tuple(self._out / name for name in self._open)


def _trajectory(item: Chosen, demonstration: Demonstration) -> dict[str, Any]:
    episode = item.episode
    infos = [
        {**(item.facts if step == 1 else {}), "t_ns": int(episode.t_ns[step]), "key": episode.step_keys[step - 1]}
        | taught_at(episode, step - 1)
        for step in range(1, len(episode.actions) + 1)
    ]
    return {
        "obs": np.stack(
            [flat(observation, demonstration.observation_space) for observation in demonstration.observations]
        ),
        "acts": demonstration.actions,
        "infos": [json.dumps(info) for info in infos],
        "terminal": bool(episode.terminated[-1]),
        "rews": episode.rewards,
    }


def _features(number: str) -> datasets.Features:
    return datasets.Features(
        {
            "obs": datasets.List(datasets.List(datasets.Value(number))),
            "acts": datasets.List(datasets.Value("int64")),
            "infos": datasets.List(datasets.Value("string")),
            "terminal": datasets.Value("bool"),
            "rews": datasets.List(datasets.Value("float64")),
        }
    )


def _settle(written: Path, path: Path, features: datasets.Features) -> None:
    """Make a dataset's folder around the file: as ``save_to_disk`` lays it out, but for copying it through memory."""
    path.mkdir()
    data = path / "data-00000-of-00001.arrow"
    written.rename(data)
    with data.open("rb") as file:
        fingerprint = hashlib.file_digest(file, "sha256").hexdigest()[:16]
    datasets.DatasetInfo(features=features).write_to_directory(str(path))
    state: dict[str, Any] = {
        "_data_files": [{"filename": data.name}],
        "_fingerprint": fingerprint,
        "_format_columns": None,
        "_format_kwargs": {},
        "_format_type": None,
        "_output_all_columns": False,
        "_split": None,
    }
    (path / "state.json").write_text(json.dumps(state, indent=2, sort_keys=True))
