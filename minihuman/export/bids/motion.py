"""Paths as BIDS motion: where the agent stood after each reset and step, a recording for each unit of length."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from minihuman import __version__
from minihuman.export.bids.files import write_json, write_tsv
from minihuman.recorded.episode import Episode
from minihuman.recorded.segment import Segment

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
    stem: str, folder: Path, run: int, task: dict[str, Any], segment: Segment, episodes: Sequence[Episode]
) -> list[Path]:
    """Write a segment's paths; ``stem`` is subject, session and task. Gives its recordings."""
    written = []
    for unit, system in _SYSTEMS.items():
        theirs = [episode for episode in episodes if episode.start.map and episode.start.map.unit == unit]
        poses = [(t_ns, pose) for episode in theirs for t_ns, pose in zip(episode.t_ns, episode.poses, strict=True)]
        poses = [(t_ns, pose) for t_ns, pose in poses if not np.isnan(pose).any()]
        if not poses:
            continue
        name = f"{stem}_tracksys-{system}_run-{run}"
        rows = [
            {"x": float(x), "z": float(z), "yaw": float(yaw), "latency": int(t_ns - segment.start_ns) * 1e-9}
            for t_ns, (x, _, z, yaw) in poses
        ]
        columns = [channel for channel, *_ in _CHANNELS]
        written.append(write_tsv(folder / f"{name}_motion.tsv", columns, rows, header=False))
        lasted_s = rows[-1]["latency"] - rows[0]["latency"]
        effective = (len(rows) - 1) / lasted_s if lasted_s > 0 else 1.0
        write_json(folder / f"{name}_motion.json", task | _facts(system, effective, lasted_s))
        units = {"POS": unit, "ORNT": "rad", "LATENCY": "s"}
        write_tsv(
            folder / f"{name}_channels.tsv",
            ["name", "component", "type", "tracked_point", "units", "reference_frame", "description"],
            [
                {
                    "name": channel,
                    "component": component,
                    "type": kind,
                    "tracked_point": point,
                    "units": units[kind],
                    "reference_frame": "" if kind == "LATENCY" else "world",
                    "description": meaning,
                }
                for channel, component, kind, point, meaning in _CHANNELS
            ],
        )
        frame = {"Description": "What positions and headings are told in.", "Levels": {"world": _FRAME}}
        write_json(folder / f"{name}_channels.json", {"reference_frame": frame})
    return written


def _facts(system: str, effective: float, lasted_s: float) -> dict[str, Any]:
    return {
        "SamplingFrequency": effective,
        "SamplingFrequencyEffective": effective,
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
