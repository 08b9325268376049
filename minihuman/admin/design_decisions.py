"""Run a study's adaptive designs at enrolment, from its enrolment log and finished logs, and verify their decisions.

A participant enters a decision only if the first session was finished and recorded in the enrolment log before it, so
the enrolment log later shows which participants were included.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from minihuman.admin.enrolment_entries import (
    ChainHeadRecorded,
    EnrolmentEntry,
    GroupDrawn,
    LookTaken,
    ParticipantWithdrawn,
    SlotTaken,
    list_taken_slots,
    read_enrolment_log,
)
from minihuman.errors import AllocationError
from minihuman.experiment.machine.events import FINAL_END_REASONS
from minihuman.experiment.plan.designs import (
    DesignSpec,
    EnrolledParticipant,
    EnrolmentDecision,
    EnrolmentDesign,
    GroupAssignment,
    make_enrolment_design,
)
from minihuman.experiment.plan.random_streams import make_draw
from minihuman.experiment.protocol.protocol import Protocol
from minihuman.log.model.session_log import EpisodeLog
from minihuman.log.paths import LOG_SUFFIX, session_folder
from minihuman.log.read.session_reader import read_log

_OUTCOMES: Mapping[str, Callable[[EpisodeLog], float]] = {
    "success": lambda episode: float(episode.outcome == "goal"),
    "reward": lambda episode: episode.return_,
    "steps": lambda episode: float(len(episode.actions)),
    "log_steps": lambda episode: float(np.log(max(1, len(episode.actions)))),
}


def assign_group(
    protocol: Protocol, lines: Sequence[EnrolmentEntry], study_dir: Path, index: int, stratum: str
) -> tuple[str, GroupAssignment | None]:
    """Assign the next participant's group by the protocol's design, from these lines and the finished logs.

    Args:
        protocol: the study's protocol.
        lines: the lines of the enrolment log so far.
        study_dir: the study's folder.
        index: the participant's index in the order of enrolment, which selects the random numbers.
        stratum: the participant's stratum; "" without strata.

    Returns:
        The group, and the statistics from which it was assigned; "" and None if no design assigns groups.
    """
    spec = protocol.allocation.design
    if spec is None:
        return "", None
    design = make_enrolment_design(spec)
    statistics, _ = _compute_statistics(protocol, design, lines, study_dir)
    decision = design.decide(statistics, stratum, make_draw(protocol.study.seed, "assignment", index))
    return decision.group, GroupAssignment(spec.name, design.version, statistics)


def decide_again(protocol: Protocol, assigned: GroupAssignment, index: int, stratum: str) -> EnrolmentDecision:
    """Return the decision that the protocol's design, which must exist, makes from logged statistics.

    Args:
        protocol: the study's protocol.
        assigned: the logged statistics.
        index: the participant's index in the order of enrolment, which selects the random numbers.
        stratum: the participant's stratum; "" without strata.
    """
    assert protocol.allocation.design is not None
    return make_enrolment_design(protocol.allocation.design).decide(
        assigned.statistics, stratum, make_draw(protocol.study.seed, "assignment", index)
    )


def take_look(protocol: Protocol, lines: Sequence[EnrolmentEntry], study_dir: Path, at: str) -> LookTaken | None:
    """Take the interim look that is due in a sequential study; return None if the study has no looks or none is due.

    Args:
        protocol: the study's protocol.
        lines: the lines of the enrolment log so far.
        study_dir: the study's folder.
        at: the time to record for the look, in ISO 8601 and UTC.

    Raises:
        AllocationError: if the study has stopped.
    """
    spec = protocol.allocation.stopping
    if spec is None:
        return None
    looks = [line for line in lines if isinstance(line, LookTaken)]
    require_not_stopped(looks)
    latest_look = looks[-1].look if looks else 0
    design = make_enrolment_design(spec)
    statistics, _ = _compute_statistics(protocol, design, lines, study_dir)
    look = int(statistics["look"])
    if look <= latest_look:
        return None
    decision = design.decide(statistics, "", make_draw(protocol.study.seed, "look", look))
    estimates = dict(decision.estimates)
    return LookTaken(look, spec.name, design.version, statistics, estimates, decision.stop, at)


def require_not_stopped(looks: Sequence[LookTaken]) -> None:
    """Check that a sequential study has not stopped, before a further participant is enrolled.

    Args:
        looks: the interim looks taken so far, in order.

    Raises:
        AllocationError: if the study has stopped.
    """
    if looks and looks[-1].stop:
        raise AllocationError(
            f"the study stopped at look {looks[-1].look} of its sequential design; report it, or remove "
            "$.allocation.stopping from the protocol to continue without it"
        )


def _compute_statistics(
    protocol: Protocol, design: EnrolmentDesign, lines: Sequence[EnrolmentEntry], study_dir: Path
) -> tuple[dict[str, Any], int]:
    """Compute a design's statistics from these lines of the enrolment log and the logs that they name.

    Args:
        protocol: the study's protocol.
        design: the design that assigns groups or decides when to stop.
        lines: the lines of the enrolment log before the decision.
        study_dir: the study's folder.

    Returns:
        The statistics, and the number of participants whose first session has ended but whose log is missing.
    """
    withdrawn = {line.withdrawn for line in lines if isinstance(line, ParticipantWithdrawn)}
    slots = {line.participant: line for line in list_taken_slots(lines) if line.participant not in withdrawn}
    outcomes: dict[str, float | None] = {}  # by participant, in the order in which their sessions ended
    n_missing = 0
    for name, segment in _list_ended_sessions(lines, design).items():
        code = name.partition("_")[0]
        log = session_folder(study_dir.parent, study_dir.name, code, 1) / name
        if log.is_file():
            outcomes[code] = _compute_mean_outcome(log, log.stat().st_size, segment, design.outcome, design.block)
        elif code in slots:
            n_missing += 1
    enrolled = []
    for code in (*outcomes, *(code for code in slots if code not in outcomes)):
        slot = slots.get(code)
        if slot is not None and slot.group:
            enrolled.append(EnrolledParticipant(slot.group, slot.stratum, outcomes.get(code)))
    ratios = {group.name: group.allocation_ratio for group in protocol.groups}
    return design.compute_statistics(enrolled, ratios), n_missing


def _list_ended_sessions(lines: Sequence[EnrolmentEntry], design: EnrolmentDesign) -> dict[str, str]:
    """Return the number of the last segment of each participant's first session, by the name of the session's log.

    The logs are in the order in which they ended. For a design without an outcome, which needs no logs, nothing is
    returned.
    """
    segments: dict[str, str] = {}
    if not design.outcome:
        return segments
    for line in lines:
        if isinstance(line, ChainHeadRecorded) and line.sealed.endswith(f"_ses-01{LOG_SUFFIX}"):
            segments.pop(line.sealed, None)
            segments[line.sealed] = line.segment
    return segments


@lru_cache(maxsize=4096)
def _compute_mean_outcome(path: Path, size: int, segment: str, outcome: str, block: str) -> float | None:
    """Return the mean outcome of a block's finished episodes in a log.

    It is None if the session has not ended, ``segment`` is not the log's last one, or no episode has a known outcome.

    Args:
        path: the log.
        size: the log's size, so that the cache distinguishes a log that has grown.
        segment: the number of the segment that the enrolment log names last.
        outcome: the name of the outcome, as in ``_OUTCOMES``.
        block: the block's name; "" for all blocks.
    """
    log = read_log(path)
    if log.end_reason not in FINAL_END_REASONS or str(log.segments[-1].number) != segment:
        return None
    included: list[EpisodeLog] = []
    for episode in log.episodes:
        is_finished = episode.outcome not in (None, "abandoned")
        is_in_block = block in ("", episode.plan.block_name)
        is_unknown = outcome == "success" and episode.success is None
        if is_finished and is_in_block and not is_unknown:
            included.append(episode)
    if included:
        return float(np.mean([_OUTCOMES[outcome](episode) for episode in included]))
    return None


def verify_design_decisions(study: Path, protocol: Protocol) -> Iterator[tuple[str, bool]]:
    """Compare every assignment and look with the statistics recomputed from the enrolment log and the session logs.

    Yields:
        Lines, each with whether it reports success; nothing for a study without an adaptive design.
    """
    lines = read_enrolment_log(study)
    n_equal = 0
    n_without_logs = 0
    n_decisions = 0
    for number, line in enumerate(lines):
        decision = _find_decision(line, protocol)
        if decision is None:
            continue
        n_decisions += 1
        if decision.spec is None:
            yield f"{decision.name}: decided by a design that the protocol does not have", False
            continue
        design = make_enrolment_design(decision.spec)
        statistics, n_missing = _compute_statistics(protocol, design, lines[:number], study)
        if n_missing:
            n_without_logs += 1
            continue
        difference = _find_decision_difference(decision, statistics, design, protocol)
        if difference:
            yield f"{decision.name}: {difference}", False
        else:
            n_equal += 1
    if n_decisions:
        without_logs = f"; {n_without_logs} use logs that are gone" if n_without_logs else ""
        yield f"{n_equal} of {n_decisions} decisions of the study's designs follow from its logs{without_logs}", True


@dataclass(frozen=True, slots=True)
class _LoggedDecision:
    """A design's decision, as recorded by a line of the enrolment log."""

    name: str  # the look's or the participant's name
    spec: DesignSpec | None  # None if the protocol has no such design
    statistics: Mapping[str, Any]
    look: LookTaken | None = None  # the interim look, if the line is about one


