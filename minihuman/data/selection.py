"""One selection: which episodes of a study count. Every output takes one, and says what it left out and why.

What counts by default: every episode that was played to an end, that no reviewer marked ``exclude``, and that no rule
of the protocol's own leaves out, nor its participant.
"""

from collections.abc import Iterable
from dataclasses import dataclass, fields

from minihuman.data.counted import Counted
from minihuman.data.exclusions import UNFINISHED_OUTCOMES, broken_rule, rules_of
from minihuman.data.marks import Mark, read_marks, tags, tags_of
from minihuman.data.measured import Measured, Planner, Row, known_shortest, no_shortest
from minihuman.data.versions import is_version
from minihuman.recorded.episode import Episode, SessionLog
from minihuman.study.events import EpisodesSkipped
from minihuman.study.plan import SessionPlan

EXCLUDE = "exclude"  # a reviewer's tag that leaves an episode out unless it is asked for
UNFINISHED = "unfinished"  # abandoned, or cut off with the log
RULES = "rules"  # of the protocol: [[exclusions]]
NOT_FINISHED = "not played to an end"


@dataclass(frozen=True, slots=True)
class Selection:
    """What is asked for, and what of it counts. Several values of one field mean any of them; none means all.

    ``outcome`` to ``only`` say what is asked for. ``without`` are further tags that leave an episode out, and
    ``with_`` takes back in what is left out by default: "exclude" or another tag, "unfinished", "rules".
    """

    outcome: tuple[str, ...] = ()
    block: tuple[str, ...] = ()
    participant: tuple[str, ...] = ()
    version: tuple[str, ...] = ()  # of the protocol: as it says itself, or the start of its SHA-256
    only: tuple[str, ...] = ()  # tags: episodes that carry one of them
    without: tuple[str, ...] = ()
    with_: tuple[str, ...] = ()

    def __str__(self) -> str:
        """As the command line takes it: "--block grid --with exclude"; "" for the default."""
        return " ".join(
            f"--{field.name.rstrip('_')} {value}" for field in fields(self) for value in getattr(self, field.name)
        )

    def judge(
        self,
        log: SessionLog,
        *,
        measured: Measured | None = None,
        marks: Iterable[Mark] | None = None,
    ) -> Counted:
        """Say of each of a session's episodes whether it is asked for, and whether it counts.

        The protocol's rules are judged by the whole session, whatever part of it is asked for. ``measured`` spares
        measuring for them; ``marks`` are otherwise read from beside the log.

        Raises:
            LogError: if the marks beside the log cannot be understood.
            ProtocolError: if the protocol in the log cannot be understood.
            ReportError: if the protocol excludes by a measure that there is not.
        """
        rules = () if RULES in self.with_ else rules_of(log.plan)
        if rules and measured is None:
            measured = Measured.of(log, self.planner(log.plan, with_shortest=False))
        marks = read_marks(log.path) if marks is None else tuple(marks)
        in_force = tags(marks)
        theirs = [tags_of(episode, in_force) for episode in log.episodes]
        reasons = [self._reason(episode, tags) for episode, tags in zip(log.episodes, theirs, strict=True)]
        of_session = ""
        if rules and measured is not None:
            reasons = [
                reason or broken_rule(rules, "episode", row) for reason, row in zip(reasons, measured.rows, strict=True)
            ]
            counting = [place for place, reason in enumerate(reasons) if not reason]
            of_session = broken_rule(rules, "participant", measured.over(counting) | about_session(log))
        asked = [self._asks_for(log, episode, tags) for episode, tags in zip(log.episodes, theirs, strict=True)]
        wanted = any(asked) if log.episodes else self._asks_for_session(log)
        return Counted(log, tuple(theirs), tuple(asked), tuple(reasons), wanted, marks, of_session)

    def planner(self, plan: SessionPlan, *, with_shortest: bool) -> Planner:
        """Who says how few steps an episode could have taken: nobody, unless that is wanted or a rule asks for it."""
        asked_by_rule = RULES not in self.with_ and any(rule.needs_world for rule in rules_of(plan))
        return known_shortest if with_shortest or asked_by_rule else no_shortest

    def _asks_for(self, log: SessionLog, episode: Episode, theirs: frozenset[str]) -> bool:
        return (
            (not self.outcome or episode.outcome_word in self.outcome)
            and (not self.block or episode.plan.block_name in self.block)
            and self._is_of(log)
            and (not self.only or bool(theirs & set(self.only)))
        )

    def _asks_for_session(self, log: SessionLog) -> bool:
        """Whether a session without an episode is asked for: not where episodes of one kind are."""
        return self._is_of(log) and not (self.outcome or self.block or self.only)

    def _is_of(self, log: SessionLog) -> bool:
        return (not self.participant or log.plan.participant.id in self.participant) and (
            not self.version or any(is_version(log.plan, version) for version in self.version)
        )

    def _reason(self, episode: Episode, theirs: frozenset[str]) -> str:
        if unwanted := theirs & (({EXCLUDE} | set(self.without)) - set(self.with_)):
            return f"tagged {' '.join(sorted(unwanted))}"
        if episode.outcome_word in UNFINISHED_OUTCOMES and UNFINISHED not in self.with_:
            return NOT_FINISHED
        return ""


EVERYTHING = Selection(with_=(EXCLUDE, UNFINISHED, RULES))
"""Whatever was recorded."""


def about_session(log: SessionLog) -> Row:
    """What the table "participants" says of a session as a whole; ``completed_share`` is of the planned episodes."""
    completed = {episode.number for episode in log.episodes if episode.outcome_word not in UNFINISHED_OUTCOMES}
    skipped = sum(event.count for event in log.part_events if isinstance(event, EpisodesSkipped))
    planned = len(log.plan.episodes) - skipped
    return {
        "player": log.player,
        "window": log.segments[0].facts.get("window", "") if log.segments else "",
        "started_at": log.started_at,
        "end_reason": log.end_reason,
        "clean": log.clean,
        "segments": len(log.segments),
        "completed_share": len(completed) / planned if planned else None,
    }
