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


def difference_statement(one: GroupComparison, block: str) -> str:
    """How far apart two groups are in a block, in one sentence."""
    name = label_measure(one.measure)
    per = "over" if one.is_log else "minus"
    said = f"{name[0].upper()}{name[1:]}, block {block}: {one.first} {per} {one.second} "
    if one.reason and math.isnan(one.p):
        return f"{said}was not compared ({one.reason})."
    if one.smallest_p >= 0.05:
        never = " Groups of these sizes cannot reach p < 0.05, whatever the difference."
    else:
        never = ""
    size = ""
    if not math.isnan(one.g):
        size = f"; standardised difference g {format_number(one.g, 2)}, interval {format_interval(one.g_interval, 2)}"
    return (
        f"{said}is {_as_stated(one)}{_as_factor(one)}; permutation p {format_p_value(one.p)}{size}; "
        f"{one.n[0]} and {one.n[1]} participants).{never}"
    )


def _as_stated(one: GroupComparison | PairedComparison) -> str:
    """The difference, or the ratio that a difference of logarithms is, and its interval; the bracket stays open."""
    if one.is_log:
        bounds = (math.exp(one.interval[0]), math.exp(one.interval[1]))
        ratio = format_number(math.exp(one.difference))
        return f"{ratio} (ratio of geometric means; 95 % interval {format_interval(bounds)}"
    return f"{format_number(one.difference, sign='+')} (95 % interval {format_interval(one.interval, sign='+')}"


def paired_statement(one: PairedComparison) -> str:
    """How far apart two conditions are within participants, in one sentence."""
    name = label_measure(one.measure)
    if one.smallest_p >= 0.05:
        never = " So few participants cannot reach p < 0.05, whatever the difference."
    else:
        never = ""
    per = "over" if one.is_log else "minus"
    return (
        f"{name[0].upper()}{name[1:]}, within participants: {one.first} {per} {one.second} "
        f"is {_as_stated(one)}; paired permutation p {format_p_value(one.p)}, Holm {format_p_value(one.p_holm)}; "
        f"{one.n} participants).{never}"
    )


def conditions_table(found: WithinResults) -> Table | None:
    """Conditions compared within participants."""
    rows = [
        (
            label_measure(one.measure), found.roles[one.measure], format_pair(one.first, one.second), str(one.n),
            ", ".join(map(format_number, one.means)),
            format_difference(one.difference, one.interval, is_log=one.is_log),
            format_p_value(one.p), format_p_value(one.p_holm), format_p_value(one.smallest_p),
        )
        for one in found.comparisons
    ]  # fmt: skip
    heads = ("measure", "named before", "conditions", "n", "means", "difference", "p", "p (Holm)", "smallest p")
    return Table(heads, rows, words=3) if rows else None


def crossover_table(found: WithinResults) -> Table | None:
    """Effects of condition, position and carry-over; None where the order is the same for everyone."""
    rows = [
        (
            label_measure(one.measure), one.effect, f"{one.freedom[0]}, {one.freedom[1]}", format_number(one.f),
            format_p_value(one.p),
        )
        for one in found.effects
    ]  # fmt: skip
    if rows:
        return Table(("measure", "effect", "degrees of freedom", "F", "p"), rows, words=2)
    return None


def _as_factor(one: GroupComparison) -> str:
    """What a difference of logarithms of steps means: by how much they are multiplied."""
    of = _FACTORS.get(one.measure)
    if of is None or math.isnan(one.interval[0]):
        return ""
    factor = math.exp(one.difference)
    bounds = (math.exp(one.interval[0]), math.exp(one.interval[1]))
    return f"; as a factor of {of}: {format_number(factor, 2)}, {format_interval(bounds, 2)}"


def equivalence_statement(one: EquivalenceResult, roles: Mapping[str, Role]) -> str:
    """Whether two groups are shown to be equivalent, in one sentence."""
    (primary,) = (name for name, role in roles.items() if role == "primary")
    name = label_measure(primary)
    shown = "are equivalent" if one.test.alike else "are not shown to be equivalent"
    return (
        f"{name[0].upper()}{name[1:]}: {one.first} and {one.second} {shown} within {one.test.bounds[1]:g}, the "
        f"protocol's margin (two one-sided tests, p {format_p_value(one.test.p)}; 90 % interval of the difference "
        f"{format_interval(one.test.interval, sign='+')})."
    )


