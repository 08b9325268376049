"""LeRobot datasets, format v3.0, written with pyarrow: ``OUT/<world>/{meta,data}``. No torch, no video.

A frame is an observation and the action it was answered with, so the observation after the last action has no row.
LeRobot's timestamps are frame number over frame rate; when a step really happened is in ``time_s``.
"""

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray
from PIL import Image

from minihuman.data.chosen import Chosen, ChosenEpisodes
from minihuman.export.datasets_by_world import dataset_name
from minihuman.export.observations import flat, flat_names, is_picture
from minihuman.export.port import Written
from minihuman.export.resimulate import Demonstration, Resimulator

FORMAT_VERSION = "v3.0"
FPS = 10  # nominal: steps follow keys, not a clock
CHUNK = 1000  # files a folder, the format's default
_PICTURE, _STATE = "observation.image", "observation.state"


def export(chosen: ChosenEpisodes, out: Path) -> Written:
    """Write every episode that has a step, one data file an episode.

    Raises:
        ExportError: if an episode does not replay.
    """
    resimulate = Resimulator()
    datasets: dict[str, _Dataset] = {}
    for item in chosen:
        if not len(item.episode.actions):
            continue
        demonstration = resimulate(item)
        name = dataset_name(item)
        if name not in datasets:
            datasets[name] = _Dataset(out / name, demonstration)
        datasets[name].add(item, demonstration)
    for dataset in datasets.values():
        dataset.finish()
    return Written(
        tuple(out / name for name in datasets),
        sum(len(dataset.rows) for dataset in datasets.values()),
        sum(dataset.frames for dataset in datasets.values()),
    )


class _Dataset:
    """One world's dataset while it is written."""

    def __init__(self, root: Path, first: Demonstration) -> None:
        self.root = root
        self.frames = 0
        self.rows: list[dict[str, Any]] = []  # one an episode
        self._tasks: dict[str, int] = {}
        self._features = _features(first)
        self._totals: dict[str, _Total] = {}
        (root / "meta").mkdir(parents=True)

    def add(self, item: Chosen, demonstration: Demonstration) -> None:
        """Write an episode's frames and remember its row of metadata."""
        number, length = len(self.rows), len(item.episode.actions)
        chunk, file = divmod(number, CHUNK)
        task = item.episode.start.mission or f"reach the goal of {item.episode.plan.world}"
        task_index = self._tasks.setdefault(task, len(self._tasks))
        columns = _columns(item, demonstration, self._features)
        own: dict[str, NDArray[Any]] = {
            "timestamp": (np.arange(length) / FPS).astype(np.float32),
            "frame_index": np.arange(length, dtype=np.int64),
            "episode_index": np.full(length, number, np.int64),
            "index": np.arange(self.frames, self.frames + length, dtype=np.int64),
            "task_index": np.full(length, task_index, np.int64),
        }
        columns |= own
        path = self.root / "data" / f"chunk-{chunk:03d}" / f"file-{file:03d}.parquet"
        path.parent.mkdir(parents=True, exist_ok=True)
        pq.write_table(_table(columns, self._features), path, compression="snappy")
        statistics = {name: _statistics(values, name) for name, values in columns.items()}
        for name, values in columns.items():
            self._totals.setdefault(name, _Total()).add(_samples(values, name), len(values))
        self.rows.append(
            {
                "episode_index": number,
                "tasks": [task],
                "length": length,
                "data/chunk_index": chunk,
                "data/file_index": file,
                "dataset_from_index": self.frames,
                "dataset_to_index": self.frames + length,
                "meta/episodes/chunk_index": 0,
                "meta/episodes/file_index": 0,
                **{f"minihuman/{name}": _plain(value) for name, value in item.facts.items()},
                **{
                    f"stats/{name}/{statistic}": value
                    for name, values in statistics.items()
                    for statistic, value in values.items()
                },
            }
        )
        self.frames += length

    def finish(self) -> None:
        """Write what describes the whole dataset."""
        meta = self.root / "meta"
        episodes = meta / "episodes" / "chunk-000"
        episodes.mkdir(parents=True)
        pq.write_table(pa.Table.from_pylist(self.rows), episodes / "file-000.parquet", compression="snappy")
        # the task is the unnamed index of a pandas frame: readers look for the column that makes
        pd.DataFrame({"task_index": list(self._tasks.values())}, index=list(self._tasks)).to_parquet(
            meta / "tasks.parquet"
        )
        totals = {name: total.statistics(name) for name, total in self._totals.items()}
        (meta / "stats.json").write_text(json.dumps(totals, indent=4))
        info = {
            "codebase_version": FORMAT_VERSION,
            "robot_type": "minihuman",
            "total_episodes": len(self.rows),
            "total_frames": self.frames,
            "total_tasks": len(self._tasks),
            "chunks_size": CHUNK,
            "data_files_size_in_mb": 100,
            "video_files_size_in_mb": 200,
            "fps": FPS,
            "splits": {"train": f"0:{len(self.rows)}"},
            "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
            "video_path": None,
            "features": self._features,
        }
        (meta / "info.json").write_text(json.dumps(info, indent=4))


