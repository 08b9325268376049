"""Select the sessions and episodes of a study that are included, and give the reasons why others are excluded.

Every output takes one ``Selection`` and prints its summary. By default an episode is included if it was completed, no
reviewer tagged it ``exclude``, and no exclusion rule of the protocol excludes it or its participant. Protocol versions
are distinguished by their own name and by the SHA-256 of their bytes.
"""

import json
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache
from typing import Any, Literal

from minihuman.dataset.annotations import (
    Annotation,
    collect_tags,
    list_episode_tags,
    read_annotations,
    split_annotations,
)
from minihuman.dataset.answer_rules import breaks_answer_rule, is_outside, list_compared_answers
from minihuman.dataset.log_files import SkippedLog, list_other_sessions, map_logs
from minihuman.dataset.measure_columns import COLUMNS_NEEDING_WORLD, EPISODES, PARTICIPANTS
from minihuman.dataset.session_measures import (
    MeasureRow,
    PathPlanner,
    SessionMeasures,
    find_path_bounds,
    skip_path_bounds,
)
from minihuman.errors import ReportError
from minihuman.experiment.machine.events import EpisodesSkipped, Noted
from minihuman.experiment.machine.page_alterations import list_page_alterations
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.experiment.protocol.protocol import ExclusionSpec, decode_logged_protocol
from minihuman.experiment.protocol.specs import apply_overrides
from minihuman.log.evidence import find_evidence
from minihuman.log.model.session_log import CUT_OFF, EpisodeLog, SessionLog
from minihuman.moved import warn_of_old_name

_ENOUGH = 6  # digits of a SHA-256 that identify a protocol


def format_version(plan: SessionPlan) -> str:
    """Format the version of a session's protocol with the start of its hash, e.g. "1 (d3b07384)"."""
    return f"{plan.study_version} ({plan.protocol_sha256[:8]})"


def matches_version(plan: SessionPlan, version: str) -> bool:
    """Return whether a session was played under a protocol version.

    The version is given by its own name, as formatted by ``format_version``, or as the start of its SHA-256.
    """
    by_hash = len(version) >= _ENOUGH and plan.protocol_sha256.startswith(version)
    return by_hash or version in (plan.study_version, format_version(plan))


UNFINISHED_OUTCOMES = ("abandoned", "agent_failed", CUT_OFF)
_MEASURED_KINDS = ("integer", "number", "boolean")
_COLUMNS = {"episode": EPISODES, "participant": PARTICIPANTS}


def check_exclusion_measures(exclusions: Sequence[ExclusionSpec], source: str) -> None:
    """Check that every exclusion rule uses an existing measure, and labels only at the level of episodes.

    Raises:
        ReportError: if a rule does not; the message begins with ``source`` (which protocol) and the rule's path.
    """
    for number, rule in enumerate(exclusions):
        path = f"{source}: $.exclusions[{number}]"
        if rule.level != "episode" and (rule.where or rule.measured_label):
            raise ReportError(f"{path}: a participant has no labels; use level = 'episode'")
        if rule.measured_label or (rule.question and rule.level == "participant"):
            continue
        measures = [column.name for column in _COLUMNS[rule.level] if column.kind in _MEASURED_KINDS]
        if rule.measure not in measures:
            level = "an episode" if rule.level == "episode" else "a participant"
            names = ", ".join(measures)
            raise ReportError(f"{path}.measure: {rule.measure!r} is not a measure of {level}; use one of {names}")


@lru_cache(maxsize=16)
def _read_exclusions(protocol_toml: bytes, source: str) -> tuple[ExclusionSpec, ...]:
    """Decode a protocol's exclusion rules and check that their measures exist; messages name it by ``source``."""
    exclusions = decode_logged_protocol(protocol_toml, source).exclusions
    check_exclusion_measures(exclusions, source)
    return exclusions


def find_practice_blocks(plan: SessionPlan) -> frozenset[str]:
    """Return the names of a session's blocks that its protocol excludes from the analysis.

    Raises:
        ProtocolError: if the protocol in the log cannot be decoded.
    """
    if b"analysed" not in plan.protocol_toml:  # as in nearly all protocols; decoding would take a millisecond
        return frozenset()
    blocks = decode_logged_protocol(plan.protocol_toml).blocks
    group_blocks = (apply_overrides(block, plan.participant.group) for block in blocks)
    return frozenset(block.name for block in group_blocks if not block.analysed)


