"""The files of a BIDS dataset for one session: tables, motion, physio and phenotype.

Each file is a TSV table with a JSON sidecar. Motion is one recording per unit of length. A phenotype row is identified
only by participant and session, so an item asked twice in a session has a column for each time: `mental`, `mental_2`.
"""

import gzip
import json
import re
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from minihuman import __version__
from minihuman.activities.questions.plan import QuestionsPlan
from minihuman.dataset.table_types import guard_text
from minihuman.errors import ExportError
from minihuman.experiment.machine.events import Answered, Sampled
from minihuman.experiment.protocol.specs import DeviceSpec
from minihuman.log.model.session_log import EpisodeLog, Segment, SessionLog

MISSING = "n/a"
_S_PER_NS = 1e-9
_MAX_DECIMAL = 1e9  # larger numbers are written with the digits that a double needs


def make_label(text: str) -> str:
    """Turn a text into a BIDS label, which has only letters and digits."""
    return re.sub(r"[^A-Za-z0-9]", "", text)


def make_subject_label(participant: str, participants: dict[str, str]) -> str:
    """Return a participant's label, e.g. "sub-07", and record the participant under it in ``participants``.

    Raises:
        ExportError: if another participant's code has the same label.
    """
    name = "sub-" + make_label(participant.removeprefix("sub-"))
    if participants.setdefault(name, participant) != participant:
        raise ExportError(
            f"participants {participants[name]!r} and {participant!r} would both be {name} in BIDS; rename one of them"
        )
    return name


def write_tsv(path: Path, columns: Sequence[str], rows: Sequence[Mapping[str, Any]], *, header: bool = True) -> Path:
    """Write rows as tab-separated text and return the path; a missing value is written as "n/a".

    Args:
        path: the file, whose folder is created if it is missing.
        columns: the columns, in order; other cells of a row are not written.
        rows: a mapping of column to cell for each row.
        header: whether the first line has the columns' names.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    lines: list[str] = []
    if header:
        lines.append("\t".join(columns))
    lines += ["\t".join(_format_cell(row.get(column)) for column in columns) for row in rows]
    path.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8", newline="\n")
    return path


def write_json(path: Path, content: Mapping[str, Any]) -> Path:
    """Write a JSON object without the fields that are None, "" or empty, and return its path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    present = {name: part for name, part in content.items() if part not in (None, "", [], {})}
    path.write_text(json.dumps(present, indent=2, ensure_ascii=False) + "\n", encoding="utf-8", newline="\n")
    return path


def _format_cell(cell: Any) -> str:
    """Return a cell's text as BIDS requires: "n/a" if missing, plain decimals, and neither tabs nor line breaks.

    A text that a spreadsheet would run as a formula gets an apostrophe before it.
    """
    if cell is None or cell == "" or cell != cell:  # NaN is unequal to itself
        return MISSING
    if isinstance(cell, bool):
        return "true" if cell else "false"
    if isinstance(cell, float):
        if abs(cell) < _MAX_DECIMAL:
            return f"{cell:.9f}".rstrip("0").rstrip(".")
        return repr(cell)
    return guard_text(re.sub(r"[\t\r\n]+", " ", str(cell))) or MISSING


_SYSTEMS = {"cell": "grid", "m": "room"}  # a map's unit: the tracking system's label
_CHANNELS = (
    ("x", "x", "POS", "agent", "To the right."),
    ("z", "z", "POS", "agent", "Down the page."),
    ("yaw", "y", "ORNT", "agent", "Heading about the upward axis, 0 along +x, counter-clockwise from above."),
    ("latency", "n/a", "LATENCY", "n/a", "When it stood there, since the run's first moment."),
)
_FRAME = {
    "Description": "The world's own: x to the right, y up, z down the page.",
    "SpatialAxes": "RUB",
    "RotationRule": "right-hand",
    "RotationOrder": "YXZ",
}


def write_motion(
    stem: str, folder: Path, run: int, task: dict[str, Any], segment: Segment, episodes: Sequence[EpisodeLog]
) -> list[Path]:
    """Write the agent's paths in a segment, and return the files of positions, one per unit of length.

    Args:
        stem: the subject, session and task, with which the files' names begin.
        folder: the folder of the files.
        run: the number of the run.
        task: the facts about the task for the sidecars.
        segment: the segment of the session.
        episodes: the segment's episodes.
    """
    recordings = []
    for unit, system in _SYSTEMS.items():
        rows = _list_motion_rows(segment, episodes, unit)
        if not rows:
            continue
        name = f"{stem}_tracksys-{system}_run-{run}"
        columns = [channel for channel, *_ in _CHANNELS]
        recordings.append(write_tsv(folder / f"{name}_motion.tsv", columns, rows, header=False))
        lasted_s = rows[-1]["latency"] - rows[0]["latency"]
        write_json(
            folder / f"{name}_motion.json",
            task | _build_tracking_facts(system, _compute_mean_rate_hz(len(rows), lasted_s), lasted_s),
        )
        write_tsv(folder / f"{name}_channels.tsv", _CHANNEL_COLUMNS, _describe_channels(unit))
        frame = {"Description": "What positions and headings are told in.", "Levels": {"world": _FRAME}}
        write_json(folder / f"{name}_channels.json", {"reference_frame": frame})
    return recordings


