"""Sections of the report's page: statements about groups, survival, answers, recording quality, exclusions,
instruction clauses, and the CONSORT flow of participants.
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from minihuman.activities.questions.question import find_question_kind
from minihuman.admin.enrolment_entries import LookTaken, open_enrolment_log, read_enrolment_log
from minihuman.admin.status import GroupCounts, ParticipantFlow, count_all_interventions, count_participant_flow
from minihuman.dataset.log_files import SkippedLog
from minihuman.dataset.recording_quality import LATE_MS, RecordingQuality
from minihuman.errors import AllocationError, LogError, ProtocolError
from minihuman.reporting.results import (
    BlockResults,
    BlockSurvival,
    EquivalenceResult,
    Role,
    SessionChange,
    WithinResults,
    label_measure,
)
from minihuman.reporting.template import (
    AnswerCounts,
    Cell,
    Table,
    format_difference,
    format_interval,
    format_mean_sd,
    format_number,
    format_p_value,
    format_pair,
    format_with_interval,
    to_records,
)
from minihuman.statistics.comparison import GroupComparison, PowerAnalysis
from minihuman.statistics.paired import PairedComparison
from minihuman.statistics.reliability import Reliability
from minihuman.statistics.scores import wilson_interval
from minihuman.statistics.two_part_model import PartComparison, TwoPartComparison

_FACTORS = {  # of what a difference of logarithms is a factor
    "log_excess_steps_mean": "the excess steps, plus one",
    "log_steps_ratio_mean": "the steps",
}


def difference_statement(comparison: GroupComparison, block: str) -> str:
    """How far apart two groups are in a block, in one sentence."""
    name = label_measure(comparison.measure)
    per = "over" if comparison.is_log else "minus"
    opening = f"{name[0].upper()}{name[1:]}, block {block}: {comparison.first} {per} {comparison.second} "
    if comparison.reason and math.isnan(comparison.p):
        return f"{opening}was not compared ({comparison.reason})."
    if comparison.smallest_p >= 0.05:
        caveat = " Groups of these sizes cannot reach p < 0.05, whatever the difference."
    else:
        caveat = ""
    size = ""
    if not math.isnan(comparison.g):
        size = f"; standardised difference g {format_number(comparison.g, 2)}, interval {format_interval(comparison.g_interval, 2)}"
    return (
        f"{opening}is {_as_stated(comparison)}{_as_factor(comparison)}; permutation p {format_p_value(comparison.p)}{size}; "
        f"{comparison.n[0]} and {comparison.n[1]} participants).{caveat}"
    )


def _as_stated(comparison: GroupComparison | PairedComparison) -> str:
    """The difference, or the ratio that a difference of logarithms is, and its interval; the bracket stays open."""
    if comparison.is_log:
        bounds = (math.exp(comparison.interval[0]), math.exp(comparison.interval[1]))
        ratio = format_number(math.exp(comparison.difference))
        return f"{ratio} (ratio of geometric means; 95 % interval {format_interval(bounds)}"
    return f"{format_number(comparison.difference, sign='+')} (95 % interval {format_interval(comparison.interval, sign='+')}"


def paired_statement(comparison: PairedComparison) -> str:
    """How far apart two conditions are within participants, in one sentence."""
    name = label_measure(comparison.measure)
    if comparison.smallest_p >= 0.05:
        caveat = " So few participants cannot reach p < 0.05, whatever the difference."
    else:
        caveat = ""
    per = "over" if comparison.is_log else "minus"
    return (
        f"{name[0].upper()}{name[1:]}, within participants: {comparison.first} {per} {comparison.second} "
        f"is {_as_stated(comparison)}; paired permutation p {format_p_value(comparison.p)}, Holm {format_p_value(comparison.p_holm)}; "
        f"{comparison.n} participants).{caveat}"
    )


def conditions_table(within: WithinResults) -> Table | None:
    """Conditions compared within participants."""
    rows = [
        (
            label_measure(comparison.measure), within.roles[comparison.measure], format_pair(comparison.first, comparison.second), str(comparison.n),
            ", ".join(map(format_number, comparison.means)),
            format_difference(comparison.difference, comparison.interval, is_log=comparison.is_log),
            format_p_value(comparison.p), format_p_value(comparison.p_holm), format_p_value(comparison.smallest_p),
        )
        for comparison in within.comparisons
    ]  # fmt: skip
    heads = ("measure", "named before", "conditions", "n", "means", "difference", "p", "p (Holm)", "smallest p")
    return Table(heads, rows, words=3) if rows else None


def crossover_table(within: WithinResults) -> Table | None:
    """Effects of condition, position and carry-over; None where the order is the same for everyone."""
    rows = [
        (
            label_measure(term.measure), term.effect, f"{term.freedom[0]}, {term.freedom[1]}", format_number(term.f),
            format_p_value(term.p),
        )
        for term in within.effects
    ]  # fmt: skip
    if rows:
        return Table(("measure", "effect", "degrees of freedom", "F", "p"), rows, words=2)
    return None


def _as_factor(comparison: GroupComparison) -> str:
    """What a difference of logarithms of steps means: by how much they are multiplied."""
    quantity = _FACTORS.get(comparison.measure)
    if quantity is None or math.isnan(comparison.interval[0]):
        return ""
    factor = math.exp(comparison.difference)
    bounds = (math.exp(comparison.interval[0]), math.exp(comparison.interval[1]))
    return f"; as a factor of {quantity}: {format_number(factor, 2)}, {format_interval(bounds, 2)}"


def equivalence_statement(equivalence: EquivalenceResult, roles: Mapping[str, Role]) -> str:
    """Whether two groups are shown to be equivalent, in one sentence."""
    (primary,) = (name for name, role in roles.items() if role == "primary")
    name = label_measure(primary)
    verdict = "are equivalent" if equivalence.test.alike else "are not shown to be equivalent"
    return (
        f"{name[0].upper()}{name[1:]}: {equivalence.first} and {equivalence.second} {verdict} within {equivalence.test.bounds[1]:g}, the "
        f"protocol's margin (two one-sided tests, p {format_p_value(equivalence.test.p)}; 90 % interval of the difference "
        f"{format_interval(equivalence.test.interval, sign='+')})."
    )


def power_statement(power: PowerAnalysis) -> str:
    """What the sample could show, in one sentence."""
    a, b = power.n
    if math.isnan(power.power_for_large):
        return f"Power: with {a} and {b} participants no difference between groups can be tested."
    return (
        f"Power: with {a} and {b} participants a two-sided t test at 5 %, before any correction, detects a "
        f"difference of 0.8 standard deviations with a power of {100 * power.power_for_large:.0f} %; a power of 80 % "
        f"needs one of {power.detectable_g:.2f} standard deviations, or {power.needed_for_large} participants per "
        f"group for one of 0.8."
    )


def survival_table(survival: BlockSurvival) -> Table | None:
    """Key discovery compared; participants who never discovered all keys are censored."""
    rows = [
        (
            format_pair(a, b), f"{comparison.n[0]}, {comparison.n[1]}", f"{comparison.censored[0]}, {comparison.censored[1]}",
            format_number(comparison.until), f"{format_number(comparison.means[0])}, {format_number(comparison.means[1])}",
            format_with_interval(comparison.difference, comparison.interval, sign="+"), format_p_value(comparison.p),
            format_p_value(comparison.logrank_p),
        )
        for a, b, comparison in survival.compared
    ]  # fmt: skip
    heads = ("groups", "n", "never", "observed (s)", "restricted means (s)", "difference (95 %)", "p", "curves: p")
    return Table(heads, rows) if rows else None


def reliability_table(reliabilities: Sequence[Reliability]) -> Table | None:
    """How well each measure tells participants apart."""
    rows = [
        (
            label_measure(reliability.measure), str(reliability.participants), str(reliability.episodes),
            format_with_interval(reliability.icc, reliability.icc_interval), format_with_interval(reliability.halves, reliability.halves_interval),
        )
        for reliability in reliabilities
    ]  # fmt: skip
    if rows:
        return Table(("measure", "participants", "episodes", "one episode: ICC", "all: split-half"), rows)
    return None


def session_table(block: BlockResults) -> Table | None:
    """Each session's values, and the change from the block's first session to each later one; None of one session."""
    sessions = sorted(block.by_session["session"].unique())
    if len(sessions) < 2:
        return None
    values = {(row["measure"], row["group"], row["session"]): row for row in to_records(block.by_session)}
    changes = {(change.measure, change.group, change.sessions[1]): change for change in block.changes}

    def session_cell(row: Mapping[str, Any] | None) -> str:
        if row is not None and row["n"]:
            return format_mean_sd(row["mean"], row["sd"])
        return "\N{EN DASH}"

    def change_cells(change: SessionChange | None) -> tuple[str, ...]:
        if change is None:
            return ("0", "\N{EN DASH}", "\N{EN DASH}")
        estimate = format_difference(change.estimate, change.interval, is_log=change.is_log, sign="+")
        return (str(change.n), estimate, format_p_value(change.p))

    rows = [
        (
            label_measure(measure), group,
            *(session_cell(values.get((measure, group, session))) for session in sessions),
            *(cell for session in sessions[1:] for cell in change_cells(changes.get((measure, group, session)))),
        )
        for measure, group in dict.fromkeys((measure, group) for measure, group, _ in values)
    ]  # fmt: skip
    has_several_changes = len(sessions) > 2
    heads = (
        "measure", "group", *(f"session {session}" for session in sessions),
        *(
            f"{head}, {sessions[0]} to {session}" if has_several_changes else head
            for session in sessions[1:] for head in ("n", "change", "p")
        ),
    )  # fmt: skip
    return Table(heads, rows, words=2)


def session_changes_table(block: BlockResults) -> Table | None:
    """Groups compared on their change between sessions; None where there is none, or one group alone."""
    has_several_changes = len({sessions for sessions, _ in block.changes_compared}) > 1
    rows = [
        (
            label_measure(comparison.measure) + (f", session {first} to {later}" if has_several_changes else ""),
            format_pair(comparison.first, comparison.second), f"{comparison.n[0]}, {comparison.n[1]}",
            format_difference(comparison.difference, comparison.interval, is_log=comparison.is_log, sign="+"),
            format_p_value(comparison.p), format_p_value(comparison.p_holm),
        )
        for (first, later), comparison in block.changes_compared
    ]  # fmt: skip
    if rows:
        return Table(("measure", "groups", "n", "difference of changes", "p", "p (Holm)"), rows, words=2)
    return None


def parts_table(comparisons: Sequence[TwoPartComparison]) -> Table | None:
    """Both parts of a reward that has mass at 0, compared."""
    rows = [
        (
            format_pair(comparison.first, comparison.second), f"{comparison.n[0]}, {comparison.n[1]}",
            f"{comparison.shares[0]:.1%}, {comparison.shares[1]:.1%}",
            *(text for part in (comparison.any, comparison.amount) for text in (_part(part), format_p_value(part.p))),
            format_p_value(comparison.p),
        )
        for comparison in comparisons
    ]  # fmt: skip
    heads = ("groups", "n", "earned", "odds ratio", "p", "difference where earned", "p", "p of both")
    return Table(heads, rows) if rows else None


def list_missing_parts(comparisons: Sequence[TwoPartComparison]) -> list[str]:
    """The reason of each part that could not be compared."""
    return [
        f"{part_name}, {format_pair(comparison.first, comparison.second)}: {part.reason}"
        for comparison in comparisons
        for part_name, part in (("odds", comparison.any), ("difference", comparison.amount))
        if part.reason
    ]


def _part(part: PartComparison) -> str:
    if part.reason:
        return format_number(part.estimate)
    return format_with_interval(part.estimate, part.interval)


_MOST_ANSWERS = 8  # of a question, that are listed one by one
_GIVEN_ONCE = ["participant", "session", "part", "questions", "item", "attempt"]  # who goes back answers anew


def _has_mean(kind: str) -> bool:
    """Whether answers to a kind of question have a mean; not known of a plug-in's that is not installed here."""
    try:
        return find_question_kind(kind).answer_type in ("rating", "number")
    except ProtocolError:
        return False


