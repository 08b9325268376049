"""What a session holds around its episodes' steps, as rows: segments, plan, beginnings, pictures, notes, marks."""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from minihuman.data.marks import Mark
from minihuman.data.rows import Part
from minihuman.errors import ProtocolError
from minihuman.recorded.categorical import Words
from minihuman.recorded.columns import EventColumns
from minihuman.recorded.episode import Episode, SessionLog
from minihuman.recorded.segment import Note, Segment
from minihuman.study.events import KeyPressed, Paused, Resumed, Sampled
from minihuman.study.plan import EpisodePlan
from minihuman.study.protocol import decode_logged

Who = Mapping[str, Any]  # the columns that all rows of a session share
_Row = dict[str, Any]
_TABLES = ("segments", "plan", "starts", "frames", "other_presses", "notes", "samples", "marks")


def around(
    log: SessionLog, episodes: Sequence[Episode], who: Who, marks: Sequence[Mark], *, wanted: bool = True
) -> dict[str, Part]:
    """The rows of these tables, none where the session is not wanted; beginnings and pictures of these episodes."""
    if not wanted:
        return dict.fromkeys(_TABLES, Part(0, {}))
    attempts = Counter(episode.number for episode in log.episodes)
    channels = _channels(log)
    return {
        "segments": Part.of([{**who, **_segment(segment, log)} for segment in log.segments]),
        "plan": Part.of([{**who, **_planned(plan, attempts[plan.episode + 1])} for plan in log.plan.episodes]),
        "starts": Part.of([{**who, **_place(episode), **_start(episode)} for episode in episodes]),
        "frames": Part.below([_frames(episode) for episode in episodes], **who),
        "other_presses": Part.below([_other_presses(segment, log.episodes) for segment in log.segments], **who),
        "notes": Part.of(
            [{**who, "segment": segment.number, **_note(note)} for segment in log.segments for note in segment.notes]
        ),
        "samples": Part.of(
            [
                {**who, "segment": segment.number, **row}
                for segment in log.segments
                for sampled in segment.samples
                for row in _sample(sampled, channels)
            ]
        ),
        "marks": Part.of([{**who, **msgspec.structs.asdict(mark)} for mark in marks]),
    }


def _segment(segment: Segment, log: SessionLog) -> _Row:
    plan = log.plan
    return {
        "segment": segment.number,
        "started_at": segment.started_at,
        "started_unix_ns": segment.started_unix_ns,
        "started_monotonic_ns": segment.started_monotonic_ns,
        "monotonic_clock": segment.monotonic_clock,
        "start_ns": segment.start_ns,
        "end_ns": segment.end_ns,
        "end_reason": segment.end_reason,
        "clean": segment.clean,
        "player": segment.facts.get("player", log.player),
        "window": segment.facts.get("window", ""),
        "slot": plan.participant.place + 1,
        "stratum": plan.participant.stratum,
        "overridden": plan.overridden,
        "allocation_sha256": plan.allocation_sha256 or "",
        "study_version": plan.study_version,
        "study_seed": plan.study_seed,
        "protocol_sha256": plan.protocol_sha256,
        "consent_sha256": plan.consent_sha256,
        "station": _json(segment.facts),
    }


def _planned(plan: EpisodePlan, attempts: int) -> _Row:
    return {
        "block": plan.block_name,
        "episode": plan.episode + 1,
        "episode_in_block": plan.episode_in_block + 1,
        "world": plan.world,
        "options": _json(plan.options),
        "seed": plan.seed,
        "max_steps": plan.max_steps,
        "actions": " ".join(plan.actions),
        "key_map": _json(plan.key_map.keys),
        "key_map_seed": plan.key_map.seed,
        "spare_keys": " ".join(plan.key_map.spare_keys),
        "show_keys": plan.show_keys,
        "pace": plan.pace,
        "step_period_ms": plan.step_period_ms if plan.pace == "real_time" else None,
        "noop": plan.noop or "",
        "view": plan.view,
        "palette": plan.palette,
        "record_observations": plan.record_observations,
        "attempts": attempts,
    }


def _place(episode: Episode) -> _Row:
    return {
        "block": episode.plan.block_name,
        "segment": episode.segment,
        "episode": episode.number,
        "attempt": episode.attempt,
    }


def _start(episode: Episode) -> _Row:
    x, _, z, yaw_rad = (None if np.isnan(value) else float(value) for value in episode.poses[0])
    floor = episode.start.map
    return {
        "t_ns": int(episode.t_ns[0]),
        "mission": episode.start.mission,
        "x": x,
        "z": z,
        "yaw_rad": yaw_rad,
        "unit": floor.unit if floor else "",
        "map": msgspec.json.encode(floor).decode() if floor else "",
        "end_ns": int(episode.t_ns[-1]),
    }


def _frames(episode: Episode) -> Part:
    frames = episode.frames
    columns = {name: frames.column(name) for name in ("step", "submit_ns", "flip_ns")}
    return Part(len(frames), _place(episode) | columns)


def _other_presses(segment: Segment, episodes: Sequence[Episode]) -> Part:
    """The keys that moved while no episode ran: those of a segment that are in none of its episodes."""
    keys, at = segment.keys, 0
    outside = np.ones(len(keys), bool)
    for episode in episodes:
        if episode.segment == segment.number and len(episode.keys):
            at = _where(episode.keys, keys, at)
            outside[at : at + len(episode.keys)] = False
            at += len(episode.keys)
    rows = np.flatnonzero(outside)
    names = ("t_ns", "phase", "key", "symbol", "down", "verdict")
    columns = {name: _at(keys.column(name), rows) for name in names}
    return Part(len(rows), {"segment": segment.number} | columns)


def _at(column: Any, rows: NDArray[np.int64]) -> Any:
    return Words(column.codes[rows], column.words) if isinstance(column, Words) else column[rows]


def _where(some: EventColumns[KeyPressed], keys: EventColumns[KeyPressed], begin: int) -> int:
    """Where a segment's keys have an episode's, which follow each other: by time, then, among equal ones, by what."""
    times = keys.column("t_ns")
    at = begin + int(np.searchsorted(times[begin:], some[0].t_ns))
    while keys[at] != some[0] or not np.array_equal(times[at : at + len(some)], some.column("t_ns")):
        at += 1
    return at


def _note(note: Note) -> _Row:
    match note:
        case Paused():
            return {"t_ns": note.t_ns, "kind": "pause", "note": note.reason}
        case Resumed():
            return {"t_ns": note.t_ns, "kind": "resume", "note": ""}
    return {"t_ns": note.t_ns, "kind": note.kind, "note": note.text}


def _sample(sampled: Sampled, channels: Mapping[str, Sequence[str]]) -> list[_Row]:
    """A row a number; one without a number where there is none."""
    names = channels.get(sampled.device, ())
    shared = {"t_ns": sampled.t_ns, "device": sampled.device, "said": sampled.text}
    if not sampled.values:
        return [shared | {"channel": "", "value": None}]
    return [
        shared | {"channel": names[place] if place < len(names) else str(place + 1), "value": value}
        for place, value in enumerate(sampled.values)
    ]


def _channels(log: SessionLog) -> dict[str, tuple[str, ...]]:
    """What the protocol calls the numbers of each device's samples."""
    if not any(segment.samples for segment in log.segments):
        return {}
    try:
        return {device.name: device.channels for device in decode_logged(log.plan.protocol_toml).devices}
    except ProtocolError:
        return {}


def _json(value: Any) -> str:
    return json.dumps(value, sort_keys=True)