def _list_motion_rows(segment: Segment, episodes: Sequence[EpisodeLog], unit: str) -> list[dict[str, float]]:
    """Return a row for each known pose in the episodes whose maps are in a unit, with its time in the segment."""
    rows = []
    for episode in episodes:
        floor = episode.start.map
        if not floor or floor.unit != unit:
            continue
        for t_ns, pose in zip(episode.t_ns, episode.poses, strict=True):
            if not np.isnan(pose).any():
                x, _, z, yaw = pose
                latency_s = int(t_ns - segment.start_ns) * _S_PER_NS
                rows.append({"x": float(x), "z": float(z), "yaw": float(yaw), "latency": latency_s})
    return rows


_CHANNEL_COLUMNS = ("name", "component", "type", "tracked_point", "units", "reference_frame", "description")


def _describe_channels(unit: str) -> list[dict[str, str]]:
    """Describe the channels of a motion recording whose positions have the given unit."""
    units = {"POS": unit, "ORNT": "rad", "LATENCY": "s"}
    frames = {"POS": "world", "ORNT": "world", "LATENCY": ""}
    return [
        {
            "name": channel,
            "component": component,
            "type": kind,
            "tracked_point": point,
            "units": units[kind],
            "reference_frame": frames[kind],
            "description": meaning,
        }
        for channel, component, kind, point, meaning in _CHANNELS
    ]


def _compute_mean_rate_hz(n_samples: int, lasted_s: float) -> float:
    """Return the mean rate of samples in hertz, between the first and the last sample; 1 if no time passed."""
    if lasted_s <= 0:
        return 1.0
    return (n_samples - 1) / lasted_s


def _build_tracking_facts(system: str, rate_hz: float, lasted_s: float) -> dict[str, Any]:
    """Return the sidecar's facts about a motion recording of one tracked point.

    Args:
        system: the name of the tracking system: "grid" or "room".
        rate_hz: the mean rate of the samples.
        lasted_s: the time from the first sample to the last.
    """
    return {
        "SamplingFrequency": rate_hz,
        "SamplingFrequencyEffective": rate_hz,
        "TrackingSystemName": system,
        "SoftwareVersions": f"minihuman {__version__}",
        "Manufacturer": "minihuman",
        "RecordingType": "discontinuous",
        "RecordingDuration": lasted_s,
        "MotionChannelCount": 3,
        "TrackedPointsCount": 1,
        "POSChannelCount": 2,
        "ORNTChannelCount": 1,
        "LATENCYChannelCount": 1,
    }


_TEXT_COLUMN = "said"  # what a device measured in words


def write_physio(
    stem: str, folder: Path, run: int, task: Mapping[str, Any], segment: Segment, devices: Mapping[str, DeviceSpec]
) -> list[Path]:
    """Write the devices' samples in a segment, and return the compressed tables, one per device.

    Args:
        stem: the subject, session and task, with which the files' names begin.
        folder: the folder of the files.
        run: the number of the run.
        task: the facts about the task for the sidecars.
        segment: the segment of the session.
        devices: the protocol's devices, by name.
    """
    samples_by_device: defaultdict[str, list[Sampled]] = defaultdict(list)
    for sampled in segment.samples:
        samples_by_device[sampled.device].append(sampled)
    return [
        _write_recording(
            folder / f"{stem}_run-{run}_recording-{make_label(name)}_physio", task, segment, samples, devices.get(name)
        )
        for name, samples in samples_by_device.items()
    ]


def _write_recording(
    path: Path, task: Mapping[str, Any], segment: Segment, samples: Sequence[Sampled], device: DeviceSpec | None
) -> Path:
    """Write a device's samples as a compressed table with a sidecar, both at ``path`` plus a suffix; return the table.

    ``device`` names the channels and their units; None if the protocol does not have the device.
    """
    names = _name_channels(samples, device)
    text_columns = []
    if any(sampled.text for sampled in samples):
        text_columns = [_TEXT_COLUMN]
    rows: list[dict[str, Any]] = [
        {"timestamp": (sampled.t_ns - segment.start_ns) * _S_PER_NS, _TEXT_COLUMN: sampled.text}
        | dict(zip(names, sampled.values, strict=False))
        for sampled in samples
    ]
    columns = ["timestamp", *names, *text_columns]
    plain = write_tsv(path.with_name(f"{path.name}.tsv"), columns, rows, header=False)
    packed = plain.with_name(f"{plain.name}.gz")
    packed.write_bytes(gzip.compress(plain.read_bytes(), mtime=0))  # the same samples are the same file
    plain.unlink()
    lasted_s = rows[-1]["timestamp"] - rows[0]["timestamp"]
    units = dict(zip(names, device.units if device is not None else (), strict=False))
    described: dict[str, Any] = {
        "timestamp": {"Description": "When the sample was taken, since the run's first moment.", "Units": "s"}
    }
    for name in names:
        described[name] = {"Description": name}
        if units.get(name):
            described[name]["Units"] = units[name]
    if text_columns:
        described[_TEXT_COLUMN] = {"Description": "What the device said in words."}
    facts = {
        "SamplingFrequency": _compute_mean_rate_hz(len(rows), lasted_s),  # timestamps are exact
        "StartTime": rows[0]["timestamp"],
        "Columns": columns,
        "Manufacturer": "" if device is None else device.plugin,
    }
    write_json(path.with_name(f"{path.name}.json"), dict(task) | facts | described)
    return packed


