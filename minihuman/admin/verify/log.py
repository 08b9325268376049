"""Verify a whole log: its worlds and steps, and also every message, so that no change goes unnoticed.

The session is replayed. Each message is compared with its event (bytes, times and the previews for viewers), the plan
with the protocol's bytes, metadata and attachments with the plan, and the hash chain with all of it. The report begins
with the replay of the episodes.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from minihuman.admin.enrolment_entries import read_chain_heads
from minihuman.admin.policies import verify_advice
from minihuman.admin.verify.contents import LogContents, LogSegment, read_log_contents
from minihuman.admin.verify.episodes import (
    EpisodeVerification,
    are_proven_by_events,
    describe_other_rules,
    summarize_exact_replay,
    verify_episodes,
)
from minihuman.admin.verify.picture_verification import PictureVerification, verify_pictures
from minihuman.admin.verify.plan import compare_plan
from minihuman.admin.verify.world_tape import WorldPool, WorldTape
from minihuman.dataset.annotations import describe_useless_annotation, read_annotations, split_annotations
from minihuman.errors import MinihumanError
from minihuman.experiment.machine.activity import WorldFactory
from minihuman.experiment.machine.event_rules import find_violations
from minihuman.experiment.machine.events import EpisodeEnded, EpisodesSkipped, ModelCall, Stepped
from minihuman.experiment.protocol.protocol import decode_logged_protocol
from minihuman.experiment.replay import compare_replay
from minihuman.log import names as log_names
from minihuman.log.evidence import find_evidence
from minihuman.log.model.doubtful_presses import describe_doubtful_presses, find_doubtful_presses
from minihuman.log.model.session_log import SessionLog
from minihuman.log.names import CHAIN_KEY
from minihuman.log.paths import raise_as_log_error, study_folder
from minihuman.log.read.session_reader import list_session_files, read_log
from minihuman.log.record.live_log import build_attachments, build_segment_metadata
from minihuman.moved import forward_names
from minihuman.simulation.model_conversation import ConversationRecord, find_picture_size
from minihuman.storage.study_journals import ENROLMENT_FILE_NAME
from minihuman.trust import Trust, find_changed_sources, list_foreign_modules
from minihuman.worlds.adapters.world import World
from minihuman.worlds.isolation.isolated_world import IsolatedWorlds

MAX_DIFFERENCES = 20  # of a log, that are listed
_PACKAGE_LIST = "packages.txt"  # an attachment whose content depends on the machine


def find_log_differences(path: Path, make_world: WorldFactory) -> Iterator[str]:
    """Yield a line for each part of a log that does not follow from the rest of it; none if the log is proven.

    Segments recorded before session rules and hash chains existed are left to ``verify``.

    Args:
        path: the log.
        make_world: makes the worlds in which the log is replayed.

    Raises:
        LogError: if the log cannot be read.
        WorldError: if a world in its plan cannot be created here.
    """
    contents = read_log_contents(path)
    yield from contents.differences
    if not any(segment.provable for segment in contents.segments):
        return
    yield from _compare_attachments(contents)
    for index, segment in enumerate(contents.segments):
        if segment.provable:
            for difference in _find_segment_differences(contents, index, make_world):
                yield f"segment {segment.number}: {difference}"
    yield from _compare_chain_heads(path, contents)


def _find_segment_differences(contents: LogContents, index: int, make_world: WorldFactory) -> Iterator[str]:
    """Yield a line for each part of a segment that does not follow from the rest of the log.

    Args:
        contents: the contents of the log.
        index: the segment's index in them.
        make_world: makes the worlds in which the segment is replayed.
    """
    segment = contents.segments[index]
    segments_so_far = contents.segments[: index + 1]
    yield from _compare_metadata(segment)
    yield from _compare_end(segment, segments_so_far, finished=contents.finished)
    yield from compare_plan(segment)
    for rule in find_violations(segment.events):
        yield f"well-formed: {rule}"
    yield from _find_replay_differences(segment, make_world)


def _compare_chain_heads(path: Path, contents: LogContents) -> Iterator[str]:
    """Yield a line for each segment whose chain head differs from the one in the enrolment log, if that has one."""
    recorded_heads = _find_chain_heads(study_folder(path)).get(path.name, {})
    for segment in contents.segments:
        if segment.end is None or segment.number not in recorded_heads:
            continue
        chain = segment.end.get(CHAIN_KEY, "")
        recorded = recorded_heads[segment.number]
        if recorded != chain:
            yield (f"segment {segment.number} ended with chain {chain[:16]}; the enrolment log says {recorded[:16]}")


def find_chain_heads(log: Path) -> list[tuple[str, str]]:
    """Return the number and the chain head of each of a log's segments whose head the study's enrolment log has."""
    recorded_heads = _find_chain_heads(study_folder(log))
    return [head for file in list_session_files(log) for head in recorded_heads.get(file.name, {}).items()]


def is_of_our_worlds(log: Path) -> bool:
    """Return whether a log names no third-party module, whose code could change while this software stays the same.

    Raises:
        LogError: if the log cannot be read.
    """
    return not list_foreign_modules(episode.world for episode in read_log(log).plan.episodes)


def _find_chain_heads(study: Path) -> Mapping[str, Mapping[str, str]]:
    """Return the chain heads that a study's enrolment log has, by log and then by segment.

    A file is read again only if it has changed, since reading it for every session takes quadratic time.
    """
    try:
        facts = (study / ENROLMENT_FILE_NAME).stat()
    except OSError:  # it is in a database, or there is none
        return read_chain_heads(study)
    return _read_chain_heads(study, (facts.st_ino, facts.st_size, facts.st_mtime_ns, facts.st_ctime_ns))


@lru_cache(maxsize=2)
def _read_chain_heads(study: Path, version: tuple[int, ...]) -> Mapping[str, Mapping[str, str]]:
    """Return a study's chain heads from the cache, in which ``version`` identifies the content of the enrolment log."""
    return read_chain_heads(study)


