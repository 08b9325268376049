"""What a session's files hold, in one row of numbers, without making an object of every step."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from minihuman.errors import LogError
from minihuman.log import topics
from minihuman.log.read.file import Reading, all_clean
from minihuman.log.read.glance import glance
from minihuman.log.read.guard import guarded
from minihuman.recorded.episode import CUT_OFF
from minihuman.study import events as ev

_READ = frozenset({topics.PLAN, topics.EPISODE_END, topics.SKIP, topics.SESSION_END})


@dataclass(frozen=True, slots=True)
class Summary:
    """A session in one row. Counts are of all its segments together."""

    study: str
    participant: str
    group: str
    session: int
    player: str
    started_at: str  # ISO 8601 UTC
    segments: int
    clean: bool
    end_reason: str  # an EndReason, or "cut_off"
    episodes_planned: int  # less those that were skipped
    episodes_completed: int  # with an outcome other than abandoned
    steps: int
    duration_s: float  # from a segment's start to its last message, summed


def summarise(files: Sequence[Path]) -> Summary:
    """Sum up a session's log and segments, in order.

    A finished log whose checksums hold is summed up from what was written at its end; others are read through.

    Raises:
        LogError: if one cannot be opened, is no session log, of another schema version or damaged, or holds no plan.
    """
    with guarded(files[0]):
        return (_at_a_glance(files[0]) if len(files) == 1 else None) or _read_through(files)


def _read_through(files: Sequence[Path]) -> Summary:
    readings = [Reading(file) for file in files]
    plan: ev.SessionStarted | None = None
    completed: set[int] = set()
    spans: list[tuple[int, int]] = []  # a segment's first and last log time
    steps, skipped, end_reason = 0, 0, CUT_OFF
    for reading, message in ((source, found) for source in readings for found in source.messages()):
        topic = message.channel.topic
        steps += topic == topics.STEP
        match reading.event(topic, message.data) if topic in _READ else None:
            case ev.SessionStarted() as started:
                plan, end_reason = plan or started, CUT_OFF
                spans.append((message.log_time, message.log_time))
            case ev.EpisodeEnded() as ended if ended.outcome != "abandoned":
                completed.add(ended.episode)
            case ev.EpisodesSkipped() as passed:
                skipped += passed.count
            case ev.SessionEnded() as over:
                end_reason = over.reason
        if spans:
            spans[-1] = (spans[-1][0], max(spans[-1][1], message.log_time))
    if plan is None:
        raise LogError(f"{files[0]} holds no session plan; it was cut off before the session started")
    starts = [facts for reading in readings for facts in reading.starts]
    ends = [facts for reading in readings for facts in reading.ends]
    who = plan.plan.participant
    return Summary(
        study=plan.plan.study,
        participant=who.id,
        group=who.group,
        session=plan.plan.session,
        player=plan.facts.get("player", "unknown"),
        started_at=starts[0]["started_at"],
        segments=len(spans),
        clean=all_clean(starts, ends),
        end_reason=end_reason,
        episodes_planned=len(plan.plan.episodes) - skipped,
        episodes_completed=len(completed),
        steps=steps,
        duration_s=sum(last - first for first, last in spans) / 1e9,
    )


def _at_a_glance(log: Path) -> Summary | None:
    """Sum up a log from what its segments' ends say; None where one does not, as in logs of earlier versions."""
    found = glance(log)
    if found is None or not found.starts or not len(found.starts) == len(found.facts) == len(found.ends):
        return None
    if found.starts[0].get("schema_version") != str(topics.SCHEMA_VERSION) or "completed" not in found.ends[-1]:
        return None
    first, last = found.starts[0], found.ends[-1]
    return Summary(
        study=first["study"],
        participant=first["participant"],
        group=first["group"],
        session=int(first["session"]),
        player=found.facts[0].get("player", "unknown"),
        started_at=first["started_at"],
        segments=len(found.starts),
        clean=all_clean(found.starts, found.ends),
        end_reason=last["reason"],
        episodes_planned=int(last["planned"]),
        episodes_completed=int(last["completed"]),
        steps=found.counts[topics.STEP],
        duration_s=sum(int(end.get("lasted_ns", 0)) for end in found.ends) / 1e9,
    )