@dataclass(frozen=True, slots=True)
class ExclusionRule:
    """An exclusion rule of a protocol."""

    exclusion: ExclusionSpec

    @property
    def needs_world(self) -> bool:
        """Return whether the rule uses a measure that can be computed only from the world itself."""
        return self.exclusion.measure in COLUMNS_NEEDING_WORLD

    def broken_by(self, row: Mapping[str, Any]) -> bool:
        """Return whether a row of measures breaks the rule; one with other labels, or without the measure, does not."""
        rule = self.exclusion
        if rule.question:
            return any(breaks_answer_rule(answer, rule) for answer in row.get(rule.measure, ()))
        labels = json.loads(row.get("labels") or "{}")
        if any(labels.get(name) != level for name, level in rule.where.items()):
            return False
        if rule.measured_label:
            measured = labels.get(rule.measured_label)
        else:
            measured = row.get(rule.measure)
        if not isinstance(measured, int | float):  # unknown, or a text label
            return False
        return is_outside(measured, rule)


def read_exclusion_rules(plan: SessionPlan) -> tuple[ExclusionRule, ...]:
    """Read the exclusion rules of a session's own protocol, in the order in which they are tried.

    Raises:
        ReportError: if a rule uses a measure that does not exist, or a label at the level of participants.
        ProtocolError: if the protocol in the log cannot be decoded.
    """
    if not plan.protocol_toml:
        return ()
    return tuple(
        ExclusionRule(exclusion) for exclusion in _read_exclusions(plan.protocol_toml, f"the protocol of {plan.study}")
    )


def find_exclusion_reason(rules: Sequence[ExclusionRule], level: str, row: Mapping[str, Any]) -> str:
    """Return the reason of the first rule of a level that a row of its measures breaks; "" if it breaks none."""
    for rule in rules:
        if rule.exclusion.level == level and rule.broken_by(row):
            return rule.exclusion.reason
    return ""


ExclusionLevel = Literal["participant", "episode"]


@dataclass(frozen=True, slots=True)
class ExcludedItem:
    """An excluded selection: one selected episode, or all selected episodes of a participant in a session."""

    reason: str
    level: ExclusionLevel
    participant: str
    session: int
    episode: int | None = None  # None: the whole session
    attempt: int | None = None


@dataclass(frozen=True, slots=True, eq=False)
class SelectedSession:
    """A session under a selection: each episode's tags, whether it is selected, and why it is excluded, if it is."""

    log: SessionLog
    tags: tuple[frozenset[str], ...]
    selected: tuple[bool, ...]
    reasons: tuple[str, ...]  # why each episode is excluded; "" if it is not
    is_selected: bool = True  # whether the session is selected; it may have no episode
    marks: tuple[Annotation, ...] = ()  # all annotations beside the log, including revoked ones
    session_reason: str = ""  # why the participant is excluded; "" if they are not

    @property
    def asked(self) -> tuple[bool, ...]:
        """Return ``selected``. This is its name from an earlier version; the next version removes it."""
        warn_of_old_name("SelectedSession.asked", "SelectedSession.selected")
        return self.selected

    @property
    def wanted(self) -> bool:
        """Return ``is_selected``. This is its name from an earlier version; the next version removes it."""
        warn_of_old_name("SelectedSession.wanted", "SelectedSession.is_selected")
        return self.is_selected

    @property
    def episodes(self) -> tuple[EpisodeLog, ...]:
        """Return the included episodes, in the order in which they were played."""
        return tuple(self.log.episodes[index] for index in self.places)

    @property
    def places(self) -> tuple[int, ...]:
        """Return the indices of the included episodes among all of the session's episodes."""
        if self.session_reason:
            return ()
        return tuple(
            index
            for index, (is_selected, why) in enumerate(zip(self.selected, self.reasons, strict=True))
            if is_selected and not why
        )

    @property
    def counts(self) -> bool:
        """Return whether the session has an included episode or, if its plan has none, is selected and not excluded."""
        nothing_to_play = self.is_selected and not self.session_reason and not self.log.plan.episodes
        return bool(self.places) or nothing_to_play

    @property
    def session(self) -> SessionLog:
        """Return the session with only its included episodes."""
        return replace(self.log, episodes=self.episodes)

    @property
    def left_out(self) -> tuple[ExcludedItem, ...]:
        """List the selected episodes that are excluded.

        An excluded participant is listed as a single item.
        """
        session_key = self.log.plan.participant.id, self.log.plan.session
        if self.session_reason and self.is_selected:
            return (ExcludedItem(self.session_reason, "participant", *session_key),)
        return tuple(
            ExcludedItem(why, "episode", *session_key, episode.number, episode.attempt)
            for episode, is_selected, why in zip(self.log.episodes, self.selected, self.reasons, strict=True)
            if is_selected and why
        )


