"""Build every table's rows from one session: steps, presses, keys, episodes, and all that was logged around them.

Stored observations are no rows; exporters read them.
"""

import json
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import msgspec
import numpy as np

from minihuman.activities.agent_blocks import rows as agent_rows
from minihuman.activities.agent_blocks.events import Advised, ControlChanged, LearnerAsked, PolicyGiven
from minihuman.activities.correction import rows as correction_rows
from minihuman.activities.correction.events import CorrectionBegun
from minihuman.activities.preferences import rows as preference_rows
from minihuman.activities.preferences.events import Preferred
from minihuman.activities.rating import rows as rating_rows
from minihuman.activities.rating.events import Rated
from minihuman.activities.team import rows as team_rows
from minihuman.activities.team.events import JointStepped
from minihuman.dataset.annotations import Annotation
from minihuman.dataset.measures import KeyTally, response_ms, summarize_key_use, visible_effect
from minihuman.dataset.rows import RowBatch, SessionTables
from minihuman.dataset.selection import SelectedSession, find_practice_blocks, format_version, summarize_session
from minihuman.dataset.session_measures import MeasureRow, SessionMeasures, locate_episode
from minihuman.errors import ProtocolError
from minihuman.experiment.machine.events import (
    AnswerChanged,
    Answered,
    AxisMoved,
    ClauseDone,
    DesignDecided,
    EpisodesSkipped,
    Linked,
    ModelCall,
    PageShown,
    PartEnded,
    PartStarted,
    Paused,
    PointerUsed,
    Resumed,
    Sampled,
    Scored,
    TextTyped,
)
from minihuman.experiment.plan.session_plan import EpisodePlan
from minihuman.experiment.protocol.protocol import decode_logged_protocol
from minihuman.log import topics
from minihuman.log.model.event_columns import NO_ACTION, CategoricalTexts
from minihuman.log.model.session_log import EpisodeLog, PartEvent, Segment, SegmentNote, SessionLog

SessionKey = Mapping[str, Any]  # the columns that all rows of a session share
_TableRow = dict[str, Any]
_TABLE_BUILDERS = ("segments", "plan", "starts", "frames", "other_presses", "notes", "samples", "marks")


def build_context_rows(
    log: SessionLog,
    episodes: Sequence[EpisodeLog],
    who: SessionKey,
    marks: Sequence[Annotation],
    *,
    wanted: bool = True,
) -> dict[str, RowBatch]:
    """The rows of these tables, none where the session is not wanted; beginnings and pictures of these episodes."""
    if not wanted:
        return dict.fromkeys(_TABLE_BUILDERS, RowBatch(0, {}))
    attempts = Counter(episode.number for episode in log.episodes)
    channels = _channels(log)
    return {
        "segments": RowBatch.of([{**who, **_segment(segment, log)} for segment in log.segments]),
        "plan": RowBatch.of([{**who, **_planned(plan, attempts[plan.episode + 1])} for plan in log.plan.episodes]),
        "starts": RowBatch.of([{**who, **_place(episode), **_start(episode)} for episode in episodes]),
        "frames": RowBatch.below([_frames(episode) for episode in episodes], **who),
        "other_presses": RowBatch.below([_other_presses(segment, log.episodes) for segment in log.segments], **who),
        "notes": RowBatch.of(
            [{**who, "segment": segment.number, **_note(note)} for segment in log.segments for note in segment.notes]
        ),
        "samples": RowBatch.of(
            [
                {**who, "segment": segment.number, **row}
                for segment in log.segments
                for sampled in segment.samples
                for row in _sample(sampled, channels)
            ]
        ),
        "marks": RowBatch.of([{**who, **msgspec.structs.asdict(mark)} for mark in marks]),
    }


def _segment(segment: Segment, log: SessionLog) -> _TableRow:
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


def _planned(plan: EpisodePlan, attempts: int) -> _TableRow:
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


def _place(episode: EpisodeLog) -> _TableRow:
    return {
        "block": episode.plan.block_name,
        "segment": episode.segment,
        "episode": episode.number,
        "attempt": episode.attempt,
    }