def _find_decision(line: EnrolmentEntry, protocol: Protocol) -> _LoggedDecision | None:
    """Return the design's decision that a line of the enrolment log records; None for a line of another kind."""
    match line:
        case LookTaken():
            return _LoggedDecision(f"look {line.look}", protocol.allocation.stopping, line.statistics, line)
        case SlotTaken(assigned=GroupAssignment() as assigned):
            return _LoggedDecision(line.participant, protocol.allocation.design, assigned.statistics)
        case GroupDrawn(assigned=GroupAssignment() as assigned):
            return _LoggedDecision(line.drawn, protocol.allocation.design, assigned.statistics)
    return None


def _find_decision_difference(
    decision: _LoggedDecision, statistics: Mapping[str, Any], design: EnrolmentDesign, protocol: Protocol
) -> str:
    """Describe how a decision differs from the one that follows from recomputed statistics; "" if it does not.

    Args:
        decision: the decision in the enrolment log.
        statistics: the statistics recomputed from the logs.
        design: the design that made the decision.
        protocol: the study's protocol, whose seed selects the random numbers.
    """
    if statistics != decision.statistics:
        return f"statistics {decision.statistics} in the enrolment log, by the logs {statistics}"
    look = decision.look
    if look is None:
        return ""
    recomputed = design.decide(decision.statistics, "", make_draw(protocol.study.seed, "look", look.look))
    if (recomputed.stop, dict(recomputed.estimates)) != (look.stop, look.estimates):
        return f"{look.estimates} in the enrolment log, now {recomputed.estimates}"
    return ""
