"""The contents of a session log: its summary from every message, its description as lines or JSON, and its recovery.

The full read serves sessions that are running or were cut off, and logs of earlier versions. Recovery finishes
truncated and damaged logs one by one; a log that cannot be recovered does not stop the others.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from minihuman.admin.enrolment_entries import NO_NOTE, AuditNote, LogRecovered
from minihuman.admin.enrolment_log import record_intervention
from minihuman.admin.manifest import record_log_end, record_missing_heads
from minihuman.admin.session_summary import SessionSummary
from minihuman.dataset.measures import playing_s, response_ms
from minihuman.errors import LogError, MinihumanError
from minihuman.experiment.machine import events
from minihuman.experiment.machine.part_sequence import is_only_closing_left
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.log import topics
from minihuman.log.model.session_log import CUT_OFF, EpisodeLog, Segment, SessionLog
from minihuman.log.paths import (
    PART_SUFFIX,
    SYSTEM_COMPANION,
    find_log_folders,
    find_system_companions,
    raise_as_log_error,
    study_folder,
)
from minihuman.log.read.reader import LogReader, read_segment_starts
from minihuman.log.record.finalization import FinalizedLog, find_leftovers, recover_log, repair_log
from minihuman.log.record.session_leases import SessionLeases
from minihuman.log.salvage.summary_section import all_ended_cleanly
from minihuman.storage.lease import open_lease_table
from minihuman.storage.system import now_text

_TALLIED_TOPICS = frozenset({topics.PLAN, topics.EPISODE_END, topics.SKIP, topics.PART_END, topics.SESSION_END})


def summarize_from_messages(files: Sequence[Path]) -> SessionSummary:
    """Summarize a session from the messages of its log and segments, given in order.

    Raises:
        LogError: if a file cannot be opened, is damaged, is not a session log of this schema version, or has no plan.
    """
    readers = [LogReader(file) for file in files]
    tally = _tally_messages(readers)
    if tally.started is None:
        raise LogError(
            f"{files[0]} was cut off before its session started, so it has nothing to show; name another log"
        )
    starts = [facts for reader in readers for facts in reader.starts]
    ends = [facts for reader in readers for facts in reader.ends]
    plan = tally.started.plan
    duration_ns = sum(last_ns - first_ns for first_ns, last_ns in tally.spans)
    return SessionSummary(
        study=plan.study,
        participant=plan.participant.id,
        group=plan.participant.group,
        session=plan.session,
        player=tally.started.facts.get("player", "unknown"),
        started_at=starts[0]["started_at"],
        segments=len(tally.spans),
        clean=all_ended_cleanly(starts, ends),
        end_reason=tally.end_reason,
        episodes_planned=len(plan.episodes) - tally.skipped,
        episodes_completed=len(tally.completed),
        steps=tally.steps,
        duration_s=duration_ns / 1e9,
        complete=_is_complete(tally, plan),
    )


def _tally_messages(readers: Iterable[LogReader]) -> "_SessionTally":
    """Read the messages of a session's files, given in order, and return the session's progress as a tally."""
    tally = _SessionTally()
    for reader in readers:
        for message in reader.messages():
            topic = message.channel.topic
            if topic == topics.STEP:
                tally.steps += 1
            if topic in _TALLIED_TOPICS:
                tally.add_event(reader.decode(topic, message.data), message.log_time)
            tally.extend_segment(message.log_time)
    return tally


def _is_complete(tally: "_SessionTally", plan: SessionPlan) -> bool:
    """Return whether a session ended as complete, or was interrupted when only its closing pages were left to show.

    Args:
        tally: the counts of the session's messages.
        plan: the session's plan.
    """
    if tally.end_reason == "complete":
        return True
    if tally.end_reason in events.FINAL_END_REASONS:
        return False
    n_planned = len(plan.episodes) - tally.skipped
    all_played = 0 < n_planned == len(tally.completed)
    return all_played and is_only_closing_left(plan.parts, tally.next_part)


@dataclass(slots=True)
class _SessionTally:
    """A session's progress according to the messages read so far."""

    started: events.SessionStarted | None = None  # of the first segment
    completed: set[int] = field(default_factory=set)  # numbers of completed episodes
    spans: list[tuple[int, int]] = field(default_factory=list)  # each segment's first and last log time, ns
    steps: int = 0
    skipped: int = 0
    next_part: int = 0
    end_reason: str = CUT_OFF

    def add_event(self, event: events.Event | None, log_time: int) -> None:
        """Update the tally with an event; ``log_time`` is the log time of its message in nanoseconds since 1970."""
        match event:
            case events.SessionStarted():
                self.started = self.started or event
                self.end_reason = CUT_OFF
                self.spans.append((log_time, log_time))
            case events.EpisodeEnded() if event.outcome != "abandoned":
                self.completed.add(event.episode)
            case events.EpisodesSkipped():
                self.skipped += event.count
            case events.PartEnded():
                self.next_part = event.next
            case events.SessionEnded():
                self.end_reason = event.reason

    def extend_segment(self, log_time: int) -> None:
        """Extend the latest segment, if there is one, to a message's log time in nanoseconds since 1970."""
        if self.spans:
            first, last = self.spans[-1]
            self.spans[-1] = (first, max(last, log_time))