def _start(episode: EpisodeLog) -> _TableRow:
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


def _frames(episode: EpisodeLog) -> RowBatch:
    frames = episode.frames
    columns = {name: frames.column(name) for name in ("step", "submit_ns", "flip_ns")}
    return RowBatch(len(frames), _place(episode) | columns)


def _other_presses(segment: Segment, episodes: Sequence[EpisodeLog]) -> RowBatch:
    """The keys that moved while no episode ran: those of a segment that are in none of its episodes."""
    keys = segment.keys
    outside = np.ones(len(keys), bool)
    for episode in episodes:
        if episode.segment == segment.number:
            outside[keys.place(episode.keys)] = False
    rows = np.flatnonzero(outside)
    names = ("t_ns", "phase", "key", "symbol", "down", "verdict")
    columns = {name: keys.column(name)[rows] for name in names}
    return RowBatch(len(rows), {"segment": segment.number} | columns)


def _note(note: SegmentNote) -> _TableRow:
    match note:
        case Paused():
            return {"t_ns": note.t_ns, "kind": "pause", "note": note.reason}
        case Resumed():
            return {"t_ns": note.t_ns, "kind": "resume", "note": ""}
    return {"t_ns": note.t_ns, "kind": note.kind, "note": note.text}


def _sample(sampled: Sampled, channels: Mapping[str, Sequence[str]]) -> list[_TableRow]:
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
        return {device.name: device.channels for device in decode_logged_protocol(log.plan.protocol_toml).devices}
    except ProtocolError:
        return {}


def _json(value: Any) -> str:
    return json.dumps(value, sort_keys=True)


_ActivityRow = dict[str, Any]
_MS = 1e-6


def build_activity_rows(log: SessionLog, who: Mapping[str, Any], *, wanted: bool = True) -> dict[str, RowBatch]:
    """The rows of these tables, none where the session is not wanted."""
    found: dict[str, list[_ActivityRow]] = {table: [] for table in _MAKERS}
    for segment in log.segments if wanted else ():
        for event in segment.part_events:
            for table, make in _MAKERS.items():
                row = make(event, log)
                if row is not None:
                    found[table].append({**who, "segment": segment.number, "t_ns": event.t_ns, **row})
    return {table: RowBatch.of(rows) for table, rows in found.items()}


def _answer(event: PartEvent, log: SessionLog) -> _ActivityRow | None:
    if not isinstance(event, Answered):
        return None
    value = json.loads(event.value)
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    told = value if isinstance(value, str) else "" if value is None else json.dumps(value, ensure_ascii=False)
    return {
        "part": event.part + 1,
        "questions": event.part_name,
        "item": event.item,
        "kind": event.kind,
        "attempt": event.attempt,
        "answer": told,
        "number": float(value) if is_number else None,
        "said": event.words,
        "right": event.right,
        "shown_ns": event.shown_ns or None,
        "first_ms": (event.first_ns - event.shown_ns) * _MS if event.first_ns and event.shown_ns else None,
        "answer_ms": (event.t_ns - event.shown_ns) * _MS if event.shown_ns else None,
        "changes": event.changes,
    }


def _change(event: PartEvent, log: SessionLog) -> _ActivityRow | None:
    if not isinstance(event, AnswerChanged):
        return None
    return {"part": event.part + 1, "item": event.item, "answer": event.value}


def _part(event: PartEvent, log: SessionLog) -> _ActivityRow | None:
    match event:
        case PartStarted():
            return {"part": event.part + 1, "what": "started", "kind": event.kind, "name": event.name, "next": None}
        case PartEnded():
            its = log.plan.parts[event.part]
            return {
                "part": event.part + 1,
                "what": event.end,
                "kind": its.kind,
                "name": its.name,
                "next": event.next + 1,
            }
    return None


def _page(event: PartEvent, log: SessionLog) -> _ActivityRow | None:
    if not isinstance(event, PageShown):
        return None
    name = log.plan.parts[event.part].name
    times = {"submit_ns": event.submit_ns, "flip_ns": event.flip_ns}
    return {"part": event.part + 1, "name": name, "page": event.page, "pages": event.pages, **times}