@dataclass(slots=True)
class SelectionSummary:
    """A summary of an output's data: how much is included, what is excluded and why, and what could not be read."""

    selection: str = ""  # as command-line options
    sessions: int = 0  # with an included episode, or without planned episodes
    episodes: int = 0  # included
    versions: Counter[tuple[str, str]] = field(default_factory=Counter)  # sessions by study and protocol version
    excluded_episodes: Counter[str] = field(default_factory=Counter)  # by reason
    excluded_participants: set[tuple[str, str, str]] = field(default_factory=set)  # reason, study and code
    skipped: list[SkippedLog] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)  # about this run, not about the data: for the terminal only

    @property
    def left_out(self) -> Counter[tuple[ExclusionLevel, str]]:
        """Count the excluded episodes and participants by level and reason; a participant counts once per study."""
        excluded: Counter[tuple[ExclusionLevel, str]] = Counter()
        excluded.update({("episode", reason): count for reason, count in self.excluded_episodes.items()})
        excluded.update(("participant", reason) for reason, _, _ in self.excluded_participants)
        return excluded

    def take(self, session: SelectedSession) -> None:
        """Add a session to the summary."""
        self.episodes += len(session.places)
        self.sessions += session.counts
        if session.is_selected:
            self.versions[session.log.plan.study, format_version(session.log.plan)] += 1
        for exclusion in session.left_out:
            if exclusion.level == "participant":
                self.excluded_participants.add((exclusion.reason, session.log.plan.study, exclusion.participant))
            else:
                self.excluded_episodes[exclusion.reason] += 1

    def add(self, other: "SelectionSummary") -> None:
        """Add the counts, the skipped logs and the notes of another summary to this one."""
        self.sessions += other.sessions
        self.episodes += other.episodes
        self.versions.update(other.versions)
        self.excluded_episodes.update(other.excluded_episodes)
        self.excluded_participants |= other.excluded_participants
        self.skipped += other.skipped
        self.notes += other.notes

    def lines(self) -> Iterator[str]:
        """Yield the summary, one line per fact; the first line is always present."""
        episodes = _format_count(self.episodes, "episode")
        sessions = _format_count(self.sessions, "session")
        included = f"{episodes} of {sessions} included"
        if self.selection:
            included += f" ({self.selection})"
        yield included
        for (level, reason), count in sorted(self.left_out.items()):
            yield f"excluded: {_format_count(count, level)}: {reason}"
        if len(self.versions) > 1:
            version_counts = []
            for (_, version), count in sorted(self.versions.items()):
                n_sessions = _format_count(count, "session")
                version_counts.append(f"{version} in {n_sessions}")
            versions = ", ".join(version_counts)
            yield f"several versions of the protocol: {versions}; choose one with --version"
        for log in self.skipped:
            yield log.line()


def _format_count(count: int, noun: str) -> str:
    if count == 1:
        return f"1 {noun}"
    return f"{count} {noun}s"


EXCLUDE = "exclude"  # a reviewer's tag that excludes an episode by default
UNFINISHED = "unfinished"  # abandoned, ended by a failed agent, or cut off with the log
RULES = "rules"  # of the protocol: [[exclusions]]
ANSWER_RULES = "answer-rules"  # those of them that compare answers
NOT_FINISHED = "not played to an end"
AGENT_FAILED = "the agent failed"


