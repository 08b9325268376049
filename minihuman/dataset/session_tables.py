"""Build every table's rows from one session: steps, presses, keys, episodes, and all that was logged around them.

Stored observations do not become rows; exporters read them.
"""

import json
import math
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from minihuman.dataset.activity_tables import ActivityTable, TableRow, list_activity_tables, list_tables_of_topics
from minihuman.dataset.annotations import Annotation
from minihuman.dataset.episode_columns import compute_episode_columns
from minihuman.dataset.measures import KeyTally, response_ms, summarize_key_use, visible_effect
from minihuman.dataset.rows import RowBatch, SessionTables
from minihuman.dataset.selection import SelectedSession, find_practice_blocks, format_version, summarize_session
from minihuman.dataset.session_columns import LINKS, MODEL_CALLS, OTHER_INPUTS, PARTS
from minihuman.dataset.session_measures import (
    MeasureRow,
    SessionMeasures,
    encode_map,
    find_place_unit,
    locate_episode,
)
from minihuman.errors import ProtocolError
from minihuman.experiment.machine.events import (
    AxisMoved,
    Linked,
    ModelCall,
    PartEnded,
    PartStarted,
    Paused,
    PointerUsed,
    Resumed,
    Sampled,
    TextTyped,
)
from minihuman.experiment.plan.session_plan import EpisodePlan
from minihuman.experiment.protocol.protocol import decode_logged_protocol
from minihuman.log import topics
from minihuman.log.model.event_columns import NO_ACTION, CategoricalTexts
from minihuman.log.model.session_log import EpisodeLog, Segment, SegmentNote, SessionLog

SessionKey = Mapping[str, Any]  # the columns that all rows of a session share
RowMaker = Callable[[Any, SessionLog], TableRow | None]
_CONTEXT_TABLES = ("segments", "plan", "starts", "frames", "other_presses", "notes", "samples", "marks")


def build_context_rows(
    log: SessionLog,
    episodes: Sequence[EpisodeLog],
    session_key: SessionKey,
    marks: Sequence[Annotation],
    *,
    is_selected: bool = True,
) -> dict[str, RowBatch]:
    """Build the rows of the tables about a session's circumstances, such as segments, plan, notes and samples.

    The tables starts and frames have rows of ``episodes`` only. All tables are empty if the session is not selected.
    ``session_key`` holds the columns that all rows share, and ``marks`` the annotations.
    """
    if not is_selected:
        return dict.fromkeys(_CONTEXT_TABLES, RowBatch(0, {}))
    attempts = Counter(episode.number for episode in log.episodes)
    channels = _read_channel_names(log)
    rows: dict[str, list[TableRow]] = {
        "segments": [_build_segment_row(segment, log) for segment in log.segments],
        "plan": [_build_plan_row(plan, attempts[plan.episode + 1]) for plan in log.plan.episodes],
        "starts": [locate_episode(episode) | _build_start_row(episode) for episode in episodes],
        "notes": [],
        "samples": [],
        "marks": [msgspec.structs.asdict(mark) for mark in marks],
    }
    for segment in log.segments:
        segment_key = {"segment": segment.number}
        rows["notes"] += [segment_key | _build_note_row(note) for note in segment.notes]
        for sampled in segment.samples:
            rows["samples"] += [segment_key | row for row in _build_sample_rows(sampled, channels)]
    frames = [_build_frame_rows(episode) for episode in episodes]
    other_presses = [_build_other_press_rows(segment, log.episodes) for segment in log.segments]
    batches = {}
    for name, table_rows in rows.items():
        batches[name] = RowBatch.of([{**session_key, **row} for row in table_rows])
    batches["frames"] = RowBatch.stack(frames, **session_key)
    batches["other_presses"] = RowBatch.stack(other_presses, **session_key)
    return batches


def _build_segment_row(segment: Segment, log: SessionLog) -> TableRow:
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
        "station": _encode_json(segment.facts),
    }