def _points(event: PartEvent, log: SessionLog) -> _ActivityRow | None:
    match event:
        case Scored():
            return {
                "episode": event.episode + 1,
                "points": event.points,
                "total": event.total,
                "skipped": None,
                "why": "",
            }
        case EpisodesSkipped():
            return {
                "episode": event.first + 1,
                "points": None,
                "total": None,
                "skipped": event.count,
                "why": event.reason,
            }
    return None


def _subgoal(event: PartEvent, log: SessionLog) -> _ActivityRow | None:
    if not isinstance(event, ClauseDone):
        return None
    return {"episode": event.episode + 1, "step": event.step, "clause": event.clause + 1, "text": event.text}


def _input(event: PartEvent, log: SessionLog) -> _ActivityRow | None:
    match event:
        case TextTyped():
            return {"what": "typed", "text": event.text, "target": "", "x": None, "y": None, "along": None}
        case PointerUsed():
            place = {"x": event.x, "y": event.y, "along": event.along}
            return {"what": event.what, "text": "", "target": event.target, **place}
        case AxisMoved():
            axis = {"what": "axis", "text": "", "target": event.axis, "along": event.value}
            return {**axis, "x": None, "y": None}
    return None


def _link(event: PartEvent, log: SessionLog) -> _ActivityRow | None:
    if not isinstance(event, Linked):
        return None
    return {
        "offset_ms": event.offset_ns * _MS,
        "error_ms": event.error_ns * _MS,
        "rtt_ms": event.rtt_ns * _MS,
        "least_rtt_ms": event.least_rtt_ns * _MS,
        "drift_ppm": event.drift_ppm,
    }


def _policy(event: PartEvent, log: SessionLog) -> _ActivityRow | None:
    match event:
        case LearnerAsked():
            its = {"what": "asked", "policy": "", "failure": ""}
        case PolicyGiven():
            its = {"what": "failed" if event.failure else "given", "policy": event.policy, "failure": event.failure}
        case _:
            return None
    return {"part": event.part + 1, "episode": event.episode + 1, **its}


def _advice(event: PartEvent, log: SessionLog) -> _ActivityRow | None:
    if not isinstance(event, Advised):
        return None
    said = json.dumps([round(chance, 9) for chance in event.probabilities])
    return {"episode": event.episode + 1, "step": event.step, "policy_action": event.action, "probabilities": said}


def _control(event: PartEvent, log: SessionLog) -> _ActivityRow | None:
    if not isinstance(event, ControlChanged):
        return None
    its = {"who": event.who, "reason": event.reason, "pressed_ns": event.pressed_ns}
    return {"episode": event.episode + 1, "step": event.step, **its}


def _rating(event: PartEvent, log: SessionLog) -> _ActivityRow | None:
    if not isinstance(event, Rated):
        return None
    its = {"value": event.value, "pressed_ns": event.pressed_ns}
    return {"episode": event.episode + 1, "step": event.step, **its}


def _correction(event: PartEvent, log: SessionLog) -> _ActivityRow | None:
    if not isinstance(event, CorrectionBegun):
        return None
    found = next((its for its in log.corrections if its.part == event.part and its.t_ns[0] == event.t_ns), None)
    if found is None:
        return None
    return {
        "part": event.part + 1,
        "correction": event.correction + 1,
        "episode": event.episode + 1,
        "attempt": event.attempt,
        "step": event.step,
        "steps": len(found.actions),
        "outcome": found.outcome,
        "actions": json.dumps(found.actions.tolist()),
        "key_t_ns": json.dumps(found.key_t_ns.tolist()),
    }


def _preference(event: PartEvent, log: SessionLog) -> _ActivityRow | None:
    if not isinstance(event, Preferred):
        return None
    compared = next((its for its in log.comparisons if its.preference is event), None)
    if compared is None:
        return None
    sides = {
        f"{side}_{name}": value
        for side, stretch in (("left", compared.left), ("right", compared.right))
        for name, value in (
            ("episode", stretch.episode + 1),
            ("attempt", stretch.attempt),
            ("first", stretch.first),
            ("last", stretch.last),
        )
    }
    return {
        "part": event.part + 1,
        "pair": event.pair + 1,
        **sides,
        "answer": event.answer,
        "shown_ns": event.shown_ns or None,
        "answer_ms": compared.answer_ms if event.shown_ns else None,
        "replays": event.replays,
    }