def power_statement(one: PowerAnalysis) -> str:
    """What the sample could show, in one sentence."""
    a, b = one.n
    if math.isnan(one.power_for_large):
        return f"Power: with {a} and {b} participants no difference between groups can be tested."
    return (
        f"Power: with {a} and {b} participants a two-sided t test at 5 %, before any correction, detects a "
        f"difference of 0.8 standard deviations with a power of {100 * one.power_for_large:.0f} %; a power of 80 % "
        f"needs one of {one.detectable_g:.2f} standard deviations, or {one.needed_for_large} participants per "
        f"group for one of 0.8."
    )


def survival_table(found: BlockSurvival) -> Table | None:
    """Key discovery compared; participants who never discovered all keys are censored."""
    rows = [
        (
            format_pair(a, b), f"{one.n[0]}, {one.n[1]}", f"{one.never[0]}, {one.never[1]}",
            format_number(one.until), f"{format_number(one.means[0])}, {format_number(one.means[1])}",
            format_with_interval(one.difference, one.interval, sign="+"), format_p_value(one.p),
            format_p_value(one.logrank_p),
        )
        for a, b, one in found.compared
    ]  # fmt: skip
    heads = ("groups", "n", "never", "observed (s)", "restricted means (s)", "difference (95 %)", "p", "curves: p")
    return Table(heads, rows) if rows else None


def reliability_table(found: Sequence[Reliability]) -> Table | None:
    """How well each measure tells participants apart."""
    rows = [
        (
            label_measure(one.measure), str(one.participants), str(one.episodes),
            format_with_interval(one.icc, one.icc_interval), format_with_interval(one.halves, one.halves_interval),
        )
        for one in found
    ]  # fmt: skip
    if rows:
        return Table(("measure", "participants", "episodes", "one episode: ICC", "all: split-half"), rows)
    return None


def session_table(one: BlockResults) -> Table | None:
    """Each session's values, and the change from the block's first session to each later one; None of one session."""
    sessions = sorted(one.by_session["session"].unique())
    if len(sessions) < 2:
        return None
    values = {(row["measure"], row["group"], row["session"]): row for row in to_records(one.by_session)}
    changes = {(each.measure, each.group, each.sessions[1]): each for each in one.changes}

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
    several = len(sessions) > 2
    heads = (
        "measure", "group", *(f"session {session}" for session in sessions),
        *(
            f"{head}, {sessions[0]} to {session}" if several else head
            for session in sessions[1:] for head in ("n", "change", "p")
        ),
    )  # fmt: skip
    return Table(heads, rows, words=2)


def session_changes_table(one: BlockResults) -> Table | None:
    """Groups compared on their change between sessions; None where there is none, or one group alone."""
    several = len({sessions for sessions, _ in one.changes_compared}) > 1
    rows = [
        (
            label_measure(each.measure) + (f", session {first} to {later}" if several else ""),
            format_pair(each.first, each.second), f"{each.n[0]}, {each.n[1]}",
            format_difference(each.difference, each.interval, is_log=each.is_log, sign="+"),
            format_p_value(each.p), format_p_value(each.p_holm),
        )
        for (first, later), each in one.changes_compared
    ]  # fmt: skip
    if rows:
        return Table(("measure", "groups", "n", "difference of changes", "p", "p (Holm)"), rows, words=2)
    return None


def parts_table(found: Sequence[TwoPartComparison]) -> Table | None:
    """Both parts of a reward that has mass at 0, compared."""
    rows = [
        (
            format_pair(one.first, one.second), f"{one.n[0]}, {one.n[1]}",
            f"{one.shares[0]:.1%}, {one.shares[1]:.1%}",
            *(text for part in (one.any, one.amount) for text in (_part(part), format_p_value(part.p))),
            format_p_value(one.p),
        )
        for one in found
    ]  # fmt: skip
    heads = ("groups", "n", "earned", "odds ratio", "p", "difference where earned", "p", "p of both")
    return Table(heads, rows) if rows else None