def _name_channels(samples: Sequence[Sampled], device: DeviceSpec | None) -> list[str]:
    """Return a name for each number of a sample; a number that the protocol does not name is named by its position."""
    n_channels = max(len(sampled.values) for sampled in samples)
    names: list[str] = []
    if device is not None:
        names += device.channels
    names += [f"channel_{place + 1}" for place in range(len(names), n_channels)]
    return names[:n_channels]


_IDS = ("participant_id", "session_id")


class Phenotype:
    """The answers of a dataset's sessions by questionnaire; parts with the same name belong to one questionnaire."""

    def __init__(self) -> None:
        self._rows: dict[str, list[dict[str, Any]]] = {}
        self._meaning: dict[str, dict[str, Any]] = {}  # of each questionnaire's columns
        self._names: dict[str, str] = {}  # what each label stands for

    def add(self, log: SessionLog, subject: str, session: str) -> None:
        """Add a session's answers, under the BIDS labels of the subject and the session.

        If an item was asked again in a part, only the last answer is kept.
        """
        last_answers = {
            (event.part, event.item): event
            for segment in log.segments
            for event in segment.part_events
            if isinstance(event, Answered)
        }
        occurrences = Counter[str]()  # of each questionnaire in the session
        rows: dict[str, dict[str, Any]] = {}
        for number, part in enumerate(log.plan.parts):
            if not isinstance(part.plan, QuestionsPlan):
                continue
            occurrences[part.name] += 1
            self._describe(part.name, part.plan, occurrences[part.name])
            answers = {
                item: _decode_answer(event) for (of_part, item), event in last_answers.items() if of_part == number
            }
            if answers:
                row = rows.setdefault(part.name, dict(zip(_IDS, (subject, session), strict=True)))
                row |= {_name_column(item, occurrences[part.name]): answer for item, answer in answers.items()}
        for name, row in rows.items():
            self._rows.setdefault(name, []).append(row)

    def write(self, out: Path) -> tuple[Path, ...]:
        """Write every questionnaire that has an answer, with the meaning of its columns; return the folders written."""
        folder = out / "phenotype"
        for name, rows in self._rows.items():
            meaning = self._meaning[name]
            columns = [*_IDS, *(column for column in meaning if column != "MeasurementToolMetadata")]
            write_tsv(folder / f"{make_label(name)}.tsv", columns, rows)
            session = {"session_id": {"Description": "The session, as in the name of its folder."}}
            write_json(folder / f"{make_label(name)}.json", session | meaning)
        if not self._rows:
            return ()
        return (folder,)

    def _describe(self, name: str, plan: QuestionsPlan, occurrence: int) -> None:
        """Record the meaning of the columns for one occurrence of a questionnaire in a session, 1 for the first.

        If groups see different wordings, the wording of the group that is added first is kept.

        Raises:
            ExportError: if another questionnaire's name makes the same label.
        """
        if self._names.setdefault(make_label(name), name) != name:
            raise ExportError(
                f"questions {self._names[make_label(name)]!r} and {name!r} would share a file name in BIDS; rename one "
                "of them"
            )
        meaning = self._meaning.setdefault(name, {"MeasurementToolMetadata": {"Description": plan.title or name}})
        for item in plan.items:
            again = "" if occurrence == 1 else f" (time {occurrence} in the session)"
            described: dict[str, Any] = {}
            if item.options:
                described["Levels"] = dict(zip(map(str, item.all_codes), item.options, strict=False))
            if item.unit:
                described["Units"] = item.unit
            for asked_item, text in item.asked.items():
                meaning.setdefault(_name_column(asked_item, occurrence), {"Description": f"{text}{again}", **described})


def _name_column(item: str, occurrence: int) -> str:
    """Return the name of an item's column, which differs from the columns that BIDS requires.

    ``occurrence`` is 1 for the first time that the item is asked in the session.
    """
    name = item
    if item in _IDS:
        name = f"item_{item}"
    if occurrence > 1:
        name += f"_{occurrence}"
    return name


def _decode_answer(event: Answered) -> Any:
    """Return an answer as the option's code, the number or the text; several codes are the text of a JSON list."""
    answer: Any = json.loads(event.value)
    if isinstance(answer, list | Mapping):
        return json.dumps(answer, ensure_ascii=False)
    return answer