def _joint_step(event: PartEvent, log: SessionLog) -> _ActivityRow | None:
    if not isinstance(event, JointStepped):
        return None
    lists = {name: json.dumps(list(getattr(event, name))) for name in ("actions", "rewards", "sources")}
    return {"episode": event.episode + 1, "step": event.step, **lists}


def build_team_row(episode: EpisodeLog, who: SessionKey) -> _TableRow | None:
    """The row of an episode that a team played; None for one that one body played."""
    team = episode.team
    if team is None:
        return None
    return {
        **who,
        **locate_episode(episode),
        "team": team.team,
        "team_index": team.index + 1,
        "seat": team.seat,
        "role": team.role,
        "partner": team.partner,
        "seats": _json(team.seats),
        "outcome": episode.outcome_word,
        "joint_steps": len(team.actions),
        "team_reward": float(team.rewards.mean(axis=1).sum()),
        "late": team.late,
        "idled": sum(row[team.seat] == "late" for row in team.sources),
        "corrected": team.corrected,
        "takeovers": team.takeovers,
        "agent_steps": sum(any(row[seat] == "agent" for seat in team.persons) for row in team.sources),
        "digest": f"{team.digest:016x}",
    }


_CALL_FIELDS = (
    *("call", "state", "step", "screen", "attempt", "provider", "model", "temperature", "prompt_tokens"),
    *("completion_tokens", "price", "latency_ms", "answer", "reasoning", "finish_reason", "verdict", "reading"),
    *("error", "prompt_sha256", "picture_sha256"),
)


def _model_call(event: PartEvent, log: SessionLog) -> _ActivityRow | None:
    if not isinstance(event, ModelCall) or event.state == "asked":
        return None
    return {"episode": event.episode + 1, **{name: getattr(event, name) for name in _CALL_FIELDS}}


def _decision(event: PartEvent, log: SessionLog) -> _ActivityRow | None:
    if not isinstance(event, DesignDecided):
        return None
    return {
        "part": event.part + 1,
        "block": log.plan.parts[event.part].name,
        "episode": event.episode + 1,
        "design": event.design,
        "design_version": event.version,
        "options": _json(event.options),
        "seed": event.seed,
        "stop": event.stop,
        "estimates": _json(event.estimates),
        "posterior": f"{event.posterior:016x}",
    }


_MAKERS: Mapping[str, Callable[[PartEvent, SessionLog], _ActivityRow | None]] = {
    "answers": _answer,
    "answer_changes": _change,
    "parts": _part,
    "pages": _page,
    "points": _points,
    "clauses": _subgoal,
    "other_inputs": _input,
    "links": _link,
    "model_calls": _model_call,
    "policies": _policy,
    "advice": _advice,
    "controls": _control,
    "ratings": _rating,
    "corrections": _correction,
    "preferences": _preference,
    "joint_steps": _joint_step,
    "decisions": _decision,
}

NO_EPISODE_INCLUDED = "no episode counts"