def answers_table(answers: pd.DataFrame) -> Table | None:
    """Every question: how often each answer was given, or its mean and range, and how long it took.

    One that was asked in several sessions, or several times in one, has a row for each: a second day's answers are not
    the first day's, and those after a block not those after the one before.
    """
    if answers.empty:
        return None
    rows: list[tuple[Cell, ...]] = []
    last = answers.drop_duplicates(_GIVEN_ONCE, keep="last")
    times = last.groupby(["participant", "session", "questions"])["part"].rank(method="dense").astype(int)
    last = last.assign(time=times)  # how often they had been asked in that session, 1 for the first
    whens = [when for when in ("session", "time") if (last.groupby(["questions", "item"])[when].nunique() > 1).any()]
    in_order: list[tuple[object, ...]] = list(zip(last["questions"], last["item"], strict=True))  # as first asked
    by_question = last.groupby(["questions", "item", "session", "time"])
    for (part, item, *which), group_answers in sorted(
        by_question, key=lambda keyed_answers: (in_order.index(keyed_answers[0][:2]), keyed_answers[0][2:])
    ):
        numbers = group_answers["number"].dropna()
        if len(numbers) and all(map(_has_mean, set(group_answers["kind"]))):
            mean, low, high = (
                format_number(float(statistic)) for statistic in (numbers.mean(), numbers.min(), numbers.max())
            )
            none = len(group_answers) - len(numbers)
            summary: Cell = f"mean {mean}, {low} to {high}" + (f"; none ({none})" if none else "")
        else:
            counts = group_answers["said"].fillna(group_answers["answer"]).fillna("nothing").value_counts()
            most = tuple((str(answer), int(count)) for answer, count in counts.head(_MOST_ANSWERS).items())
            summary = AnswerCounts(most, max(len(counts) - _MOST_ANSWERS, 0))
        right = group_answers["right"].dropna()
        if len(right):
            share = f"{100 * float(right.astype(float).mean()):.0f} %"
        else:
            share = "\N{EN DASH}"
        took = format_number(float(group_answers["answer_ms"].median()) / 1000)
        when = [str(number) for name, number in zip(("session", "time"), which, strict=True) if name in whens]
        rows.append((str(part), str(item), *when, summary, str(len(group_answers)), share, took))
    heads = ("questions", "question", *whens, "answers", "n", "right", "median time (s)")
    return Table(heads, rows, words=3 + len(whens))


