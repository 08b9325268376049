"""Export LeRobot datasets, format v3.0: `OUT/<world>/{meta,data,videos}`, written with pyarrow and PyAV, without torch.

A frame is an observation and the action taken in it, so the observation after the last action has no row. LeRobot's
timestamps are frame number over frame rate; the time at which a step really happened is in `time_s`. A discrete action
is written as a one-hot vector, which a policy can learn, and as the number that `step` takes. Pictures are LeRobot's
video features: the observation if it is a picture, else the participant's view. The statistics, the features and the
card are those that LeRobot and the Hub read.
"""

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

from minihuman import __version__
from minihuman.dataset.included_episodes import IncludedEpisode, IncludedEpisodes
from minihuman.dataset.study_facts import read_study_facts
from minihuman.display.video import ENCODINGS, VideoWriter, pad_to_even
from minihuman.errors import ExportError
from minihuman.experiment.protocol.specs import AboutSpec
from minihuman.exporters.exporter import ExportResult
from minihuman.exporters.feature_statistics import (
    NO_STATISTICS,
    QUANTILES as QUANTILES,
    FeatureStatistics as FeatureStatistics,
    select_known as select_known,
)
from minihuman.exporters.flat_observations import (
    PICTURE_PX,
    ReplayedEpisode,
    ReplayedStudy,
    build_actions,
    build_state,
    build_steering_columns,
    name_actions,
    name_state,
)
from minihuman.exporters.study_metadata import get_doi_url, get_licence_id, get_plain_facts
from minihuman.exporters.world_info import build_info_columns, format_info_texts, list_info_values
from minihuman.log.model.session_log import EpisodeLog

_NULLABLE_TYPES = {"bool": pa.bool_(), "string": pa.string()}  # by a feature's type
LARGEST_REWARD = float(np.sqrt(np.finfo(np.float64).max))

PICTURE = "observation.image"
STATE = "observation.state"
INFO = "info."  # prefix of a recorded key of the world's info


def build_features(included: IncludedEpisode, first: ReplayedEpisode) -> dict[str, dict[str, Any]]:
    """Describe a frame of the episode's dataset: each feature's type, shape and names, in the form of ``info.json``.

    Args:
        included: the first episode of the dataset.
        first: the same episode with its observations.

    Raises:
        ExportError: if the observation has no numbers.
    """
    names = name_state(first)
    if not names:
        raise ExportError(
            f"{included.log.path}: {included.episode.name}: the observation has no numbers, which LeRobot's "
            "observation.state needs; export as minari, robomimic, rlds or imitation"
        )
    features: dict[str, dict[str, Any]] = {}
    if first.pictures:
        features[PICTURE] = _describe_video(pad_to_even(first.pictures[0]))
    features[STATE] = {"dtype": "float32", "shape": [len(names)], "names": names}
    actions = name_actions(included)
    features["action"] = {"dtype": "float32", "shape": [len(actions)], "names": actions}
    if included.episode.action_vectors is None:
        features["discrete_action"] = _describe_number("int64", "what the environment's step takes")
    if included.episode.taught is not None:
        features["intervention"] = _describe_number("bool")
        features["policy_action"] = _describe_number("int64", "what the policy would have done")
    features["next.reward"] = _describe_number("float64")
    features["next.done"] = _describe_number("bool")
    features["next.success"] = _describe_number("bool")
    for key, values in build_info_columns(included.episode).items():
        features[f"{INFO}{key}"] = _describe_number("string" if isinstance(values, list) else "float64")
    features["time_s"] = _describe_number("float64")
    features["timestamp"] = _describe_number("float32")
    for name in ("frame_index", "episode_index", "index", "task_index"):
        features[name] = _describe_number("int64")
    return features


def _describe_number(dtype: str, name: str = "") -> dict[str, Any]:
    """Return the description of a feature with a single value per frame; ``name`` names this value, "" for no name."""
    names = None
    if name:
        names = [name]
    return {"dtype": dtype, "shape": [1], "names": names}


def _describe_video(picture: NDArray[np.uint8]) -> dict[str, Any]:
    """Return the description of a feature that is stored as video, by an example of its pictures."""
    height, width, channels = picture.shape
    encoding = ENCODINGS["dataset"]
    info = {
        "video.height": height,
        "video.width": width,
        "video.codec": "h264",
        "video.pix_fmt": encoding.pixel_format,
        "video.is_depth_map": False,
        "video.fps": FPS,
        "video.channels": channels,
        "has_audio": False,
    }
    names = ["height", "width", "channels"]
    return {"dtype": "video", "shape": [height, width, channels], "names": names, "info": info}


