"""Export RLDS episodes in the format of TensorFlow Datasets, `OUT/<world>/1.0.0`, for `tfds.builder_from_directory`.

An episode is a sequence of steps. The last step holds the observation after the last action; its action, reward and
discount have no meaning, as RLDS specifies. The files are written without TensorFlow: a TFRecord file frames
`tf.train.Example` messages with their CRC-32C. Sources: https://github.com/google-research/rlds,
https://www.tensorflow.org/tutorials/load_data/tfrecord.
"""

import json
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import google_crc32c
import numpy as np
from google.protobuf import message_factory, text_format
from google.protobuf.descriptor_pb2 import FileDescriptorProto
from numpy.typing import NDArray

from minihuman import __version__
from minihuman.dataset.included_episodes import IncludedEpisode, IncludedEpisodes
from minihuman.dataset.study_facts import read_study_facts
from minihuman.errors import ExportError
from minihuman.exporters.exporter import ExportResult
from minihuman.exporters.flat_observations import (
    PICTURE_PX,
    ReplayedEpisode,
    ReplayedStudy,
    build_actions,
    build_state,
)
from minihuman.exporters.study_metadata import get_plain_facts
from minihuman.log.observations import encode_png

DATASET_VERSION = "1.0.0"
SHARD_BYTES = 200 * 1024 * 1024
_CRC_MASK_DELTA = 0xA282EAD8  # of the TFRecord format
_FEATURES = "tensorflow_datasets.core.features."


def export(chosen: IncludedEpisodes, out: Path) -> ExportResult:
    """Write an RLDS dataset for each world, of its episodes that have a step.

    Raises:
        ExportError: if an episode does not replay.
    """
    replayed = ReplayedStudy(chosen, "has no step", picture_px=PICTURE_PX)
    datasets: dict[str, _Dataset] = {}
    for dataset_name, included, demonstration in replayed:
        name = dataset_name.replace("-", "_")
        if name not in datasets:
            datasets[name] = _Dataset(
                out / name / DATASET_VERSION,
                name,
                read_study_facts(included.log.path, included.log.plan.protocol_toml).description,
            )
        datasets[name].add(build_steps(included, demonstration), get_plain_facts(included))
    for dataset in datasets.values():
        dataset.finish()
    return replayed.result(dataset.root for dataset in datasets.values())


def build_steps(included: IncludedEpisode, demonstration: ReplayedEpisode) -> dict[str, Any]:
    """Build the ``n + 1`` steps as columns; the columns of actions and rewards are 0 in the last step.

    Raises:
        ExportError: if float32 cannot hold a reward.
    """
    episode = included.episode
    _require_float32_rewards(included)
    last = len(episode.actions)
    n_rows = last + 1
    is_last = np.arange(n_rows) == last
    is_terminated = bool(episode.terminated[-1])
    discount = np.ones(n_rows, np.float32)
    if is_terminated:
        discount[last - 1] = 0.0
    columns: dict[str, Any] = {}
    if demonstration.pictures:
        columns["observation/image"] = np.stack(demonstration.pictures)
    columns["observation/state"] = build_state(demonstration)
    for name, actions in build_actions(included, demonstration).items():
        columns[name] = _append_zeros(actions)
    return columns | {
        "reward": _append_zeros(episode.rewards).astype(np.float32),
        "discount": discount,
        "is_first": np.arange(n_rows) == 0,
        "is_last": is_last,
        "is_terminal": is_last & is_terminated,
        "time_s": (episode.t_ns - episode.t_ns[0]) / 1e9,
        "language_instruction": [episode.start.mission] * n_rows,
    }


def _append_zeros(rows: NDArray[Any]) -> NDArray[Any]:
    """Append a row of zeros to the rows of an array."""
    other_axes = [(0, 0)] * (rows.ndim - 1)
    return np.pad(rows, [(0, 1), *other_axes])