def build_session_tables(counted: SelectedSession, measured: SessionMeasures) -> SessionTables:
    """Every table's rows of one session: of the episodes that are asked for.

    Rows that do not count stay in the tables, with the reason in ``exclusion_reason``; block and participant rows are
    over the episodes that count, keys' rows over all that were begun in those blocks.
    """
    log = counted.log
    who: MeasureRow = {
        "study": log.plan.study,
        "version": format_version(log.plan),
        "participant": log.plan.participant.id,
        "group": log.plan.participant.group,
        "session": log.plan.session,
    }
    asked = [place for place, is_asked in enumerate(counted.asked) if is_asked]
    played = [log.episodes[at] for at in asked]
    episodes = [
        who
        | measured.rows[at]
        | {
            "tags": " ".join(sorted(counted.tags[at])),
            "exclusion_reason": counted.session_reason or counted.reasons[at],
        }
        for at in asked
    ]
    counting = [at for at in asked if not counted.reasons[at]]
    blocks = [
        who | {"block": name} | measured.over([at for at in counting if measured.rows[at]["block"] == name])
        for name in dict.fromkeys(episode.plan.block_name for episode in played)
    ]
    practice = find_practice_blocks(log.plan)
    analysed = [at for at in counting if measured.rows[at]["block"] not in practice]
    participant = who | summarize_session(log) | measured.over(analysed)
    for row in blocks:
        row["exclusion_reason"] = counted.session_reason or ("" if row["episodes"] else NO_EPISODE_INCLUDED)
    participant["exclusion_reason"] = counted.session_reason or ("" if counted.counts else NO_EPISODE_INCLUDED)
    steps, presses = (RowBatch.below([of(episode) for episode in played], **who) for of in (_steps, _presses))
    return SessionTables(
        {
            "steps": steps,
            "presses": presses,
            "keys": RowBatch.of(
                [who | row for row in _keys(measured.of_blocks({one.plan.block_name for one in played}))]
            ),
            "episodes": RowBatch.of(episodes),
            "blocks": RowBatch.of(blocks),
            "participants": RowBatch.of([participant] if counted.wanted else []),
            "teams": RowBatch.of([its for one in played if (its := build_team_row(one, who)) is not None]),
        }
        | build_context_rows(log, played, who, counted.marks, wanted=counted.wanted)
        | build_activity_rows(log, who, wanted=counted.wanted)
    )


def _steps(episode: EpisodeLog) -> RowBatch:
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
        "z": episode.poses[1:, 2],
        "yaw_rad": episode.poses[1:, 3],
        "terminated": episode.terminated,
        "truncated": episode.truncated,
        "action_vector": CategoricalTexts.of([json.dumps(row) for row in episode.action_vectors.tolist()])
        if episode.action_vectors is not None
        else CategoricalTexts(np.zeros(n, np.int64), ("",)),
    }
    return RowBatch(n, locate_episode(episode) | columns)


def _presses(episode: EpisodeLog) -> RowBatch:
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


def _keys(tallies: Sequence[KeyTally]) -> list[MeasureRow]:
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


TABLES_OF_TOPIC = {
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
    topics.ANSWER: ("answers",),
    topics.ANSWER_CHANGE: ("answer_changes",),
    topics.PART: ("parts",),
    topics.PART_END: ("parts",),
    topics.PAGE: ("pages",),
    topics.POINTS: ("points",),
    topics.CLAUSE: ("clauses",),
    topics.SKIP: ("points",),
    topics.TEXT: ("other_inputs",),
    topics.POINTER: ("other_inputs",),
    topics.AXIS: ("other_inputs",),
    topics.LINK: ("links",),
    topics.MODEL_CALL: ("model_calls",),
    topics.DESIGN: ("decisions",),
    agent_rows.POLICY_TOPIC: ("policies",),
    agent_rows.LEARNER_REQUEST_TOPIC: ("policies",),
    agent_rows.ADVICE_TOPIC: ("advice",),
    agent_rows.CONTROL_TOPIC: ("controls",),
    rating_rows.RATING_TOPIC: ("ratings",),
    team_rows.TEAM_TOPIC: ("teams",),
    team_rows.JOINT_STEP_TOPIC: ("joint_steps", "teams"),
    "/team/ready": ("parts",),
    "/team/corrected": ("teams",),
    "/team/late": ("teams",),
    "/team/seat": ("teams",),
    "/team/end": ("points",),
    correction_rows.CORRECTION_EPISODE_TOPIC: ("corrections",),
    correction_rows.CORRECTION_TOPIC: ("corrections",),
    correction_rows.CORRECTION_STEP_TOPIC: ("corrections",),
    correction_rows.CORRECTION_END_TOPIC: ("corrections",),
    preference_rows.PREFERENCE_CLIP_TOPIC: ("preferences",),
    preference_rows.PREFERENCE_TOPIC: ("preferences",),
}