def build_columns(
    included: IncludedEpisode, demonstration: ReplayedEpisode, features: dict[str, Any]
) -> dict[str, NDArray[Any]]:
    """Build the columns that come from the episode, with one row per step; ``features`` are those of the dataset.

    Raises:
        ExportError: if a reward is too large, or a key of ``info`` has another type than in the dataset.
    """
    episode = included.episode
    _require_small_rewards(included)
    columns: dict[str, NDArray[Any]] = {}
    if PICTURE in features:
        columns[PICTURE] = np.stack([pad_to_even(picture) for picture in demonstration.pictures[:-1]])
    is_last = np.zeros(len(episode.actions), bool)
    is_last[-1] = True
    return columns | {
        STATE: build_state(demonstration)[:-1],
        **build_actions(included, demonstration),
        **build_steering_columns(episode),
        "next.reward": episode.rewards,
        "next.done": is_last,
        "next.success": _build_success(episode, is_last),
        **_convert_info(included, features),
        "time_s": (episode.t_ns[1:] - episode.t_ns[0]) / 1e9,
    }


def _require_small_rewards(included: IncludedEpisode) -> None:
    """Raise ExportError if an episode has a finite reward whose square is not finite."""
    episode = included.episode
    is_too_large = np.isfinite(episode.rewards) & (np.abs(episode.rewards) > LARGEST_REWARD)
    if is_too_large.any():
        step = int(is_too_large.argmax())
        raise ExportError(
            f"{included.log.path}: {episode.name} step {step + 1}: the reward {episode.rewards[step]:g} has no square, "
            "of which LeRobot's statistics are made; export as minari, robomimic or imitation"
        )


def _build_success(episode: EpisodeLog, is_last: NDArray[np.bool_]) -> NDArray[Any]:
    """Build a column of booleans, True only at the last step of a successful episode.

    If success is undefined, every row is None, which the file stores as null.
    """
    if episode.success is None:
        return np.full(len(is_last), None, object)
    return is_last & episode.success


def _convert_info(included: IncludedEpisode, features: dict[str, Any]) -> dict[str, NDArray[Any]]:
    """Build the columns of the recorded keys of ``info``, in the dataset's types.

    Raises:
        ExportError: if a key that was a number in the dataset's first episode is something else in this one.
    """
    episode = included.episode
    columns = dict[str, NDArray[Any]]()
    for key, values in build_info_columns(episode).items():
        if features[f"{INFO}{key}"]["dtype"] == "string":
            columns[f"{INFO}{key}"] = np.array(format_info_texts(list_info_values(episode, key)), object)
        elif isinstance(values, list):
            raise ExportError(
                f"{included.log.path}: {episode.name}: info[{key!r}] is no number, as it was in the episodes before; "
                "LeRobot keeps one type per column, so export csv, or leave it out of record_info"
            )
        else:
            columns[f"{INFO}{key}"] = values
    return columns


_TASKS_SHOWN = 20


def build_card(study_facts: AboutSpec, world: str, info: Mapping[str, Any], tasks: Sequence[str]) -> str:
    """Return the text of the dataset card in Markdown, without facts that the protocol lacks.

    Args:
        study_facts: the facts about the study.
        world: the id of the dataset's world.
        info: the content of ``info.json``.
        tasks: the texts of the tasks, of which the first `_TASKS_SHOWN` are listed.
    """
    lines = [*_build_front_matter(study_facts), "", f"# {study_facts.title or world}", ""]
    if study_facts.description:
        lines += [study_facts.description, ""]
    lines += _describe_features(world, info)
    lines += ["", "Tasks:", "", *(f"- {task}" for task in tasks[:_TASKS_SHOWN])]
    n_more = len(tasks) - _TASKS_SHOWN
    if n_more > 0:
        lines.append(f"- and {n_more} more")
    authors = [f"{author.name} {author.orcid}".strip() for author in study_facts.authors]
    sections = {
        "Authors": "; ".join(authors),
        "Funding": "; ".join(study_facts.funding),
        "Cite": get_doi_url(study_facts),
        "References": "; ".join(study_facts.references),
    }
    for name, text in sections.items():
        if text:
            lines += ["", f"{name}: {text}"]
    return "\n".join(lines) + "\n"


def _build_front_matter(study_facts: AboutSpec) -> list[str]:
    """Return the lines of the card's YAML, by which the Hugging Face hub finds the dataset."""
    front_matter: dict[str, Any] = {
        "license": get_licence_id(study_facts),
        "task_categories": ["robotics"],
        "tags": ["LeRobot", "minihuman", *study_facts.keywords],
        "configs": [{"config_name": "default", "data_files": "data/*/*.parquet"}],
    }
    if study_facts.title:
        front_matter["pretty_name"] = study_facts.title
    lines = ["---"]
    for name, content in front_matter.items():
        encoded = msgspec.json.encode(content).decode()  # JSON is YAML
        lines.append(f"{name}: {encoded}")
    return [*lines, "---"]