def _find_replay_differences(segment: LogSegment, make_world: WorldFactory) -> Iterator[str]:
    """Compare a segment with its replay; yield the differences.

    If a model took part, every prompt, its picture and the parsing of answers are compared, too. A world that failed
    may end its process or run forever, so it is replayed in a separate process.
    """
    if segment.ended is not None and segment.ended.reason == "world_error":
        worlds = IsolatedWorlds(make_world)
        try:
            yield from _compare_with_replay(segment, worlds)
        finally:
            worlds.close()
        return
    yield from _compare_with_replay(segment, make_world)


def _compare_with_replay(segment: LogSegment, make_world: WorldFactory) -> Iterator[str]:
    """Yield the differences of a segment from its replay in this process, including the calls of a model."""
    started = segment.started
    if started is None or not any(isinstance(event, ModelCall) for event in segment.events):
        yield from compare_replay(segment.events, make_world)
        return
    spec = decode_logged_protocol(started.plan.protocol_toml).model
    picture_px = find_picture_size(spec)
    yield from compare_replay(segment.events, make_world, follow=ConversationRecord(spec).follow, picture_px=picture_px)


def _compare_attachments(contents: LogContents) -> Iterator[str]:
    """Yield the differences between a log's attachments and those that its plans require, each exactly once.

    Third parties' attachments are not compared, nor is the content of the list of packages.
    """
    names = set()
    expected = set()
    for segment in contents.segments:
        if segment.started:
            for name, _, content in build_attachments(segment.started.plan):
                names.add(name)
                if name != _PACKAGE_LIST:
                    expected.add((name, content))
    counts = Counter((attached.name, attached.data) for attached in contents.attached if attached.name in names)
    all_provable = all(segment.provable for segment in contents.segments)
    for (name, content), count in counts.items():
        if count > 1:
            yield f"attachment {name} is there twice"
        if all_provable and name != _PACKAGE_LIST and (name, content) not in expected:
            yield f"attachment {name} is not what the plan says"
    present = {name for name, _ in counts}
    for name in sorted(names - present):
        yield f"attachment {name} is missing"
    for name, content in expected - set(counts):
        if name in present:
            yield f"attachment {name} of {len(content)} bytes is missing"