class QualitySection(NamedTuple):
    """How well sessions were recorded, in a sentence and one by one."""

    lead: str
    displays: Sequence[str]
    table: Table


def quality_section(qualities: Sequence[RecordingQuality]) -> QualitySection:
    """Late presses, pictures, focus, pauses, display."""
    rows: list[tuple[str, ...]] = [
        (
            quality.participant, str(quality.session), str(quality.presses),
            *((f"{quality.late}", format_number(quality.latest_ms)) if _sat(quality) else ("n/a", "n/a")),
            f"{quality.pictures_missing} of {quality.steps}" if _sat(quality) else "n/a",
            *(format_number(ms) if _sat(quality) else "n/a" for ms in quality.key_to_flip_ms),
            str(quality.focus_lost), f"{quality.pauses}, {quality.paused_s:.0f} s",
            f"{quality.segments}{'' if quality.clean else ', cut off'}",
        )
        for quality in qualities
    ]  # fmt: skip
    heads: tuple[str, ...] = (
        "participant", "session", "presses", f"late (over {LATE_MS:g} ms)", "latest (ms)", "frames missing",
        "key to flip: median", "95 %", "99 % (ms)", "focus lost", "pauses", "segments",
    )  # fmt: skip
    if not any(map(_sat, qualities)):  # nothing was timed
        rows = [row[:3] + row[9:] for row in rows]
        heads = heads[:3] + heads[9:]
    displays = sorted(
        {
            ", ".join(f"{name} {value}" for name, value in display.items())
            for quality in qualities
            for display in quality.displays
        }
    )
    timed = [quality for quality in qualities if _sat(quality)]
    presses = sum(quality.presses for quality in timed)
    late = sum(quality.late for quality in timed)
    slowest = np.array([quality.key_to_flip_ms[2] for quality in timed])
    slowest = slowest[~np.isnan(slowest)]
    lead = f"{late} of {presses} presses were processed more than {LATE_MS:g} ms after the key moved"
    if slowest.size:
        lead += (
            f"; in every session 99 % of frames appeared within {format_number(float(slowest.max()))} ms of their key"
        )
    if periods := sum(quality.periods for quality in timed):
        missed = sum(quality.periods_missed for quality in timed)
        lead += f"; {missed} of {periods} periods of real time passed without a step"
    for quality in qualities:
        if quality.doubtful_presses:
            lead += f"; {quality.participant}, session {quality.session}: {quality.doubtful_presses}"
    if len(timed) < len(qualities):
        none = f"{len(qualities) - len(timed)} sessions had neither keyboard nor display, so nothing was timed"
        lead = f"{lead}. {none}" if timed else none
    return QualitySection(lead, [display for display in displays if display], Table(heads, rows))