def _require_float32_rewards(included: IncludedEpisode) -> None:
    """Raise ExportError if an episode has a finite reward that float32 cannot hold."""
    episode = included.episode
    is_beyond = np.isfinite(episode.rewards) & (np.abs(episode.rewards) > np.finfo(np.float32).max)
    if is_beyond.any():
        step = int(is_beyond.argmax())
        raise ExportError(
            f"{included.log.path}: {episode.name} step {step + 1}: the reward {episode.rewards[step]:g} is beyond the "
            "float32 of RLDS; export as minari, robomimic or imitation, which hold float64"
        )


class _Dataset:
    """The dataset of one world while it is being written."""

    def __init__(self, root: Path, name: str, description: str) -> None:
        self.root = root
        self._name = name
        self._description = description
        self._shards: list[list[int]] = []  # the number of episodes and of bytes in each file
        self._features: dict[str, Any] = {}
        root.mkdir(parents=True)

    def add(self, steps: Mapping[str, Any], facts: Mapping[str, Any]) -> None:
        """Append an episode to the current file, or to a new one if it is full.

        Args:
            steps: the episode's steps as columns, from ``build_steps``.
            facts: the episode's facts, which become its metadata.
        """
        if not self._shards or self._shards[-1][1] >= SHARD_BYTES:
            self._shards.append([0, 0])
        self._features = self._features or _describe_features(steps, facts)
        columns = {f"steps/{name}": values for name, values in steps.items()}
        columns |= {f"episode_metadata/{name}": [fact] for name, fact in facts.items()}
        record = _frame_record(encode_example(columns))
        with self._name_file(len(self._shards) - 1).open("ab") as file:
            file.write(record)
        n_episodes, n_bytes = self._shards[-1]
        self._shards[-1] = [n_episodes + 1, n_bytes + len(record)]

    def _name_file(self, number: int, n_files: int | None = None) -> Path:
        """Return the path of file ``number``, from 0; ``n_files`` is None until the number of files is known."""
        name = f"{self._name}-train.tfrecord-{number:05d}"
        if n_files is not None:
            name += f"-of-{n_files:05d}"
        return self.root / name

    def finish(self) -> None:
        """Rename the files to include their total number, and write the metadata of the dataset."""
        for number in range(len(self._shards)):
            self._name_file(number).rename(self._name_file(number, len(self._shards)))
        split = {
            "name": "train",
            "shardLengths": [str(episodes) for episodes, _ in self._shards],
            "numBytes": str(sum(size for _, size in self._shards)),
            "filepathTemplate": "{DATASET}-{SPLIT}.{FILEFORMAT}-{SHARD_X_OF_Y}",
        }
        info = {
            "name": self._name,
            "version": DATASET_VERSION,
            "description": self._description or f"Sessions recorded with minihuman {__version__}.",
            "fileFormat": "tfrecord",
            "releaseNotes": {},
            "splits": [split],
        }
        for name, content in (("dataset_info", info), ("features", self._features)):
            text = json.dumps(content, indent=4, sort_keys=True) + "\n"
            (self.root / f"{name}.json").write_text(text, encoding="utf-8", newline="\n")


def _describe_features(steps: Mapping[str, Any], facts: Mapping[str, Any]) -> dict[str, Any]:
    """Describe the features of an episode, its steps and its facts, in the form that TensorFlow Datasets reads."""
    kinds = {name: _describe_feature(values) for name, values in steps.items()}
    observation_kinds = {name.partition("/")[2]: kind for name, kind in kinds.items() if "/" in name}
    inner = {name: kind for name, kind in kinds.items() if "/" not in name} | {
        "observation": _describe_dictionary(observation_kinds)
    }
    sequence = {"feature": _describe_dictionary(inner), "length": "-1"}
    episode = {
        "episode_metadata": _describe_dictionary({name: _describe_feature([value]) for name, value in facts.items()}),
        "steps": {"pythonClassName": f"{_FEATURES}dataset_feature.Dataset", "sequence": sequence},
    }
    return _describe_dictionary(episode)


def _describe_dictionary(features: Mapping[str, Any]) -> dict[str, Any]:
    """Describe a dictionary of features as TensorFlow Datasets does, from the description of each feature by name."""
    return {"featuresDict": {"features": dict(features)}, "pythonClassName": f"{_FEATURES}features_dict.FeaturesDict"}