def list_missing_parts(found: Sequence[TwoPartComparison]) -> list[str]:
    """The reason of each part that could not be compared."""
    return [
        f"{what}, {format_pair(one.first, one.second)}: {part.reason}"
        for one in found
        for what, part in (("odds", one.any), ("difference", one.amount))
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


def answers_table(found: pd.DataFrame) -> Table | None:
    """Every question: how often each answer was given, or its mean and range, and how long it took.

    One that was asked in several sessions, or several times in one, has a row for each: a second day's answers are not
    the first day's, and those after a block not those after the one before.
    """
    if found.empty:
        return None
    rows: list[tuple[Cell, ...]] = []
    last = found.drop_duplicates(_GIVEN_ONCE, keep="last")
    times = last.groupby(["participant", "session", "questions"])["part"].rank(method="dense").astype(int)
    last = last.assign(time=times)  # how often they had been asked in that session, 1 for the first
    whens = [when for when in ("session", "time") if (last.groupby(["questions", "item"])[when].nunique() > 1).any()]
    in_order: list[tuple[object, ...]] = list(zip(last["questions"], last["item"], strict=True))  # as first asked
    asked = last.groupby(["questions", "item", "session", "time"])
    for (part, item, *which), given in sorted(asked, key=lambda one: (in_order.index(one[0][:2]), one[0][2:])):
        numbers = given["number"].dropna()
        if len(numbers) and all(map(_has_mean, set(given["kind"]))):
            mean, low, high = (format_number(float(one)) for one in (numbers.mean(), numbers.min(), numbers.max()))
            none = len(given) - len(numbers)
            said: Cell = f"mean {mean}, {low} to {high}" + (f"; none ({none})" if none else "")
        else:
            counts = given["said"].fillna(given["answer"]).fillna("nothing").value_counts()
            most = tuple((str(answer), int(count)) for answer, count in counts.head(_MOST_ANSWERS).items())
            said = AnswerCounts(most, max(len(counts) - _MOST_ANSWERS, 0))
        right = given["right"].dropna()
        if len(right):
            share = f"{100 * float(right.astype(float).mean()):.0f} %"
        else:
            share = "\N{EN DASH}"
        took = format_number(float(given["answer_ms"].median()) / 1000)
        when = [str(number) for name, number in zip(("session", "time"), which, strict=True) if name in whens]
        rows.append((str(part), str(item), *when, said, str(len(given)), share, took))
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
            one.participant, str(one.session), str(one.presses),
            *((f"{one.late}", format_number(one.latest_ms)) if _sat(one) else ("n/a", "n/a")),
            f"{one.pictures_missing} of {one.steps}" if _sat(one) else "n/a",
            *(format_number(ms) if _sat(one) else "n/a" for ms in one.key_to_flip_ms),
            str(one.focus_lost), f"{one.pauses}, {one.paused_s:.0f} s",
            f"{one.segments}{'' if one.clean else ', cut off'}",
        )
        for one in qualities
    ]  # fmt: skip
    heads: tuple[str, ...] = (
        "participant", "session", "presses", f"late (over {LATE_MS:g} ms)", "latest (ms)", "frames missing",
        "key to flip: median", "95 %", "99 % (ms)", "focus lost", "pauses", "segments",
    )  # fmt: skip
    if not any(map(_sat, qualities)):  # nothing was timed
        rows = [row[:3] + row[9:] for row in rows]
        heads = heads[:3] + heads[9:]
    displays = sorted(
        {", ".join(f"{name} {value}" for name, value in shown.items()) for one in qualities for shown in one.displays}
    )
    sat = [one for one in qualities if _sat(one)]
    presses = sum(one.presses for one in sat)
    late = sum(one.late for one in sat)
    slowest = np.array([one.key_to_flip_ms[2] for one in sat])
    slowest = slowest[~np.isnan(slowest)]
    lead = f"{late} of {presses} presses were processed more than {LATE_MS:g} ms after the key moved"
    if slowest.size:
        lead += (
            f"; in every session 99 % of frames appeared within {format_number(float(slowest.max()))} ms of their key"
        )
    if periods := sum(one.periods for one in sat):
        missed = sum(one.periods_missed for one in sat)
        lead += f"; {missed} of {periods} periods of real time passed without a step"
    for quality in qualities:
        if quality.doubtful_presses:
            lead += f"; {quality.participant}, session {quality.session}: {quality.doubtful_presses}"
    if len(sat) < len(qualities):
        none = f"{len(qualities) - len(sat)} sessions had neither keyboard nor display, so nothing was timed"
        lead = f"{lead}. {none}" if sat else none
    return QualitySection(lead, [one for one in displays if one], Table(heads, rows))


def _sat(one: RecordingQuality) -> bool:
    """Whether a session had a display and a keyboard: a simulated window has a clock of its own."""
    return any(shown.get("window") != "simulated" for shown in one.displays)


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
    each = [
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
        Table(("reason", "participant", "session", "episode"), each, words=2),
    )


def skipped_table(logs: Sequence[SkippedLog]) -> Table:
    """Logs that could not be read, and why."""
    return Table(("log", "reason"), [(str(one.path), one.reason) for one in logs], words=2)


VERBS = {"GoTo": "go to", "Open": "open", "Pickup": "pick up", "PutNext": "put next to"}  # by a clause's type
ATTEMPT_COLUMNS = ["participant", "session", "segment", "episode"]  # one of an episode: a segment has one at most