def _sat(quality: RecordingQuality) -> bool:
    """Whether a session had a display and a keyboard: a simulated window has a clock of its own."""
    return any(display.get("window") != "simulated" for display in quality.displays)


class ExclusionsSection(NamedTuple):
    """The exclusions: totals by rule, and each one."""

    totals: Table
    each: Table


def exclusions_section(rows: pd.DataFrame) -> ExclusionsSection | None:
    """What is excluded; None where nothing is."""
    if rows.empty:
        return None
    single = rows[(rows["level"] != "participant") | ~rows.duplicated(["exclusion_reason", "level", "participant"])]
    counts = single.groupby(["exclusion_reason", "level"]).size().reset_index(name="count")
    totals = [(row["exclusion_reason"], row["level"], str(row["count"])) for row in to_records(counts)]
    exclusions = [
        (
            row["exclusion_reason"],
            row["participant"],
            str(row["session"]),
            "all" if pd.isna(row["episode"]) else str(row["episode"]),
        )
        for row in to_records(rows)
    ]
    return ExclusionsSection(
        Table(("reason", "level", "removed"), totals, words=2),
        Table(("reason", "participant", "session", "episode"), exclusions, words=2),
    )


def skipped_table(logs: Sequence[SkippedLog]) -> Table:
    """Logs that could not be read, and why."""
    return Table(("log", "reason"), [(str(log.path), log.reason) for log in logs], words=2)


