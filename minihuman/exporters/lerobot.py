"""Export LeRobot datasets, format v3.0, written with pyarrow: `OUT/<world>/{meta,data}`. No torch, no video.

A frame is an observation and the action taken in it, so the observation after the last action has no row. LeRobot's
timestamps are frame number over frame rate; when a step really happened is in `time_s`. A discrete action is
written as a one-hot vector, which a policy can learn, and as the number that `step` takes. The statistics, the
features and the card are those that LeRobot and the Hub read.
"""

import hashlib
import io
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray
from PIL import Image

from minihuman import __version__
from minihuman.dataset.episode_stream import IncludedEpisode, IncludedEpisodes
from minihuman.experiment.protocol.specs import AboutSpec
from minihuman.exporters.exporter import ExportResult
from minihuman.exporters.flat_observations import (
    ReplayedEpisode,
    Resimulator,
    build_steering_columns,
    dataset_name,
    flatten_observation,
    is_picture,
    name_flat_observation,
)
from minihuman.exporters.study_metadata import describe_episode, get_action_names, get_study_facts

QUANTILES = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}


class FeatureStatistics:
    """Running statistics of one feature. Quantiles over episodes are means of theirs by frames, as LeRobot's own are.

    Args:
        picture: whether it is a picture, whose channels are told apart and scaled to 0 to 1.
    """

    def __init__(self, *, picture: bool) -> None:
        self._picture = picture
        self._frames = 0
        self._samples = 0
        self._low: Any = np.inf
        self._high: Any = -np.inf
        self._sum: Any = 0.0
        self._squares: Any = 0.0
        self._quantiles: Any = 0.0  # (5, numbers) times frames

    def add(self, values: NDArray[Any]) -> None:
        """Take an episode's values in, a row a frame."""
        samples = _channels(values) if self._picture else values.reshape(len(values), -1).astype(np.float64)
        self._frames += len(values)
        self._samples += len(samples)
        self._low = np.minimum(self._low, samples.min(axis=0))
        self._high = np.maximum(self._high, samples.max(axis=0))
        self._sum = self._sum + samples.sum(axis=0)
        self._squares = self._squares + (samples**2).sum(axis=0)
        levels = list(QUANTILES.values())
        found = _of_bytes(values, levels) if self._picture else np.quantile(samples, levels, axis=0)
        self._quantiles = self._quantiles + found * len(values)

    def statistics(self) -> dict[str, Any]:
        """As the format keeps them: a list a number, [[[value]]] a channel of a picture."""
        mean = self._sum / self._samples
        values = {
            "min": self._low,
            "max": self._high,
            "mean": mean,
            "std": np.sqrt(np.maximum(self._squares / self._samples - mean**2, 0.0)),
            **dict(zip(QUANTILES, self._quantiles / self._frames, strict=True)),
        }
        shape = (-1, 1, 1) if self._picture else (-1,)
        return {key: value.reshape(shape).tolist() for key, value in values.items()} | {"count": [self._frames]}


def _channels(pictures: NDArray[np.uint8]) -> NDArray[np.float64]:
    return pictures.reshape(-1, pictures.shape[-1]) / 255.0


def _of_bytes(pictures: NDArray[np.uint8], levels: list[float]) -> NDArray[np.float64]:
    """Quantiles of each channel, from how often each of its 256 values occurs."""
    found = []
    for channel in pictures.reshape(-1, pictures.shape[-1]).T:
        share = np.cumsum(np.bincount(channel, minlength=256)) / channel.size
        found.append(np.searchsorted(share, levels) / 255.0)
    return np.array(found).T


PICTURE, STATE = "observation.image", "observation.state"


