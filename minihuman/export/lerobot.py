"""LeRobot datasets, format v3.0, written with pyarrow: ``OUT/<world>/{meta,data}``. No torch, no video.

A frame is an observation and the action it was answered with, so the observation after the last action has no row.
LeRobot's timestamps are frame number over frame rate; when a step really happened is in ``time_s``. An action is one of
a few: it is written as a vector with a 1 at its place, which a policy can learn, and as the number that ``step`` takes.
"""

import hashlib
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
from minihuman.export.asked import about_of, called
from minihuman.export.datasets_by_world import dataset_name
from minihuman.export.lerobot_card import card
from minihuman.export.lerobot_features import PICTURE, columns_of, features_of
from minihuman.export.lerobot_stats import Total
from minihuman.export.port import Written
from minihuman.export.resimulate import Demonstration, Resimulator

FORMAT_VERSION = "v3.0"
FPS = 10  # nominal: steps follow keys, not a clock
CHUNK = 1000  # files a folder, the format's default
FILE_BYTES = 100 * 1024 * 1024  # of episodes in one file, the format's default


def export(chosen: ChosenEpisodes, out: Path) -> Written:
    """Write every episode that has a step, many to a file.

    Raises:
        ExportError: if an episode does not replay.
    """
    resimulate = Resimulator()
    datasets: dict[str, _Dataset] = {}
    left_out: list[str] = []
    for item in chosen:
        if not len(item.episode.actions):
            left_out.append(f"{called(item)} has no step, and LeRobot keeps none without")
            continue
        demonstration = resimulate(item)
        name = _name(item, demonstration, datasets)
        if name not in datasets:
            datasets[name] = _Dataset(out / name, item, demonstration)
        datasets[name].add(item, demonstration)
    for dataset in datasets.values():
        dataset.finish()
    return Written(
        tuple(out / name for name in datasets),
        sum(len(dataset.rows) for dataset in datasets.values()),
        sum(dataset.frames for dataset in datasets.values()),
        tuple(left_out),
    )


def _name(item: Chosen, demonstration: Demonstration, datasets: "dict[str, _Dataset]") -> str:
    """The episode's dataset; where its vectors of actions or states have other numbers than the first's, another."""
    name = dataset_name(item)
    features = features_of(item, demonstration)
    if name in datasets and datasets[name].features != features:
        return f"{name}-{hashlib.sha256(json.dumps(features).encode()).hexdigest()[:6]}"
    return name


class _Dataset:
    """One world's dataset while it is written."""

    def __init__(self, root: Path, item: Chosen, first: Demonstration) -> None:
        self.root = root
        self.frames = 0
        self.rows: list[dict[str, Any]] = []  # one an episode
        self.features = features_of(item, first)
        self._about = about_of(item)
        self._world = item.episode.plan.world
        self._tasks: dict[str, int] = {}
        self._totals = {name: Total(picture=name == PICTURE) for name in self.features}
        self._file = 0
        self._writer: pq.ParquetWriter | None = None
        (root / "meta").mkdir(parents=True)

    def add(self, item: Chosen, demonstration: Demonstration) -> None:
        """Write an episode's frames and remember its row of metadata."""
        number, length = len(self.rows), len(item.episode.actions)
        task = item.episode.start.mission or f"reach the goal of {item.episode.plan.world}"
        task_index = self._tasks.setdefault(task, len(self._tasks))
        columns = columns_of(item, demonstration, self.features)
        own: dict[str, NDArray[Any]] = {
            "timestamp": (np.arange(length) / FPS).astype(np.float32),
            "frame_index": np.arange(length, dtype=np.int64),
            "episode_index": np.full(length, number, np.int64),
            "index": np.arange(self.frames, self.frames + length, dtype=np.int64),
            "task_index": np.full(length, task_index, np.int64),
        }
        columns |= own
        chunk, file = self._write(_table(columns, self.features))
        statistics = {}
        for name, values in columns.items():
            alone = Total(picture=name == PICTURE)
            for total in (alone, self._totals[name]):
                total.add(values)
            statistics[name] = alone.statistics()
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

    def _write(self, frames: pa.Table) -> tuple[int, int]:
        """Write an episode behind the others in a file, or in the next where that is full; say in which."""
        chunk, file = divmod(self._file, CHUNK)
        path = self.root / f"data/chunk-{chunk:03d}/file-{file:03d}.parquet"
        if self._writer is None:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._writer = pq.ParquetWriter(path, frames.schema, compression="snappy")
        self._writer.write_table(frames)
        if path.stat().st_size >= FILE_BYTES:
            self._writer.close()
            self._file, self._writer = self._file + 1, None
        return chunk, file

    def finish(self) -> None:
        """Write what describes the whole dataset."""
        if self._writer is not None:
            self._writer.close()
        meta = self.root / "meta"
        episodes = meta / "episodes" / "chunk-000"
        episodes.mkdir(parents=True)
        pq.write_table(pa.Table.from_pylist(self.rows), episodes / "file-000.parquet", compression="snappy")
        # the task is the unnamed index of a pandas frame: readers look for the column that makes
        pd.DataFrame({"task_index": list(self._tasks.values())}, index=list(self._tasks)).to_parquet(
            meta / "tasks.parquet"
        )
        totals = {name: total.statistics() for name, total in self._totals.items()}
        (meta / "stats.json").write_text(json.dumps(totals, indent=4))
        info = {
            "codebase_version": FORMAT_VERSION,
            "robot_type": "minihuman",
            "total_episodes": len(self.rows),
            "total_frames": self.frames,
            "total_tasks": len(self._tasks),
            "chunks_size": CHUNK,
            "data_files_size_in_mb": FILE_BYTES // 1024**2,
            "video_files_size_in_mb": 200,
            "fps": FPS,
            "splits": {"train": f"0:{len(self.rows)}"},
            "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
            "video_path": None,
            "features": self.features,
        }
        (meta / "info.json").write_text(json.dumps(info, indent=4))
        (self.root / "README.md").write_text(card(self._about, self._world, info, list(self._tasks)))


def _table(columns: dict[str, NDArray[Any]], features: dict[str, Any]) -> pa.Table:
    """An episode's frames. A feature of one number is a plain column: no list of one, which its readers refuse."""
    arrays = {}
    for name, values in columns.items():
        if features[name]["dtype"] == "image":
            pictures = [{"bytes": _png(picture), "path": None} for picture in values]
            arrays[name] = pa.array(pictures, pa.struct([("bytes", pa.binary()), ("path", pa.string())]))
        elif values.ndim == 2 and values.shape[1] > 1:
            flat_values = pa.array(np.ascontiguousarray(values).reshape(-1))
            arrays[name] = pa.FixedSizeListArray.from_arrays(flat_values, values.shape[1])
        else:
            arrays[name] = pa.array(values.reshape(-1))
    return pa.table(arrays)


def _png(picture: NDArray[np.uint8]) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(picture).save(buffer, "PNG")
    return buffer.getvalue()


def _plain(value: Any) -> Any:
    return value if isinstance(value, (str, int)) else json.dumps(value)
