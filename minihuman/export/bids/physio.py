"""What devices gave as BIDS physio: a recording a device and run, each sample with the moment it was taken."""

import gzip
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from minihuman.export.bids.files import label, write_json, write_tsv
from minihuman.recorded.segment import Segment
from minihuman.study.devices import Device
from minihuman.study.events import Sampled

_SAID = "said"


def write_physio(
    stem: str, folder: Path, run: int, task: Mapping[str, Any], segment: Segment, devices: Mapping[str, Device]
) -> list[Path]:
    """Write a segment's samples; ``stem`` is subject, session and task. Gives its recordings."""
    of_device: defaultdict[str, list[Sampled]] = defaultdict(list)
    for sampled in segment.samples:
        of_device[sampled.device].append(sampled)
    return [
        _write(folder / f"{stem}_run-{run}_recording-{label(name)}_physio", task, segment, samples, devices.get(name))
        for name, samples in of_device.items()
    ]


def _write(
    path: Path, task: Mapping[str, Any], segment: Segment, samples: Sequence[Sampled], device: Device | None
) -> Path:
    names = _channels(samples, device)
    said = [_SAID] if any(sampled.text for sampled in samples) else []
    rows: list[dict[str, Any]] = [
        {"timestamp": (sampled.t_ns - segment.start_ns) * 1e-9, _SAID: sampled.text}
        | dict(zip(names, sampled.values, strict=False))
        for sampled in samples
    ]
    columns = ["timestamp", *names, *said]
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
        described[name] = {"Description": name} | ({"Units": units[name]} if units.get(name) else {})
    if said:
        described[_SAID] = {"Description": "What the device said in words."}
    facts = {
        "SamplingFrequency": (len(rows) - 1) / lasted_s if lasted_s > 0 else 1.0,  # the mean; timestamps are exact
        "StartTime": rows[0]["timestamp"],
        "Columns": columns,
        "Manufacturer": "" if device is None else device.source,
    }
    write_json(path.with_name(f"{path.name}.json"), dict(task) | facts | described)
    return packed


def _channels(samples: Sequence[Sampled], device: Device | None) -> list[str]:
    """What each of a sample's numbers is called; a number that the protocol does not name has its place as name."""
    most = max(len(sampled.values) for sampled in samples)
    named = () if device is None else device.channels
    return [named[place] if place < len(named) else f"channel_{place + 1}" for place in range(most)]