VERBS = {"GoTo": "go to", "Open": "open", "Pickup": "pick up", "PutNext": "put next to"}  # by a clause's type
ATTEMPT_COLUMNS = ["participant", "session", "segment", "episode"]  # one of an episode: a segment has one at most


def count_clauses(episodes: pd.DataFrame, starts: pd.DataFrame, completed: pd.DataFrame) -> pd.DataFrame:
    """Count the clauses that were asked for and done, by block, verb and group.

    Args:
        episodes: The table of episodes; only those that are included are counted.
        starts: The table of beginnings, for the missions.
        done: The table of clauses that were done.

    Returns:
        block, verb, group, asked, done, median_step (of those done); no row of blocks in which no clause was ever done.
    """
    included = episodes.loc[episodes["exclusion_reason"].isna(), [*ATTEMPT_COLUMNS, "block", "group"]]
    included = included.merge(starts[[*ATTEMPT_COLUMNS, "mission"]], on=ATTEMPT_COLUMNS)
    # the blocks whose worlds have instructions, as far as anything of one was done
    included = included[
        included["block"].isin(
            included.merge(completed[ATTEMPT_COLUMNS].drop_duplicates(), on=ATTEMPT_COLUMNS)["block"]
        )
    ]
    if included.empty:
        return pd.DataFrame(columns=["block", "verb", "group", "asked", "done", "median_step"])
    steps = completed[[*ATTEMPT_COLUMNS, "clause", "step"]]
    clause_rows = pd.DataFrame(_asked(included)).merge(steps, on=[*ATTEMPT_COLUMNS, "clause"], how="left")
    grouped = clause_rows.groupby(["block", "verb", "group"], sort=False)["step"]
    return grouped.agg(asked="size", done="count", median_step="median").reset_index()


def _asked(episodes: pd.DataFrame) -> list[dict[str, Any]]:
    """One row per clause of each episode's mission."""
    from minihuman.worlds.grid.babyai.language import clauses, parse  # brings Numba, which few reports need

    return [
        {
            **dict(zip([*ATTEMPT_COLUMNS, "block", "group"], row[:-1], strict=True)),
            "clause": at,
            "verb": VERBS[type(clause).__name__],
        }
        for row in episodes.itertuples(index=False)
        for at, clause in enumerate(clauses(parse(str(row.mission))), start=1)
    ]


def clauses_table(rows: pd.DataFrame) -> Table | None:
    """How many clauses of instructions were done; None where no world had instructions."""
    cells = [
        (
            row["block"], row["verb"], row["group"], str(row["asked"]),
            format_with_interval(row["done"] / row["asked"], wilson_interval(row["done"], row["asked"]), 2),
            format_number(float(row["median_step"])) if row["done"] else "\N{EN DASH}",
        )
        for row in to_records(rows)
    ]  # fmt: skip
    if cells:
        return Table(("block", "clause", "group", "asked", "done", "step"), cells, words=3)
    return None


