"""A session summed up from every message: one that is running or was cut off, or that an earlier version wrote."""

from collections.abc import Sequence
from pathlib import Path

from minihuman.errors import LogError
from minihuman.lab.summary import Summary
from minihuman.log import topics
from minihuman.log.read.file import Reading
from minihuman.log.read.glance import all_clean
from minihuman.recorded.episode import CUT_OFF
from minihuman.study import events as ev
from minihuman.study.parts import only_last_words

_READ = frozenset({topics.PLAN, topics.EPISODE_END, topics.SKIP, topics.PART_END, topics.SESSION_END})


def read_through(files: Sequence[Path]) -> Summary:
    """Sum up a session's log and segments, in order.

    Raises:
        LogError: if one cannot be opened, is no session log, of another schema version or damaged, or holds no plan.
    """
    readings = [Reading(file) for file in files]
    plan: ev.SessionStarted | None = None
    completed: set[int] = set()
    spans: list[tuple[int, int]] = []  # a segment's first and last log time
    steps, skipped, next_part, end_reason = 0, 0, 0, CUT_OFF
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
            case ev.PartEnded() as ended:
                next_part = ended.next
            case ev.SessionEnded() as over:
                end_reason = over.reason
        if spans:
            spans[-1] = (spans[-1][0], max(spans[-1][1], message.log_time))
    if plan is None:
        raise LogError(f"{files[0]} holds no session plan; it was cut off before the session started")
    starts = [facts for reading in readings for facts in reading.starts]
    ends = [facts for reading in readings for facts in reading.ends]
    who = plan.plan.participant
    planned = len(plan.plan.episodes) - skipped
    all_done = 0 < planned == len(completed) and only_last_words(plan.plan.parts, next_part)
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
        episodes_planned=planned,
        episodes_completed=len(completed),
        steps=steps,
        duration_s=sum(last - first for first, last in spans) / 1e9,
        complete=end_reason == "complete" or (end_reason not in ev.SETTLED and all_done),
    )