def _describe_features(world: str, info: Mapping[str, Any]) -> list[str]:
    """Return the lines that say how many episodes there are and what each feature means."""
    features = info["features"]
    action = "- `action` is the vector that the environment's step takes, flat."
    if "discrete_action" in features:
        action = (
            "- `action` has a 1 at its place among the names; `discrete_action` is what the environment's step takes."
        )
    lines = [
        f"{info['total_episodes']} episodes, {info['total_frames']} frames of `{world}`.",
        f"Written by minihuman {__version__} in LeRobot's format {info['codebase_version']}.",
        "",
        action,
        "- `timestamp` is frame number over a nominal frame rate; people took as long as they took, see `time_s`.",
        "- `minihuman/...` in `meta/episodes` says who played, in which session, episode and attempt, with which keys.",
    ]
    if PICTURE in features:
        lines.append("- `observation.image` is a video, so its colours differ a little from what was seen.")
    if "x" in features[STATE]["names"]:
        lines.append("- `observation.state` is where the agent stood, which people saw only in the picture.")
    return lines


FORMAT_VERSION = "v3.0"
FPS = 10  # nominal: steps follow keys, not a clock
CHUNK = 1000  # files per folder, the format's default
FILE_BYTES = 100 * 1024 * 1024  # of episodes in one file, the format's default
VIDEO_BYTES = 2 * FILE_BYTES
VIDEO_PATH = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"


def export(chosen: IncludedEpisodes, out: Path) -> ExportResult:
    """Write a LeRobot dataset for each world, of its episodes that have a step, with many episodes to a file.

    Raises:
        ExportError: if an episode does not replay.
    """
    replayed = ReplayedStudy(chosen, "has no step, and LeRobot keeps none without", picture_px=PICTURE_PX)
    datasets: dict[str, _Dataset] = {}
    for name, included, demonstration in replayed:
        if name not in datasets:
            datasets[name] = _Dataset(out / name, included, demonstration)
        datasets[name].add(included, demonstration)
    for dataset in datasets.values():
        dataset.finish()
    return replayed.result(out / name for name in datasets)