def _describe_feature(values: Any) -> dict[str, Any]:
    """Describe a feature by its values, one per row: texts, pictures of shape (rows, H, W, 3), or numbers."""
    if isinstance(values, list) and isinstance(values[0], str):
        return {"pythonClassName": f"{_FEATURES}text_feature.Text", "text": {}}
    array = np.asarray(values)
    if array.ndim > 1:
        shape = {"dimensions": [str(size) for size in array.shape[1:]]}
    else:
        shape = {}
    if array.ndim == 4:
        picture = {"dtype": "uint8", "encodingFormat": "png", "shape": shape}
        return {"image": picture, "pythonClassName": f"{_FEATURES}image_feature.Image"}
    tensor = {"dtype": str(array.dtype), "encoding": "none", "shape": shape}
    class_name = "tensor_feature.Tensor" if shape else "scalar.Scalar"
    return {"pythonClassName": f"{_FEATURES}{class_name}", "tensor": tensor}


# tf.train.Example; "entries" are those of TensorFlow's map, which is the same on the wire.
_SCHEMA = """
name: "example.proto" syntax: "proto3"
message_type { name: "Bytes" field { name: "value" number: 1 type: TYPE_BYTES label: LABEL_REPEATED } }
message_type { name: "Floats" field { name: "value" number: 1 type: TYPE_FLOAT label: LABEL_REPEATED } }
message_type { name: "Integers" field { name: "value" number: 1 type: TYPE_INT64 label: LABEL_REPEATED } }
message_type {
  name: "Feature"
  field { name: "bytes" number: 1 type: TYPE_MESSAGE type_name: ".Bytes" }
  field { name: "floats" number: 2 type: TYPE_MESSAGE type_name: ".Floats" }
  field { name: "integers" number: 3 type: TYPE_MESSAGE type_name: ".Integers" }
}
message_type {
  name: "Entry"
  field { name: "key" number: 1 type: TYPE_STRING }
  field { name: "value" number: 2 type: TYPE_MESSAGE type_name: ".Feature" }
}
message_type {
  name: "Features" field { name: "entries" number: 1 type: TYPE_MESSAGE label: LABEL_REPEATED type_name: ".Entry" }
}
message_type { name: "Example" field { name: "features" number: 1 type: TYPE_MESSAGE type_name: ".Features" } }
"""
_MESSAGES: dict[str, Any] = message_factory.GetMessages([text_format.Parse(_SCHEMA, FileDescriptorProto())])


def encode_example(columns: Mapping[str, Any]) -> bytes:
    """Encode columns of values, by feature, as a ``tf.train.Example``.

    Texts and pictures (rows, H, W, 3) are encoded as bytes, integers and booleans as int64, and other numbers as float.
    """
    example = _MESSAGES["Example"]()
    for name, values in columns.items():
        feature = example.features.entries.add(key=name).value
        if isinstance(values, list) and isinstance(values[0], str):
            feature.bytes.value.extend(text.encode() for text in values)
            continue
        array = np.asarray(values)
        if array.ndim == 4:
            feature.bytes.value.extend(encode_png(picture) for picture in array)
        elif array.dtype.kind == "f":
            feature.floats.value.extend(array.astype("f4").ravel().tolist())
        else:
            feature.integers.value.extend(array.astype("i8").ravel().tolist())
    return bytes(example.SerializeToString())


def _frame_record(record: bytes) -> bytes:
    """Frame a record of a TFRecord file: its length and its bytes, each followed by a masked CRC-32C."""
    length = struct.pack("<Q", len(record))
    return length + _compute_masked_crc(length) + record + _compute_masked_crc(record)


def _compute_masked_crc(content: bytes) -> bytes:
    """Return the masked CRC-32C of bytes, as TFRecord files store it."""
    crc = google_crc32c.value(content)
    rotated = crc >> 15 | crc << 17  # by 15 bits; the last line cuts it to 32
    return struct.pack("<I", (rotated + _CRC_MASK_DELTA) & 0xFFFFFFFF)