def _compare_metadata(segment: LogSegment) -> Iterator[str]:
    """Yield the differences between the metadata at a segment's start and its plan."""
    started = segment.started
    if started is None:
        yield "its plan is missing"
        return
    expected = build_segment_metadata(started, int(segment.facts["started_unix_ns"]))
    names = {*expected, *segment.facts} - {"minihuman", "schema_version"}  # these depend on the software that wrote it
    for name in sorted(names):
        logged_fact = segment.facts.get(name)
        expected_fact = expected.get(name)
        if expected_fact != logged_fact:
            yield f"metadata {log_names.SEGMENT_METADATA}: {name} {logged_fact!r}, by the plan {expected_fact!r}"
    if segment.station != started.facts:
        yield f"metadata {log_names.FACTS_METADATA} is not what the plan's message says"


def _compare_end(segment: LogSegment, so_far: Sequence[LogSegment], *, finished: bool) -> Iterator[str]:
    """Yield the differences between the metadata at a segment's end and the contents of the segment.

    Args:
        segment: the segment.
        so_far: the segments up to this one, including it.
        finished: whether the log is finished, so that each segment must have an end.
    """
    end = segment.end
    if end is None:
        if finished:
            yield f"metadata {log_names.END_METADATA} is missing"
        return
    if end.get(CHAIN_KEY) != segment.head:
        logged = end.get(CHAIN_KEY, "none")
        yield f"the hash chain is {segment.head[:16]}, its end says {logged[:16]}: something was changed"
    for name, expected in _build_expected_end(segment, so_far).items():
        if end.get(name) != expected:
            yield f"metadata {log_names.END_METADATA}: {name} {end.get(name)!r}, by the messages {expected!r}"
    clean = end.get("clean")
    may_be_clean = segment.ended is not None
    if clean != "false" and not (clean == "true" and may_be_clean):
        yield f"metadata {log_names.END_METADATA}: clean {clean!r}, but the segment says no end"
    stopped = end.get("stopped", "")
    if stopped.startswith(log_names.FINISHED_LOG_WAS):
        yield stopped
    elif stopped and not stopped.startswith("cut off"):
        yield f"its live file was damaged: {stopped}"


def _build_expected_end(segment: LogSegment, so_far: Sequence[LogSegment]) -> dict[str, str]:
    """Return the metadata that a segment's end should have according to the messages of it and the segments before.

    Args:
        segment: the segment.
        so_far: the segments up to this one, including it.
    """
    events_so_far = [event for earlier in so_far for event in earlier.events]
    reason = "cut_off"
    if segment.ended is not None:
        reason = segment.ended.reason
    n_planned = 0
    if segment.started is not None:
        n_skipped = sum(event.count for event in events_so_far if isinstance(event, EpisodesSkipped))
        n_planned = len(segment.started.plan.episodes) - n_skipped
    n_steps = sum(isinstance(event, Stepped) for event in segment.events)
    expected = {
        "segment": segment.number,
        "reason": reason,
        "steps": str(n_steps),
        "last_message": str(segment.last_sequence),
        "planned": str(n_planned),
        "lasted_ns": str(segment.last_ns - segment.first_ns),
    }
    if all(earlier.provable for earlier in so_far):
        ends = [event for event in events_so_far if isinstance(event, EpisodeEnded)]
        completed = {end.episode for end in ends if end.outcome != "abandoned"}
        expected["completed"] = str(len(completed))
    return expected