class FlowSection(NamedTuple):
    """The participants by stage; no table where the enrolment log cannot be read."""

    table: Table | None
    interventions: str = ""  # what was done by hand, in counts
    looks: Table | None = None  # of a sequential study


def flow_section(source: Path, participants: pd.DataFrame) -> FlowSection | None:
    """Count who came, left and is included; None unless the report is of a study's whole folder with its enrolment log.

    Args:
        source: what the report is of.
        participants: the table of participants; those without a reason in ``exclusion_reason`` are included.
    """
    try:
        if not source.is_dir() or not open_enrolment_log(source).begun:
            return None
        flow = count_participant_flow(source)
        by_hand = count_all_interventions(source)
    except (AllocationError, LogError):  # no other number depends on it; the error names folders: it is not given here
        return FlowSection(None)
    counting = participants[participants["exclusion_reason"].isna()].groupby("group")["participant"].nunique()
    counts = {str(group): int(n) for group, n in counting.items()}
    table = flow_table(flow, counts, _count_excluded(participants))
    looks = [line for line in read_enrolment_log(source) if isinstance(line, LookTaken)]
    return FlowSection(table, ", ".join(f"{count} {label}" for label, count in by_hand.items()), looks_table(looks))


def looks_table(looks: Sequence[LookTaken]) -> Table | None:
    """A row per look at a sequential study; None without any."""
    estimates = list(
        dict.fromkeys(name for look in looks for name in look.estimates if name not in ("look", "crossed"))
    )
    rows = [
        (
            str(look.look),
            *(str(int(statistic[0])) for statistic in _find_groups(look).values()),
            *(f"{look.estimates[name]:.3g}" if name in look.estimates else "\N{EN DASH}" for name in estimates),
            "stopped" if look.stop else "went on",
        )
        for look in looks
    ]
    if not rows:
        return None
    groups = [f"n, {group}" for group in _find_groups(looks[0])]
    names = {"p": "p, adjusted for the looks", "boundary": "stops at |z|"}
    return Table(("look", *groups, *(names.get(name, name) for name in estimates), "study"), rows)


def _find_groups(look: LookTaken) -> dict[str, Sequence[float]]:
    return {name: statistic for name, statistic in look.statistics.items() if isinstance(statistic, list) and statistic}


def _count_excluded(participants: pd.DataFrame) -> dict[str, dict[str, int]]:
    """How many participants are excluded from every session, by reason (of their first session) and group."""
    counting = set(participants.loc[participants["exclusion_reason"].isna(), "participant"])
    excluded = participants[~participants["participant"].isin(counting)].drop_duplicates("participant")
    counts: dict[str, dict[str, int]] = {}
    for (reason, group), rows in excluded.groupby(["exclusion_reason", "group"]):
        counts.setdefault(str(reason), {})[str(group)] = len(rows)
    return counts


def flow_table(
    flow: ParticipantFlow, counting: Mapping[str, int], excluded: Mapping[str, Mapping[str, int]] | None = None
) -> Table:
    """A row per stage, a column per group; ``excluded`` are those excluded from every session, by reason."""
    groups = sorted({*flow.allocated, *counting})

    def row(label: str, counts: GroupCounts) -> tuple[str, ...]:
        return (label, str(sum(counts.values())), *(str(counts.get(group, 0)) for group in groups))

    def of_all(label: str, count: int) -> tuple[str, ...]:
        return (label, str(count), *("\N{EN DASH}" for _ in groups))

    rows = [of_all("came", flow.came), *(of_all(label, count) for label, count in flow.before.items())]
    rows.append(row("allocated to a group", flow.allocated))
    rows += [
        row(label, counts)
        for label, counts in (
            ("withdrew afterwards", flow.withdrew),
            ("did not return, slot reallocated", flow.replaced),
            ("no data recorded so far", flow.without_data),
        )
        if counts
    ]
    many = len(flow.courses) > 1
    for number, course in flow.courses.items():
        session = f"session {number}: " if many else ""
        rows.append(row(f"{session}began", course.began))
        rows += [
            row(f"{session}{label}", counts)
            for label, counts in (
                ("screened out", course.screened_out),
                ("simulated participant failed", course.failed),
                ("not finished", course.unfinished),
            )
            if counts
        ]
        rows.append(row(f"{session}finished", course.complete))
    rows += [row(f"excluded: {reason}", counts) for reason, counts in (excluded or {}).items()]
    rows.append(row("included in this report", counting))
    return Table(("participants", "all", *groups), rows)