def build_features(item: IncludedEpisode, first: ReplayedEpisode) -> dict[str, dict[str, Any]]:
    """What a frame of the episode's dataset has: type, shape and names of each feature, as ``info.json`` says them."""
    if is_picture(first.observation_space):
        shape = list(np.asarray(first.observations[0]).shape)
        names = _place_names(item)
        seen = {PICTURE: {"dtype": "image", "shape": shape, "names": ["height", "width", "channels"]}}
    else:
        names, seen = name_flat_observation(first.observations[0]), {}
    actions = list(get_action_names(item))
    return {
        **seen,
        STATE: {"dtype": "float32", "shape": [len(names)], "names": names},
        "action": {"dtype": "float32", "shape": [len(actions)], "names": actions},
        "action_index": {"dtype": "int64", "shape": [1], "names": ["what the environment's step takes"]},
        **(
            {
                "intervention": {"dtype": "bool", "shape": [1], "names": None},
                "policy_action": {"dtype": "int64", "shape": [1], "names": ["what the policy would have done"]},
            }
            if item.episode.taught is not None
            else {}
        ),
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


def _place_names(item: IncludedEpisode) -> list[str]:
    """The state of a world of pictures: where the agent stands, or, where the world cannot tell, how much is over."""
    return ["elapsed"] if np.isnan(item.episode.poses).any() else ["x", "z", "cos_yaw", "sin_yaw"]


def _place(item: IncludedEpisode) -> NDArray[np.float32]:
    poses = item.episode.poses[:-1]
    if np.isnan(item.episode.poses).any():
        return (np.arange(len(poses)) / item.episode.plan.max_steps).astype(np.float32).reshape(-1, 1)
    x, _, z, yaw_rad = poses.T
    return np.stack([x, z, np.cos(yaw_rad), np.sin(yaw_rad)], axis=1).astype(np.float32)


def build_columns(
    item: IncludedEpisode, demonstration: ReplayedEpisode, features: dict[str, Any]
) -> dict[str, NDArray[Any]]:
    """The features that come from the episode, ``n`` rows each."""
    episode = item.episode
    before = demonstration.observations[:-1]
    seen: dict[str, NDArray[Any]]
    if PICTURE in features:
        seen = {PICTURE: np.stack(before), STATE: _place(item)}
    else:
        space = demonstration.observation_space
        seen = {STATE: np.stack([flatten_observation(observation, space).astype(np.float32) for observation in before])}
    done = np.zeros(len(episode.actions), bool)
    done[-1] = True
    taken = np.array(episode.start.action_names)[episode.actions]
    return {
        **seen,
        "action": (taken[:, None] == np.array(features["action"]["names"])).astype(np.float32),
        "action_index": demonstration.actions,
        **build_steering_columns(episode),
        "next.reward": episode.rewards,
        "next.done": done,
        "next.success": done & (episode.outcome == "goal"),
        "time_s": (episode.t_ns[1:] - episode.t_ns[0]) / 1e9,
    }


_TASKS_SHOWN = 20


def build_card(about: AboutSpec, world: str, info: Mapping[str, Any], tasks: Sequence[str]) -> str:
    """The text; what the protocol does not say is not in it."""
    front: dict[str, Any] = {
        "license": about.licence.lower() if about.licence and "://" not in about.licence else "unknown",
        "task_categories": ["robotics"],
        "tags": ["LeRobot", "minihuman", *about.keywords],
        "configs": [{"config_name": "default", "data_files": "data/*/*.parquet"}],
    }
    if about.title:
        front["pretty_name"] = about.title
    lines = ["---", *_yaml(front), "---", "", f"# {about.title or world}", ""]
    lines += [about.description, ""] if about.description else []
    lines += [
        f"{info['total_episodes']} episodes, {info['total_frames']} frames of `{world}`.",
        f"Written by minihuman {__version__} in LeRobot's format {info['codebase_version']}.",
        "",
        "- `action` has a 1 at its place among the names; `action_index` is what the environment's step takes.",
        "- `timestamp` is frame number over a nominal frame rate; people took as long as they took, see `time_s`.",
        "- `minihuman/...` in `meta/episodes` says who played, in which session, episode and attempt, with which keys.",
    ]
    if "observation.image" in info["features"]:
        lines.append("- `observation.state` is where the agent stood, which people saw only in the picture.")
    lines += ["", "Tasks:", "", *(f"- {task}" for task in tasks[:_TASKS_SHOWN])]
    lines += [f"- and {len(tasks) - _TASKS_SHOWN} more"] if len(tasks) > _TASKS_SHOWN else []
    for name, values in (
        ("Authors", [f"{author.name} {author.orcid}".strip() for author in about.authors]),
        ("Funding", about.funding),
        ("Cite", [f"https://doi.org/{about.doi}"] if about.doi else []),
        ("References", about.references),
    ):
        lines += ["", f"{name}: {'; '.join(values)}"] if values else []
    return "\n".join(lines) + "\n"


def _yaml(front: Mapping[str, Any]) -> list[str]:
    """Front matter: JSON is YAML, a key a line."""
    return [f"{name}: {msgspec.json.encode(value).decode()}" for name, value in front.items()]


FORMAT_VERSION = "v3.0"
FPS = 10  # nominal: steps follow keys, not a clock
CHUNK = 1000  # files a folder, the format's default
FILE_BYTES = 100 * 1024 * 1024  # of episodes in one file, the format's default


def export(chosen: IncludedEpisodes, out: Path) -> ExportResult:
    """Write every episode that has a step, many to a file.

    Raises:
        ExportError: if an episode does not replay.
    """
    resimulate = Resimulator()
    datasets: dict[str, _Dataset] = {}
    left_out: list[str] = []
    for item in chosen:
        if not len(item.episode.actions):
            left_out.append(f"{describe_episode(item)} has no step, and LeRobot keeps none without")
            continue
        demonstration = resimulate(item)
        name = _name(item, demonstration, datasets)
        if name not in datasets:
            datasets[name] = _Dataset(out / name, item, demonstration)
        datasets[name].add(item, demonstration)
    for dataset in datasets.values():
        dataset.finish()
    return ExportResult(
        tuple(out / name for name in datasets),
        sum(len(dataset.rows) for dataset in datasets.values()),
        sum(dataset.frames for dataset in datasets.values()),
        tuple(left_out),
    )


def _name(item: IncludedEpisode, demonstration: ReplayedEpisode, datasets: "dict[str, _Dataset]") -> str:
    """The episode's dataset; where its vectors of actions or states have other numbers than the first's, another."""
    name = dataset_name(item)
    features = build_features(item, demonstration)
    if name in datasets and datasets[name].features != features:
        return f"{name}-{hashlib.sha256(json.dumps(features).encode()).hexdigest()[:6]}"
    return name


class _Dataset:
    """One world's dataset while it is written."""

    def __init__(self, root: Path, item: IncludedEpisode, first: ReplayedEpisode) -> None:
        self.root = root
        self.frames = 0
        self.rows: list[dict[str, Any]] = []  # one an episode
        self.features = build_features(item, first)
        self._about = get_study_facts(item)
        self._world = item.episode.plan.world
        self._tasks: dict[str, int] = {}
        self._totals = {name: FeatureStatistics(picture=name == PICTURE) for name in self.features}
        self._file = 0
        self._writer: pq.ParquetWriter | None = None
        (root / "meta").mkdir(parents=True)

    def add(self, item: IncludedEpisode, demonstration: ReplayedEpisode) -> None:
        """Write an episode's frames and remember its row of metadata."""
        number, length = len(self.rows), len(item.episode.actions)
        task = item.episode.start.mission or f"reach the goal of {item.episode.plan.world}"
        task_index = self._tasks.setdefault(task, len(self._tasks))
        columns = build_columns(item, demonstration, self.features)
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
            alone = FeatureStatistics(picture=name == PICTURE)
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
        (meta / "stats.json").write_text(json.dumps(totals, indent=4), encoding="utf-8", newline="\n")
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
        (meta / "info.json").write_text(json.dumps(info, indent=4), encoding="utf-8", newline="\n")
        (self.root / "README.md").write_text(
            build_card(self._about, self._world, info, list(self._tasks)), encoding="utf-8", newline="\n"
        )


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