def verify_session(log: Path, *, trust: bool = False, policies: bool = False) -> Iterator[tuple[str, bool]]:
    """Yield lines about a session, each with whether it reports success.

    Args:
        log: a log, or the folder of a single session, which can be in several files.
        trust: whether to trust the modules of the session's worlds from now on.
        policies: whether to verify the advice of its agents' policies, too.

    Raises:
        LogError: if the log or the file of a policy cannot be read.
        WorldError: if a world in the log cannot be created here, or is in a module that is not trusted.
    """
    session = read_log(log)
    if trust:
        Trust(modules=list_foreign_modules(episode.plan.world for episode in session.episodes)).record()
    yield from _describe_rules(session)
    differences: list[str] | None = None  # None until all files have been compared with their replay
    if are_proven_by_events(session):
        differences = _find_differences_in_one_replay(session, log)
    make_world = WorldTape().make_world
    if differences == []:
        steps = summarize_exact_replay(session)
        pictures = verify_pictures(session)
    else:
        steps, pictures = _replay_session(session, log, make_world)
    yield from _describe_replay(session, steps)
    if differences is None:
        differences = _find_session_differences(log, make_world)
    yield from _describe_differences(differences)
    if policies:
        yield from verify_advice(session, World)
    if find_evidence(session.facts) == "consistent":
        yield "imported from a page: consistent, not witnessed", True
    _, useless = split_annotations(session, read_annotations(session.path))
    for annotation in useless:
        yield describe_useless_annotation(annotation), False
    if pictures is not None:
        yield str(pictures), pictures.verdict != "different"
    if not steps.difference and not differences:
        yield f"{steps.episodes} episodes, {steps.steps} steps, all as logged", True


def _describe_rules(session: SessionLog) -> Iterator[tuple[str, bool]]:
    """Yield a line if the session was recorded by other rules of worlds than the current ones."""
    note = describe_other_rules(session)
    if note:
        yield note, True


def _describe_differences(differences: Sequence[str]) -> Iterator[tuple[str, bool]]:
    """Yield the first ``MAX_DIFFERENCES`` differences, and how many more there are, each as a failure."""
    yield from ((difference, False) for difference in differences[:MAX_DIFFERENCES])
    if len(differences) > MAX_DIFFERENCES:
        yield f"and {len(differences) - MAX_DIFFERENCES} more", False


def _find_differences_in_one_replay(session: SessionLog, log: Path) -> list[str] | None:
    """Return the differences in all files of a session; None if its episodes must be replayed on their own, too.

    Also None after an error, since the parts of a log are then verified one by one and errors reported in that order.
    """
    worlds = WorldPool()
    with suppress(MinihumanError):
        differences = _find_session_differences(log, worlds.make_world)
        return differences if worlds.all_repeat else None
    return None


def _replay_session(
    session: SessionLog, log: Path, make_world: WorldFactory
) -> tuple[EpisodeVerification, PictureVerification | None]:
    """Replay a session's episodes, and draw its pictures again if the episodes are as logged.

    Args:
        session: the session.
        log: the path of its log, for errors.
        make_world: makes the worlds of the episodes.

    Returns:
        The result for the episodes, and that for the pictures; None for pictures that were not drawn again.
    """
    with raise_as_log_error(log, "played again"):
        steps = verify_episodes(session, make_world)
        if steps.difference:
            return steps, None
        return steps, verify_pictures(session)


def _describe_replay(session: SessionLog, steps: EpisodeVerification) -> Iterator[tuple[str, bool]]:
    """Yield the warnings about a session and the first difference that the replay of its episodes found, if any."""
    for module in find_changed_sources(session.facts):
        yield f"recorded with another file of the module {module}", True
    if steps.difference:
        yield steps.difference, False
    if warning := describe_doubtful_presses(find_doubtful_presses(session)):
        yield warning, True
    if steps.n_other_renderer:
        yield f"{steps.n_other_renderer} episodes with an earlier renderer's pictures: these are not compared", True


def _find_session_differences(log: Path, make_world: WorldFactory) -> list[str]:
    """Return the differences in all files of a session.

    Raises:
        LogError: if a file cannot be read or replayed.
    """
    differences: list[str] = []
    for file in list_session_files(log):
        with raise_as_log_error(file, "proven"):
            differences += find_log_differences(file, make_world)
    return differences


if not TYPE_CHECKING:
    __getattr__ = forward_names(__name__)