class _Dataset:
    """The dataset of one world while it is being written."""

    def __init__(self, root: Path, included: IncludedEpisode, first: ReplayedEpisode) -> None:
        self.root = root
        self.frames = 0
        self.rows: list[dict[str, Any]] = []  # one per episode
        self.features = build_features(included, first)
        self._study_facts = read_study_facts(included.log.path, included.log.plan.protocol_toml)
        self._world = included.episode.plan.world
        self._tasks: dict[str, int] = {}
        self._totals: dict[str, FeatureStatistics] = {}
        self._file_number = 0
        self._writer: pq.ParquetWriter | None = None
        self._video_number = 0
        self._video: VideoWriter | None = None
        (root / "meta").mkdir(parents=True)

    def add(self, included: IncludedEpisode, demonstration: ReplayedEpisode) -> None:
        """Write an episode's frames and record its row of metadata."""
        number = len(self.rows)
        length = len(included.episode.actions)
        task = included.episode.start.mission or f"reach the goal of {included.episode.plan.world}"
        task_index = self._tasks.setdefault(task, len(self._tasks))
        columns = build_columns(included, demonstration, self.features)
        video_places: dict[str, Any] = {}
        if PICTURE in columns:
            video_places = self._write_video(columns[PICTURE])
        index_columns: dict[str, NDArray[Any]] = {
            "timestamp": (np.arange(length) / FPS).astype(np.float32),
            "frame_index": np.arange(length, dtype=np.int64),
            "episode_index": np.full(length, number, np.int64),
            "index": np.arange(self.frames, self.frames + length, dtype=np.int64),
            "task_index": np.full(length, task_index, np.int64),
        }
        columns |= index_columns
        chunk, file = self._write_frames(_build_table(columns, self.features))
        statistics: dict[str, Any] = {}
        for name, column in columns.items():
            for statistic, numbers in self._add_statistics(name, column).items():
                statistics[f"stats/{name}/{statistic}"] = numbers
        self.rows.append(
            {
                "episode_index": number,
                "tasks": [task],
                "length": length,
                "data/chunk_index": chunk,
                "data/file_index": file,
                **video_places,
                "dataset_from_index": self.frames,
                "dataset_to_index": self.frames + length,
                "meta/episodes/chunk_index": 0,
                "meta/episodes/file_index": 0,
                **{f"minihuman/{name}": fact for name, fact in get_plain_facts(included).items()},
                **statistics,
            }
        )
        self.frames += length

    def _add_statistics(self, name: str, column: NDArray[Any]) -> Mapping[str, Any]:
        """Return an episode's statistics of the feature ``name``, and merge them into those of the dataset.

        A column without a known value has `NO_STATISTICS`.
        """
        rows = select_known(column)
        if not len(rows):
            return NO_STATISTICS
        statistics = FeatureStatistics(rows)
        episode_statistics = statistics.statistics()  # before other episodes are merged into it
        if name in self._totals:
            self._totals[name].add(statistics)
        else:
            self._totals[name] = statistics
        return episode_statistics

    def _write_frames(self, frames: pa.Table) -> tuple[int, int]:
        """Append an episode to the current data file, or to the next one if it is full.

        Return the chunk and file numbers.
        """
        chunk, file = divmod(self._file_number, CHUNK)
        path = self.root / f"data/chunk-{chunk:03d}/file-{file:03d}.parquet"
        if self._writer is None:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._writer = pq.ParquetWriter(path, frames.schema, compression="snappy")
        self._writer.write_table(frames)
        if path.stat().st_size >= FILE_BYTES:
            self._writer.close()
            self._file_number += 1
            self._writer = None
        return chunk, file

    def _write_video(self, pictures: NDArray[np.uint8]) -> dict[str, Any]:
        """Append an episode's pictures to the current video file, or to the next one if it is full.

        Return the columns of the episode's metadata that say where its pictures are.
        """
        chunk, file = divmod(self._video_number, CHUNK)
        path = self.root / VIDEO_PATH.format(video_key=PICTURE, chunk_index=chunk, file_index=file)
        if self._video is None:
            path.parent.mkdir(parents=True, exist_ok=True)
            self._video = VideoWriter(path, "dataset", fps=FPS)
        first = self._video.frames
        self._video.write(pictures)
        places: dict[str, Any] = {"chunk_index": chunk, "file_index": file}
        places |= {"from_timestamp": first / FPS, "to_timestamp": self._video.frames / FPS}
        written_bytes = path.stat().st_size if path.exists() else 0  # the encoder holds the first pictures back
        if written_bytes >= VIDEO_BYTES:
            self._video.close()
            self._video_number += 1
            self._video = None
        return {f"videos/{PICTURE}/{name}": place for name, place in places.items()}

    def finish(self) -> None:
        """Write the metadata of the whole dataset."""
        for open_file in (self._writer, self._video):
            if open_file is not None:
                open_file.close()
        meta = self.root / "meta"
        episodes = meta / "episodes" / "chunk-000"
        episodes.mkdir(parents=True)
        # pyarrow finds no type for a column without a value, so such columns are left out
        filled = [name for name in self.rows[0] if any(row[name] is not None for row in self.rows)]
        table = pa.Table.from_pylist([{name: row[name] for name in filled} for row in self.rows])
        pq.write_table(table, episodes / "file-000.parquet", compression="snappy")
        # The task is the unnamed index of a pandas frame; readers look for the column that pandas makes of it.
        pd.DataFrame({"task_index": list(self._tasks.values())}, index=list(self._tasks)).to_parquet(
            meta / "tasks.parquet"
        )
        totals = {name: total.statistics() for name, total in self._totals.items()}
        (meta / "stats.json").write_text(json.dumps(totals, indent=4), encoding="utf-8", newline="\n")
        info = self._build_info()
        (meta / "info.json").write_text(json.dumps(info, indent=4), encoding="utf-8", newline="\n")
        card = build_card(self._study_facts, self._world, info, list(self._tasks))
        (self.root / "README.md").write_text(card, encoding="utf-8", newline="\n")

    def _build_info(self) -> dict[str, Any]:
        """Build the content of ``info.json``."""
        return {
            "codebase_version": FORMAT_VERSION,
            "robot_type": "minihuman",
            "total_episodes": len(self.rows),
            "total_frames": self.frames,
            "total_tasks": len(self._tasks),
            "chunks_size": CHUNK,
            "data_files_size_in_mb": FILE_BYTES // 1024**2,
            "video_files_size_in_mb": VIDEO_BYTES // 1024**2,
            "fps": FPS,
            "splits": {"train": f"0:{len(self.rows)}"},
            "data_path": "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet",
            "video_path": VIDEO_PATH if PICTURE in self.features else None,
            "features": self.features,
        }


def _build_table(columns: dict[str, NDArray[Any]], features: dict[str, Any]) -> pa.Table:
    """Build a table of an episode's frames, without its pictures, which are in a video.

    A feature with one number is a plain column; readers refuse lists of length one.
    """
    arrays = {}
    for name, values in columns.items():
        if features[name]["dtype"] == "video":
            continue
        if values.ndim == 2 and values.shape[1] > 1:
            flat_values = pa.array(np.ascontiguousarray(values).reshape(-1))
            arrays[name] = pa.FixedSizeListArray.from_arrays(flat_values, values.shape[1])
        else:
            arrays[name] = pa.array(values.reshape(-1), _NULLABLE_TYPES.get(features[name]["dtype"]))
    return pa.table(arrays)