def _features(first: Demonstration) -> dict[str, dict[str, Any]]:
    if is_picture(first.observation_space):
        shape = list(np.asarray(first.observations[0]).shape)
        seen = {_PICTURE: {"dtype": "image", "shape": shape, "names": ["height", "width", "channels"]}}
    else:
        names = flat_names(first.observations[0])
        seen = {_STATE: {"dtype": "float32", "shape": [len(names)], "names": names}}
    return {
        **seen,
        "action": {"dtype": "float32", "shape": [1], "names": ["action"]},
        "next.reward": {"dtype": "float64", "shape": [1], "names": None},
        "next.done": {"dtype": "bool", "shape": [1], "names": None},
        "next.success": {"dtype": "bool", "shape": [1], "names": None},
        "time_s": {"dtype": "float64", "shape": [1], "names": None},
        "timestamp": {"dtype": "float32", "shape": [1], "names": None},
        "frame_index": {"dtype": "int64", "shape": [1], "names": None},
        "episode_index": {"dtype": "int64", "shape": [1], "names": None},
        "index": {"dtype": "int64", "shape": [1], "names": None},
        "task_index": {"dtype": "int64", "shape": [1], "names": None},
    }


def _columns(item: Chosen, demonstration: Demonstration, features: dict[str, Any]) -> dict[str, NDArray[Any]]:
    """The features that come from the episode, ``n`` rows each."""
    episode = item.episode
    before = demonstration.observations[:-1]
    if _PICTURE in features:
        seen = {_PICTURE: np.stack(before)}
    else:
        space = demonstration.observation_space
        seen = {_STATE: np.stack([flat(observation, space).astype(np.float32) for observation in before])}
    done = np.zeros(len(episode.actions), bool)
    done[-1] = True
    return {
        **seen,
        "action": episode.actions.astype(np.float32).reshape(-1, 1),
        "next.reward": episode.rewards,
        "next.done": done,
        "next.success": done & (episode.outcome == "goal"),
        "time_s": (episode.t_ns[1:] - episode.t_ns[0]) / 1e9,
    }


def _table(columns: dict[str, NDArray[Any]], features: dict[str, Any]) -> pa.Table:
    arrays = {}
    for name, values in columns.items():
        if features[name]["dtype"] == "image":
            pictures = [{"bytes": _png(picture), "path": None} for picture in values]
            arrays[name] = pa.array(pictures, pa.struct([("bytes", pa.binary()), ("path", pa.string())]))
        elif values.ndim == 2:
            flat_values = pa.array(np.ascontiguousarray(values).reshape(-1))
            arrays[name] = pa.FixedSizeListArray.from_arrays(flat_values, values.shape[1])
        else:
            arrays[name] = pa.array(values)
    return pa.table(arrays)


def _png(picture: NDArray[np.uint8]) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(picture).save(buffer, "PNG")
    return buffer.getvalue()


def _samples(values: NDArray[Any], name: str) -> NDArray[np.float64]:
    """Rows to take statistics over, float64[rows, channels or numbers]; pictures scaled to 0..1."""
    if name == _PICTURE:
        return values.reshape(-1, values.shape[-1]) / 255.0
    return values.reshape(len(values), -1).astype(np.float64)


def _statistics(values: NDArray[Any], name: str) -> dict[str, Any]:
    total = _Total()
    total.add(_samples(values, name), len(values))
    return total.statistics(name)


class _Total:
    """Running minimum, maximum, mean and standard deviation."""

    def __init__(self) -> None:
        self._frames = 0
        self._samples = 0
        self._low: Any = np.inf
        self._high: Any = -np.inf
        self._sum: Any = 0.0
        self._squares: Any = 0.0

    def add(self, samples: NDArray[np.float64], frames: int) -> None:
        """Take rows of samples in, from so many frames."""
        self._frames += frames
        self._samples += len(samples)
        self._low = np.minimum(self._low, samples.min(axis=0))
        self._high = np.maximum(self._high, samples.max(axis=0))
        self._sum = self._sum + samples.sum(axis=0)
        self._squares = self._squares + (samples**2).sum(axis=0)

    def statistics(self, name: str) -> dict[str, Any]:
        """As the format keeps them: a list a number, [[[value]]] a channel of a picture."""
        mean = self._sum / self._samples
        values = {
            "min": self._low,
            "max": self._high,
            "mean": mean,
            "std": np.sqrt(np.maximum(self._squares / self._samples - mean**2, 0.0)),
        }
        shape = (-1, 1, 1) if name == _PICTURE else (-1,)
        return {key: value.reshape(shape).tolist() for key, value in values.items()} | {"count": [self._frames]}


def _plain(value: Any) -> Any:
    return value if isinstance(value, (str, int)) else json.dumps(value)