_EPISODE_HEADER = (
    f"{'episode':>7} {'attempt':>7} {'segment':>7}  {'block':16} {'outcome':10} {'steps':>5} {'return':>7} "
    f"{'at s':>9} {'played':>7} {'rt ms':>6}  seed"
)


def format_session_lines(session: SessionLog) -> list[str]:
    """Format a readable summary: the session and its segments in a few lines, then one line for each episode."""
    plan = session.plan
    n_steps = sum(len(episode.actions) for episode in session.episodes)
    n_presses = sum(key.down for key in session.keys)
    lines = [
        f"{session.path}",
        f"study        {plan.study} (version {plan.study_version}, seed {plan.study_seed})",
        f"participant  {plan.participant.id}, group {plan.participant.group}, session {plan.session}",
        f"player       {session.player}",
        f"started      {session.started_at}",
        f"ended        {_format_end(session.end_reason, clean=session.clean)}",
        f"episodes     {len(session.episodes)} played, {len(plan.episodes)} planned",
        f"steps        {n_steps}",
        f"keys         {n_presses} presses",
    ]
    lines += [_format_segment_line(segment) for segment in session.segments]
    lines += [
        "",
        "at s: session time at the reset, since the first segment began; played: seconds to the last step, no pauses",
        _EPISODE_HEADER,
    ]
    lines += [_format_episode_line(episode) for episode in session.episodes]
    return lines


def _format_end(reason: str, *, clean: bool) -> str:
    return f"{reason}, clean" if clean else f"{reason}, not clean"


def format_session_json(session: SessionLog) -> str:
    """Format a session's summary, with its episodes and segments, as one JSON object."""
    plan = session.plan
    facts = {
        "path": str(session.path),
        "study": plan.study,
        "study_version": plan.study_version,
        "participant": plan.participant.id,
        "group": plan.participant.group,
        "session": plan.session,
        "player": session.player,
        "started_at": session.started_at,
        "end_reason": session.end_reason,
        "clean": session.clean,
        "episodes_planned": len(plan.episodes),
        "episodes": [_build_episode_facts(episode) for episode in session.episodes],
        "segments": [_build_segment_facts(segment) for segment in session.segments],
        "key_presses": sum(key.down for key in session.keys),
        "facts": session.facts,
    }
    return msgspec.json.format(msgspec.json.encode(facts), indent=2).decode()


def _format_segment_line(segment: Segment) -> str:
    start_s = segment.start_ns / 1e9
    end_s = segment.end_ns / 1e9
    return (
        f"segment {segment.number:<4} {segment.started_at}, session time {start_s:.1f} to {end_s:.1f} s; "
        f"{_format_end(segment.end_reason, clean=segment.clean)}; {len(segment.pauses)} pauses"
    )


def _build_segment_facts(segment: Segment) -> dict[str, Any]:
    """Return the facts about a segment for the JSON summary of a session; names that end in _s or _ns give the unit."""
    return {
        "segment": segment.number,
        "started_at": segment.started_at,
        "started_unix_ns": segment.started_unix_ns,
        "started_monotonic_ns": segment.started_monotonic_ns,
        "monotonic_clock": segment.monotonic_clock or None,
        "start_s": segment.start_ns / 1e9,
        "end_s": segment.end_ns / 1e9,
        "end_reason": segment.end_reason,
        "clean": segment.clean,
        "pauses_s": [[begin / 1e9, end / 1e9] for begin, end in segment.pauses],
    }