def _build_plan_row(plan: EpisodePlan, attempts: int) -> TableRow:
    return {
        "block": plan.block_name,
        "episode": plan.episode + 1,
        "episode_in_block": plan.episode_in_block + 1,
        "world": plan.world,
        "options": _encode_json(plan.options),
        "seed": plan.seed,
        "max_steps": plan.max_steps,
        "actions": " ".join(plan.actions),
        "key_map": _encode_json(plan.key_map.keys),
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


def _build_start_row(episode: EpisodeLog) -> TableRow:
    x, y, z, yaw_rad = [None if math.isnan(number) else number for number in episode.poses[0].tolist()]
    return {
        "t_ns": int(episode.t_ns[0]),
        "mission": episode.start.mission,
        "x": x,
        "y": y,
        "z": z,
        "yaw_rad": yaw_rad,
        "unit": find_place_unit(episode),
        "map": encode_map(episode.start.map),
        "end_ns": int(episode.t_ns[-1]),
    }


def _build_frame_rows(episode: EpisodeLog) -> RowBatch:
    frames = episode.frames
    columns = {name: frames.column(name) for name in ("step", "submit_ns", "flip_ns")}
    return RowBatch(len(frames), locate_episode(episode) | columns)


def _build_other_press_rows(segment: Segment, episodes: Sequence[EpisodeLog]) -> RowBatch:
    """Return a segment's key events that happened outside its episodes; ``episodes`` are those of the whole session."""
    keys = segment.keys
    outside = np.ones(len(keys), bool)
    for episode in episodes:
        if episode.segment == segment.number:
            outside[keys.place(episode.keys)] = False
    rows = np.flatnonzero(outside)
    names = ("t_ns", "phase", "key", "symbol", "down", "verdict")
    columns = {name: keys.column(name)[rows] for name in names}
    return RowBatch(len(rows), {"segment": segment.number} | columns)


def _build_note_row(note: SegmentNote) -> TableRow:
    match note:
        case Paused():
            return {"t_ns": note.t_ns, "kind": "pause", "note": note.reason}
        case Resumed():
            return {"t_ns": note.t_ns, "kind": "resume", "note": ""}
    return {"t_ns": note.t_ns, "kind": note.kind, "note": note.text}


def _build_sample_rows(sampled: Sampled, channels: Mapping[str, Sequence[str]]) -> list[TableRow]:
    """Build a row for each number of a sample; a single row without a number if the sample has none.

    ``channels`` are the channel names by device; a number without a name has its position, from 1, as its channel.
    """
    names = channels.get(sampled.device, ())
    shared = {"t_ns": sampled.t_ns, "device": sampled.device, "said": sampled.text}
    if not sampled.values:
        return [shared | {"channel": "", "value": None}]
    rows = []
    for index, number in enumerate(sampled.values):
        channel = names[index] if index < len(names) else str(index + 1)
        rows.append(shared | {"channel": channel, "value": number})
    return rows


def _read_channel_names(log: SessionLog) -> dict[str, tuple[str, ...]]:
    """Return the protocol's names for the numbers in samples, by device; {} without samples or a readable protocol."""
    if not any(segment.samples for segment in log.segments):
        return {}
    try:
        return {device.name: device.channels for device in decode_logged_protocol(log.plan.protocol_toml).devices}
    except ProtocolError:
        return {}


def _encode_json(value: Any) -> str:
    return json.dumps(value, sort_keys=True)


_MS_PER_NS = 1e-6


def build_activity_rows(
    log: SessionLog, session_key: Mapping[str, Any], *, is_selected: bool = True
) -> dict[str, RowBatch]:
    """Build the rows, by table, that come from events or a whole session; no table has any if it is not selected."""
    tables = [table for table in (*_EVENT_TABLES, *list_activity_tables()) if table.episode_row is None]
    makers = defaultdict[type, list[tuple[str, RowMaker]]](list)  # by the class of an event
    for table in tables:
        for event_type, maker in table.event_rows.items():
            makers[event_type].append((table.name, maker))
    rows: dict[str, list[TableRow]] = {table.name: [] for table in tables}
    segments = log.segments
    if not is_selected:
        segments = ()
    for segment in segments:
        for event in segment.part_events:
            for name, make in makers.get(type(event), ()):
                row = make(event, log)
                if row is not None:
                    rows[name].append({**session_key, "segment": segment.number, "t_ns": event.t_ns, **row})
    for table in tables:
        if is_selected and table.session_rows is not None:
            rows[table.name] += [{**session_key, **row} for row in table.session_rows(log)]
    return {name: RowBatch.of(batch) for name, batch in rows.items()}


def build_episode_rows(episodes: Sequence[EpisodeLog], session_key: SessionKey) -> dict[str, RowBatch]:
    """Build the rows of the tables that activity kinds fill from episodes, by table name."""
    return {
        table.name: RowBatch.of(list(_build_kind_rows(table, episodes, session_key)))
        for table in list_activity_tables()
        if table.episode_row is not None
    }


def _build_kind_rows(
    table: ActivityTable, episodes: Sequence[EpisodeLog], session_key: SessionKey
) -> Iterator[TableRow]:
    assert table.episode_row is not None  # as the caller selects
    for episode in episodes:
        row = table.episode_row(episode)
        if row is not None:
            yield {**session_key, **locate_episode(episode), **row}


def _build_part_start_row(event: PartStarted, log: SessionLog) -> TableRow:
    return {"part": event.part + 1, "what": "started", "kind": event.kind, "name": event.name, "next": None}


def _build_part_end_row(event: PartEnded, log: SessionLog) -> TableRow:
    part = log.plan.parts[event.part]
    return {"part": event.part + 1, "what": event.end, "kind": part.kind, "name": part.name, "next": event.next + 1}


def _build_text_row(event: TextTyped, log: SessionLog) -> TableRow:
    return {"what": "typed", "text": event.text, "target": "", "x": None, "y": None, "along": None}


def _build_pointer_row(event: PointerUsed, log: SessionLog) -> TableRow:
    return {
        "what": event.what,
        "text": "",
        "target": event.target,
        "x": event.x,
        "y": event.y,
        "along": event.along,
    }


def _build_axis_row(event: AxisMoved, log: SessionLog) -> TableRow:
    return {"what": "axis", "text": "", "target": event.axis, "along": event.value, "x": None, "y": None}


def _build_link_row(event: Linked, log: SessionLog) -> TableRow:
    return {
        "offset_ms": event.offset_ns * _MS_PER_NS,
        "error_ms": event.error_ns * _MS_PER_NS,
        "rtt_ms": event.rtt_ns * _MS_PER_NS,
        "least_rtt_ms": event.least_rtt_ns * _MS_PER_NS,
        "drift_ppm": event.drift_ppm,
    }


_CALL_FIELDS = (
    *("call", "state", "step", "screen", "attempt", "provider", "model", "temperature", "prompt_tokens"),
    *("completion_tokens", "price", "latency_ms", "answer", "reasoning", "finish_reason", "verdict", "reading"),
    *("error", "prompt_sha256", "picture_sha256"),
)


def _build_call_row(event: ModelCall, log: SessionLog) -> TableRow | None:
    if event.state == "asked":
        return None
    return {"episode": event.episode + 1, **{name: getattr(event, name) for name in _CALL_FIELDS}}


_EVENT_TABLES = (
    ActivityTable("parts", PARTS, {PartStarted: _build_part_start_row, PartEnded: _build_part_end_row}),
    ActivityTable(
        "other_inputs",
        OTHER_INPUTS,
        {TextTyped: _build_text_row, PointerUsed: _build_pointer_row, AxisMoved: _build_axis_row},
    ),
    ActivityTable("links", LINKS, {Linked: _build_link_row}),
    ActivityTable("model_calls", MODEL_CALLS, {ModelCall: _build_call_row}),
)

NO_EPISODE_INCLUDED = "no episode counts"


def build_session_tables(session: SelectedSession, measured: SessionMeasures) -> SessionTables:
    """Build one session's rows of every table from the selected episodes.

    Excluded rows stay in the tables, with the reason in ``exclusion_reason``. Rows of blocks and participants aggregate
    the included episodes; rows of keys cover all episodes that were begun in the blocks of the selected episodes.
    """
    log = session.log
    session_key: MeasureRow = {
        "study": log.plan.study,
        "version": format_version(log.plan),
        "participant": log.plan.participant.id,
        "group": log.plan.participant.group,
        "session": log.plan.session,
    }
    indices = [index for index, is_selected in enumerate(session.selected) if is_selected]
    played = [log.episodes[index] for index in indices]
    blocks = dict.fromkeys(episode.plan.block_name for episode in played)
    rows: dict[str, list[MeasureRow]] = {
        "keys": _build_key_rows(measured.select_tallies(blocks.keys())),
        "episodes": [_build_episode_row(session, measured, index) for index in indices],
        "blocks": [_build_block_row(session, measured, indices, name) for name in blocks],
        "participants": [_build_participant_row(session, measured, indices)] if session.is_selected else [],
    }
    batches = {
        "steps": RowBatch.stack([_build_step_rows(episode) for episode in played], **session_key),
        "presses": RowBatch.stack([_build_press_rows(episode) for episode in played], **session_key),
    }
    for name, table_rows in rows.items():
        batches[name] = RowBatch.of([session_key | row for row in table_rows])
    batches |= build_context_rows(log, played, session_key, session.marks, is_selected=session.is_selected)
    batches |= build_activity_rows(log, session_key, is_selected=session.is_selected)
    batches |= build_episode_rows(played, session_key)
    return SessionTables(batches)


def _build_episode_row(session: SelectedSession, measured: SessionMeasures, index: int) -> MeasureRow:
    """Build the row of the episode with the given index among all of the session's episodes."""
    columns = {
        "tags": " ".join(sorted(session.tags[index])),
        "exclusion_reason": session.session_reason or session.reasons[index],
    }
    return measured.rows[index] | compute_episode_columns(session.log.episodes[index]) | columns


def _build_block_row(
    session: SelectedSession, measured: SessionMeasures, indices: Sequence[int], name: str
) -> MeasureRow:
    """Build a block's row from its included episodes among those with the given indices."""
    included = [index for index in indices if not session.reasons[index] and measured.rows[index]["block"] == name]
    return (
        {"block": name}
        | measured.aggregate(included)
        | {"exclusion_reason": _choose_exclusion_reason(session, counts=bool(included))}
    )


def _build_participant_row(session: SelectedSession, measured: SessionMeasures, indices: Sequence[int]) -> MeasureRow:
    """Build the participant's row from the included episodes among ``indices`` that are in no practice block."""
    practice = find_practice_blocks(session.log.plan)
    analysed = [
        index for index in indices if not session.reasons[index] and measured.rows[index]["block"] not in practice
    ]
    return (
        summarize_session(session.log)
        | measured.aggregate(analysed)
        | {"exclusion_reason": _choose_exclusion_reason(session, counts=session.counts)}
    )


def _choose_exclusion_reason(session: SelectedSession, *, counts: bool) -> str:
    """Return the reason to exclude a row, "" if none; ``counts`` says whether the row has anything that is included."""
    if session.session_reason:
        return session.session_reason
    if counts:
        return ""
    return NO_EPISODE_INCLUDED


def _build_step_rows(episode: EpisodeLog) -> RowBatch:
    n = len(episode.actions)
    columns = {
        "step": np.arange(1, n + 1),
        "t_ns": episode.t_ns[1:],
        "t_s": episode.t_ns[1:] / 1e9,
        "action": CategoricalTexts(episode.actions, episode.start.action_names),
        "key": CategoricalTexts.of(episode.step_keys),
        "reward": episode.rewards,
        "reaction_ms": episode.rt_ms,
        "response_ms": response_ms(episode),
        "visible_effect": visible_effect(episode),
        "x": episode.poses[1:, 0],
        "y": episode.poses[1:, 1],
        "z": episode.poses[1:, 2],
        "unit": find_place_unit(episode),
        "yaw_rad": episode.poses[1:, 3],
        "terminated": episode.terminated,
        "truncated": episode.truncated,
        "action_vector": _encode_steps(n, episode.action_vectors),
        "info": _encode_steps(n, episode.infos),
    }
    return RowBatch(n, locate_episode(episode) | columns)


def _encode_steps(n: int, records: NDArray[np.float64] | Sequence[Any] | None) -> CategoricalTexts:
    """Encode the records of n steps as JSON; all texts are empty if the log has no such records."""
    if records is None:
        return CategoricalTexts(np.zeros(n, np.int64), ("",))
    if isinstance(records, np.ndarray):
        records = records.tolist()
    return CategoricalTexts.of([_encode_json(record) for record in records])


def _build_press_rows(episode: EpisodeLog) -> RowBatch:
    keys = episode.keys
    columns = {
        "t_ns": keys.column("t_ns"),
        "t_s": keys.column("t_ns") / 1e9,
        "key": keys.column("key"),
        "down": keys.column("down"),
        "action": CategoricalTexts(keys.column("action") - NO_ACTION, ("", *episode.start.action_names)),
        "verdict": keys.column("verdict"),
    }
    return RowBatch(len(keys), locate_episode(episode) | columns)


def _build_key_rows(tallies: Sequence[KeyTally]) -> list[MeasureRow]:
    plans = [tally.episode.plan for tally in tallies]
    blocks = {plan.episode + 1: plan.block_name for plan in plans}
    return [
        {
            "block": blocks[use.first_episode],
            "first_episode": use.first_episode,
            "key": use.key,
            "action": use.action or "",
            "presses": use.presses,
            "steps": use.steps,
            "ineffective_steps": use.ineffective_steps,
            "refused": use.refused,
            "discovered_s": use.discovered_s,
            "discovered_steps": use.discovered_steps,
        }
        for use in summarize_key_use(tallies)
    ]


_TABLES_OF_TOPIC = {
    topics.PLAN: ("plan", "segments"),
    topics.NOTE: ("notes",),
    topics.PAUSE: ("notes",),
    topics.KEY_MAP: ("plan",),
    topics.EPISODE_START: ("starts", "episodes"),
    topics.KEY: ("presses", "other_presses"),
    topics.STEP: ("steps",),
    topics.FRAME: ("frames",),
    topics.SAMPLE: ("samples",),
    topics.EPISODE_END: ("episodes",),
    topics.SESSION_END: ("segments",),
    topics.PART: ("parts",),
    topics.PART_END: ("parts",),
    topics.TEXT: ("other_inputs",),
    topics.POINTER: ("other_inputs",),
    topics.AXIS: ("other_inputs",),
    topics.LINK: ("links",),
    topics.MODEL_CALL: ("model_calls",),
    "/team/ready": ("parts",),
    "/team/end": ("points",),
}


def find_tables_of_topics() -> dict[str, tuple[str, ...]]:
    """Return, for each topic of a log, the names of the tables that hold its contents."""
    return _TABLES_OF_TOPIC | list_tables_of_topics()