def count_clauses(episodes: pd.DataFrame, starts: pd.DataFrame, done: pd.DataFrame) -> pd.DataFrame:
    """Count the clauses that were asked for and done, by block, verb and group.

    Args:
        episodes: The table of episodes; only those that are included are counted.
        starts: The table of beginnings, for the missions.
        done: The table of clauses that were done.

    Returns:
        block, verb, group, asked, done, median_step (of those done); no row of blocks in which no clause was ever done.
    """
    counted = episodes.loc[episodes["exclusion_reason"].isna(), [*ATTEMPT_COLUMNS, "block", "group"]]
    counted = counted.merge(starts[[*ATTEMPT_COLUMNS, "mission"]], on=ATTEMPT_COLUMNS)
    # the blocks whose worlds have instructions, as far as anything of one was done
    counted = counted[
        counted["block"].isin(counted.merge(done[ATTEMPT_COLUMNS].drop_duplicates(), on=ATTEMPT_COLUMNS)["block"])
    ]
    if counted.empty:
        return pd.DataFrame(columns=["block", "verb", "group", "asked", "done", "median_step"])
    steps = done[[*ATTEMPT_COLUMNS, "clause", "step"]]
    asked = pd.DataFrame(_asked(counted)).merge(steps, on=[*ATTEMPT_COLUMNS, "clause"], how="left")
    grouped = asked.groupby(["block", "verb", "group"], sort=False)["step"]
    return grouped.agg(asked="size", done="count", median_step="median").reset_index()


def _asked(counted: pd.DataFrame) -> list[dict[str, Any]]:
    """One row per clause of each episode's mission."""
    from minihuman.worlds.grid.babyai.language import clauses, parse  # brings Numba, which few reports need

    return [
        {
            **dict(zip([*ATTEMPT_COLUMNS, "block", "group"], row[:-1], strict=True)),
            "clause": at,
            "verb": VERBS[type(clause).__name__],
        }
        for row in counted.itertuples(index=False)
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
        found = count_participant_flow(source)
        by_hand = count_all_interventions(source)
    except (AllocationError, LogError):  # no other number depends on it; the error names folders: it is not given here
        return FlowSection(None)
    counting = participants[participants["exclusion_reason"].isna()].groupby("group")["participant"].nunique()
    counts = {str(group): int(n) for group, n in counting.items()}
    table = flow_table(found, counts, _count_excluded(participants))
    looks = [line for line in read_enrolment_log(source) if isinstance(line, LookTaken)]
    return FlowSection(table, ", ".join(f"{count} {what}" for what, count in by_hand.items()), looks_table(looks))


def looks_table(looks: Sequence[LookTaken]) -> Table | None:
    """A row per look at a sequential study; None without any."""
    estimates = list(
        dict.fromkeys(name for look in looks for name in look.estimates if name not in ("look", "crossed"))
    )
    rows = [
        (
            str(look.look),
            *(str(int(its[0])) for its in _find_groups(look).values()),
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
    return {name: its for name, its in look.statistics.items() if isinstance(its, list) and its}


def _count_excluded(participants: pd.DataFrame) -> dict[str, dict[str, int]]:
    """How many participants are excluded from every session, by reason (of their first session) and group."""
    counting = set(participants.loc[participants["exclusion_reason"].isna(), "participant"])
    excluded = participants[~participants["participant"].isin(counting)].drop_duplicates("participant")
    counts: dict[str, dict[str, int]] = {}
    for (reason, group), rows in excluded.groupby(["exclusion_reason", "group"]):
        counts.setdefault(str(reason), {})[str(group)] = len(rows)
    return counts


def flow_table(
    found: ParticipantFlow, counting: Mapping[str, int], excluded: Mapping[str, Mapping[str, int]] | None = None
) -> Table:
    """A row per stage, a column per group; ``excluded`` are those excluded from every session, by reason."""
    groups = sorted({*found.allocated, *counting})

    def row(what: str, counts: GroupCounts) -> tuple[str, ...]:
        return (what, str(sum(counts.values())), *(str(counts.get(group, 0)) for group in groups))

    def of_all(what: str, count: int) -> tuple[str, ...]:
        return (what, str(count), *("\N{EN DASH}" for _ in groups))

    rows = [of_all("came", found.came), *(of_all(what, count) for what, count in found.before.items())]
    rows.append(row("allocated to a group", found.allocated))
    rows += [
        row(what, counts)
        for what, counts in (
            ("withdrew afterwards", found.withdrew),
            ("did not return, slot reallocated", found.replaced),
            ("no data recorded so far", found.without_data),
        )
        if counts
    ]
    many = len(found.courses) > 1
    for number, course in found.courses.items():
        session = f"session {number}: " if many else ""
        rows.append(row(f"{session}began", course.began))
        rows += [
            row(f"{session}{what}", counts)
            for what, counts in (
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