def _format_episode_line(episode: EpisodeLog) -> str:
    facts = _build_episode_facts(episode)
    rt_ms = "-" if facts["median_rt_ms"] is None else f"{facts['median_rt_ms']:.0f}"
    return (
        f"{facts['episode']:7} {facts['attempt']:7} {facts['segment']:7}  {facts['block']:16} {facts['outcome']:10} "
        f"{facts['steps']:5} {facts['return']:7.3f} {facts['session_time_s']:9.1f} {facts['playing_s']:7.1f} "
        f"{rt_ms:>6}  {facts['seed']}"
    )


def _build_episode_facts(episode: EpisodeLog) -> dict[str, Any]:
    """Return the facts about an episode that its line and the JSON summary of a session show.

    Names that end in _s or _ms give the unit. The median reaction time is None if no step has a key press.
    """
    plan = episode.plan
    times_ms = response_ms(episode)
    answered = times_ms[~np.isnan(times_ms)]
    return {
        "episode": episode.number,
        "attempt": episode.attempt,
        "block": plan.block_name,
        "world": plan.world,
        "seed": plan.seed,
        "segment": episode.segment,
        "outcome": episode.outcome_word,
        "steps": len(episode.actions),
        "return": episode.return_,
        "session_time_s": float(episode.t_ns[0]) / 1e9,
        "playing_s": playing_s(episode),
        "median_rt_ms": float(np.median(answered)) if len(answered) else None,
    }


@dataclass(frozen=True, slots=True)
class RecoveryResult:
    """The result of recovering a log, as a line of text."""

    line: str
    damaged: bool = False  # whether any part of the log was damaged


def recover_logs(paths: Iterable[Path], note: AuditNote = NO_NOTE) -> Iterator[RecoveryResult | MinihumanError]:
    """Finish truncated logs and rewrite damaged finished ones; yield the result for each, or the error.

    For an undamaged log, the chain heads that are missing from the enrolment log are added to it.

    Args:
        paths: logs, or folders in which to look for truncated logs.
        note: the reason and the experimenter, for the enrolment log.
    """
    for path in paths:
        logs = [path]
        if path.is_dir():
            for companion in find_system_companions(find_log_folders(path)):
                yield RecoveryResult(f"skipped {companion}: {SYSTEM_COMPANION}")
            logs = list(find_leftovers(path))
        for log in logs:
            try:
                yield _recover_and_record(log, note)
            except MinihumanError as error:
                yield error


def _recover_and_record(log: Path, note: AuditNote) -> RecoveryResult:
    """Recover one log, record the recovery in the enrolment log, and return the result."""
    if log.name.endswith(PART_SUFFIX):
        finished = _recover_live_file(log)
    else:
        n_added = _add_missing_heads(log)
        if n_added:
            outcome = f"whole; {n_added} chain heads added to the enrolment log"
            _record_recovery(log, outcome, note)
            return RecoveryResult(f"{log}: {outcome}")
        finished = repair_log(log)
    if finished is None:
        return RecoveryResult(f"{log}: another server has gone on with this session, so it was put aside")
    if finished.readable:
        record_log_end(finished.path)
        outcome = f"ended: {finished.end_reason}"
        if finished.damage:
            outcome += f"; {finished.damage}"
        _record_recovery(finished.path, outcome, note)
    return RecoveryResult(finished.describe(), finished.damaged)


def _recover_live_file(part: Path) -> FinalizedLog | None:
    """Finish a truncated log and return the result; None if another server has resumed the session."""
    lease_table = open_lease_table(study_folder(part))
    if lease_table:
        return SessionLeases(lease_table).recover(part)
    return recover_log(part)


def _record_recovery(log: Path, outcome: str, note: AuditNote) -> None:
    entry = LogRecovered(log.name, now_text(), outcome, note.reason, note.experimenter)
    record_intervention(study_folder(log), entry)


def _add_missing_heads(log: Path) -> int:
    """Record an undamaged log's missing chain heads, and return their number; it is 0 for a damaged log."""
    try:
        with raise_as_log_error(log):
            read_segment_starts(log)
    except LogError:
        return 0
    return record_missing_heads(log)