@dataclass(frozen=True, slots=True)
class Selection:
    """Which episodes are selected and included. Several values of one field mean any of them; an empty field means all.

    The fields from ``outcome`` to ``only`` select episodes. ``without`` names further tags that exclude an episode, and
    ``with_`` includes again what is excluded by default: "exclude" or another tag, "unfinished", "rules" or
    "answer-rules".
    """

    outcome: tuple[str, ...] = ()
    block: tuple[str, ...] = ()
    participant: tuple[str, ...] = ()
    version: tuple[str, ...] = ()  # of the protocol: its own name, or the start of its SHA-256
    only: tuple[str, ...] = ()  # tags; an episode needs one of them
    without: tuple[str, ...] = ()
    with_: tuple[str, ...] = ()

    def __str__(self) -> str:
        """Format the selection as command-line options, e.g. "--block grid --with exclude"; "" for the default."""
        return " ".join(
            f"--{field.name.rstrip('_')} {value}" for field in fields(self) for value in getattr(self, field.name)
        )

    def judge(
        self,
        log: SessionLog,
        *,
        measured: SessionMeasures | None = None,
        marks: Iterable[Annotation] | None = None,
    ) -> SelectedSession:
        """Return a session under this selection: which of its episodes are selected, and why some are excluded.

        The protocol's rules are applied to the whole session, whichever part of it is selected. ``measured`` holds the
        session's measures, if they have been computed; ``marks`` by default are read from the annotation file beside
        the log.

        Raises:
            LogError: if the annotations beside the log are not valid.
            ProtocolError: if the protocol in the log cannot be decoded.
            ReportError: if the protocol excludes by a measure that does not exist.
        """
        if marks is None:
            marks = read_annotations(log.path)
        marks, _ = split_annotations(log, marks)
        rules = self._read_rules(log.plan)
        if rules and measured is None:
            measured = SessionMeasures.of(log, self.planner(log.plan, with_shortest=False))
        in_force = collect_tags(marks)
        episode_tags = [list_episode_tags(episode, in_force) for episode in log.episodes]
        reasons, session_reason = self._apply_rules(log, rules, measured, episode_tags)
        if any(rule.exclusion.level == "participant" for rule in rules):
            session_reason = self._find_participant_reason(log, session_reason)
        selected = [
            self._selects_episode(log, episode, tags) for episode, tags in zip(log.episodes, episode_tags, strict=True)
        ]
        # a session without episodes is not selected by properties of episodes
        if log.episodes:
            is_selected = any(selected)
        else:
            is_selected = self._selects_session(log) and not (self.outcome or self.block or self.only)
        return SelectedSession(
            log, tuple(episode_tags), tuple(selected), tuple(reasons), is_selected, marks, session_reason
        )

    def _apply_rules(
        self,
        log: SessionLog,
        rules: Sequence[ExclusionRule],
        measured: SessionMeasures | None,
        episode_tags: Sequence[frozenset[str]],
    ) -> tuple[list[str], str]:
        """Return the reason to exclude each episode, and this session's reason to exclude its participant.

        A reason is "" if there is none. ``measured`` may be None without rules; ``episode_tags`` are those in force.
        """
        reasons = [
            self._find_episode_reason(episode, tags) for episode, tags in zip(log.episodes, episode_tags, strict=True)
        ]
        if not rules or measured is None:
            return reasons, ""
        reasons = [
            reason or find_exclusion_reason(rules, "episode", row)
            for reason, row in zip(reasons, measured.rows, strict=True)
        ]
        practice = find_practice_blocks(log.plan)
        included = [
            index
            for index, (reason, row) in enumerate(zip(reasons, measured.rows, strict=True))
            if not reason and row["block"] not in practice
        ]
        compared = [rule.exclusion.measure for rule in rules if rule.exclusion.question]
        row = measured.aggregate(included) | summarize_session(log) | list_compared_answers(log, compared)
        return reasons, find_exclusion_reason(rules, "participant", row)

    def _find_participant_reason(self, log: SessionLog, own_reason: str) -> str:
        """Return the reason to exclude the participant, from their first session that breaks a rule; "" if none does.

        ``own_reason`` is this session's. Other sessions are read, too: any can exclude the participant from all.
        """
        judgements = map_logs(list_other_sessions(log), self._judge_participant, processes=1)
        other_reasons = [judgement for judgement in judgements if not isinstance(judgement, SkippedLog)]
        reasons = [reason for _, reason in sorted([(log.plan.session, own_reason), *other_reasons])]
        return next(filter(None, reasons), "")

    def _judge_participant(self, log: SessionLog) -> tuple[int, str]:
        """Return a session's number, and the reason to exclude its participant judged by this session alone, or ""."""
        rules = self._read_rules(log.plan)
        in_force = collect_tags(read_annotations(log.path))
        episode_tags = [list_episode_tags(episode, in_force) for episode in log.episodes]
        measured: SessionMeasures | None = None
        if rules:
            measured = SessionMeasures.of(log, self.planner(log.plan, with_shortest=False))
        _, session_reason = self._apply_rules(log, rules, measured, episode_tags)
        return log.plan.session, session_reason

    def planner(self, plan: SessionPlan, *, with_shortest: bool) -> PathPlanner:
        """Return the function that bounds the fewest steps of an episode.

        It returns unknown bounds unless ``with_shortest`` requests them or a rule needs them.
        """
        if with_shortest or any(rule.needs_world for rule in self._read_rules(plan)):
            return find_path_bounds
        return skip_path_bounds

    def _read_rules(self, plan: SessionPlan) -> tuple[ExclusionRule, ...]:
        """Read the rules of the session's protocol, or none if this selection switches the rules off."""
        if RULES in self.with_:
            return ()
        rules = read_exclusion_rules(plan)
        if ANSWER_RULES in self.with_:
            return tuple(rule for rule in rules if not rule.exclusion.question)
        return rules

    def _selects_episode(self, log: SessionLog, episode: EpisodeLog, tags: frozenset[str]) -> bool:
        if self.outcome and episode.outcome_word not in self.outcome:
            return False
        if self.block and episode.plan.block_name not in self.block:
            return False
        if self.only and tags.isdisjoint(self.only):
            return False
        return self._selects_session(log)

    def _selects_session(self, log: SessionLog) -> bool:
        return (not self.participant or log.plan.participant.id in self.participant) and (
            not self.version or any(matches_version(log.plan, version) for version in self.version)
        )

    def _find_episode_reason(self, episode: EpisodeLog, tags: frozenset[str]) -> str:
        """Return why an episode is excluded by its tags or its outcome; "" if it is not."""
        unwanted_tags = tags & (({EXCLUDE} | set(self.without)) - set(self.with_))
        if unwanted_tags:
            return f"tagged {' '.join(sorted(unwanted_tags))}"
        if episode.outcome_word in UNFINISHED_OUTCOMES and UNFINISHED not in self.with_:
            if episode.outcome == "agent_failed":
                return AGENT_FAILED
            return NOT_FINISHED
        return ""


def summarize_session(log: SessionLog) -> MeasureRow:
    """Return the columns of the table "participants" that describe a session as a whole, whatever is selected.

    ``completed_share`` is the share of planned, not skipped episodes that were played to an end; None without any.
    """
    completed = {episode.number for episode in log.episodes if episode.outcome_word not in UNFINISHED_OUTCOMES}
    n_skipped = sum(event.count for event in log.part_events if isinstance(event, EpisodesSkipped))
    n_planned = len(log.plan.episodes) - n_skipped
    completed_share = None
    if n_planned:
        completed_share = len(completed) / n_planned
    station = log.segments[0].facts if log.segments else {}
    utc_offset_min = None
    if "utc_offset_min" in station:
        utc_offset_min = int(station["utc_offset_min"])
    return {
        "player": log.player,
        "evidence": find_evidence(log.facts),
        "window": station.get("window", ""),
        "started_at": log.started_at,
        "utc_offset_min": utc_offset_min,
        "end_reason": log.end_reason,
        "clean": log.clean,
        "segments": len(log.segments),
        "clock_notes": sum(isinstance(note, Noted) and note.is_about_clock for note in log.notes),
        "page_alterations": "; ".join(list_page_alterations(log.notes)),
        "completed_share": completed_share,
    }
