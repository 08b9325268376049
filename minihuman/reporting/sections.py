"""Sections of the report's page about the data: answers, recording quality, exclusions and skipped logs."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pandas as pd

from minihuman.activities.questions.question import find_question_kind
from minihuman.dataset.log_files import SkippedLog
from minihuman.dataset.recording_quality import LATE_MS, RecordingQuality
from minihuman.errors import ProtocolError
from minihuman.moved import forward_names
from minihuman.reporting.template import (
    AnswerCounts,
    Cell,
    Table,
    format_number,
    to_records,
)

_MOST_ANSWERS = 8  # distinct answers to a question that are listed one by one
_GIVEN_ONCE = ["participant", "session", "part", "questions", "item", "attempt"]  # a participant can answer again
_TIMED_COLUMNS = slice(3, 9)  # the columns of the table of quality that need a display and a keyboard


def answers_table(answers: pd.DataFrame, groups: Sequence[str] = ()) -> Table | None:
    """Tabulate every question: the counts of each answer, or its mean and range, and the median response time.

    A question asked in several sessions, or several times in one session, has a row for each time, because the answers
    of different days or after different blocks are not comparable. With several ``groups``, a question has a row for
    each group, in their order. ``answers`` has the column ``after``, the block to which the answers belong; without it,
    times are numbered.

    Return None if there are no answers.
    """
    if answers.empty:
        return None
    last = _prepare_answers(answers, groups)
    times = last.groupby(["participant", "session", "questions", "after"])["part"].rank(method="dense").astype(int)
    last = last.assign(time=times)  # how often they had been asked in that session after that block, 1 for the first
    by_question = last.groupby(["questions", "item"])
    label_columns = [name for name in ("session", "after", "time") if (by_question[name].nunique() > 1).any()]
    if len(groups) > 1:
        label_columns.append("group")
    question_order: list[tuple[object, ...]] = list(zip(last["questions"], last["item"], strict=True))
    by_row = last.groupby(["questions", "item", "session", "after", "time", "rank"])
    in_order = sorted(by_row, key=lambda keyed: (question_order.index(keyed[0][:2]), keyed[0][2:]))
    rows: list[tuple[Cell, ...]] = []
    for (part, question, *_), row_answers in in_order:
        labels = [str(row_answers[name].iloc[0]) for name in label_columns]
        summary = _summarise_answers(row_answers)
        share_right = _format_share_right(row_answers)
        median_s = format_number(float(row_answers["answer_ms"].median()) / 1000)
        rows.append((str(part), str(question), *labels, summary, str(len(row_answers)), share_right, median_s))
    heads = ("questions", "question", *label_columns, "answers", "n", "right", "median time (s)")
    return Table(heads, rows, words=3 + len(label_columns))


def _prepare_answers(answers: pd.DataFrame, groups: Sequence[str]) -> pd.DataFrame:
    """Return the last answer to each question, with the columns ``after`` and ``rank``, the index of the group."""
    last = answers.drop_duplicates(_GIVEN_ONCE, keep="last")
    if "after" not in last:
        last = last.assign(after="")
    if len(groups) < 2:
        return last.assign(rank=0)
    ranks = {group: rank for rank, group in enumerate(groups)}
    return last.assign(rank=last["group"].map(ranks).fillna(len(ranks)).astype(int))


def _summarise_answers(group: pd.DataFrame) -> Cell:
    """Summarise the answers to one question: mean and range for numbers, else the count of each answer."""
    numbers = group["number"].dropna()
    if not len(numbers) or not all(map(_has_mean, set(group["kind"]))):
        counts = group["said"].fillna(group["answer"]).fillna("nothing").value_counts()
        most = tuple((str(answer), int(count)) for answer, count in counts.head(_MOST_ANSWERS).items())
        return AnswerCounts(most, max(len(counts) - _MOST_ANSWERS, 0))
    mean, low, high = (format_number(float(number)) for number in (numbers.mean(), numbers.min(), numbers.max()))
    n_missing = len(group) - len(numbers)
    missing = f"; none ({n_missing})" if n_missing else ""
    return f"mean {mean}, {low} to {high}{missing}"


def _has_mean(kind: str) -> bool:
    """Return whether answers to a kind of question have a mean; False for a kind whose plug-in is not installed."""
    try:
        return find_question_kind(kind).answer_type in ("rating", "number")
    except ProtocolError:
        return False


def _format_share_right(group: pd.DataFrame) -> str:
    """Format the share of correct answers; a dash if no answer can be correct."""
    right = group["right"].dropna()
    if not len(right):
        return "\N{EN DASH}"
    return f"{100 * float(right.astype(float).mean()):.0f} %"


class QualitySection(NamedTuple):
    """The recording quality of the sessions: a summary sentence, the displays, and a table with a row per session."""

    lead: str
    displays: Sequence[str]
    table: Table


def quality_section(qualities: Sequence[RecordingQuality]) -> QualitySection:
    """Build the section on late presses, frames, focus, pauses and displays."""
    rows = [_list_quality_cells(quality) for quality in qualities]
    heads: tuple[str, ...] = (
        "participant", "session", "presses", f"late (over {LATE_MS:g} ms)", "latest (ms)", "frames missing",
        "key to flip: median", "95 %", "99 % (ms)", "focus lost", "pauses", "segments",
    )  # fmt: skip
    if not any(map(_is_timed, qualities)):
        rows = [row[: _TIMED_COLUMNS.start] + row[_TIMED_COLUMNS.stop :] for row in rows]
        heads = heads[: _TIMED_COLUMNS.start] + heads[_TIMED_COLUMNS.stop :]
    displays: set[str] = set()
    for quality in qualities:
        for display in quality.displays:
            displays.add(", ".join(f"{name} {value}" for name, value in display.items()))
    return QualitySection(_state_quality(qualities), sorted(filter(None, displays)), Table(heads, rows))


def _list_quality_cells(quality: RecordingQuality) -> tuple[str, ...]:
    """Return the table cells of one session's recording quality."""
    if _is_timed(quality):
        timing = [
            f"{quality.late}",
            format_number(quality.latest_ms),
            f"{quality.pictures_missing} of {quality.steps}",
            *(format_number(ms) for ms in quality.key_to_flip_ms),
        ]
    else:
        timing = ["n/a"] * (_TIMED_COLUMNS.stop - _TIMED_COLUMNS.start)
    return (
        quality.participant,
        str(quality.session),
        str(quality.presses),
        *timing,
        str(quality.focus_lost),
        f"{quality.pauses}, {quality.paused_s:.0f} s",
        f"{quality.segments}" if quality.clean else f"{quality.segments}, cut off",
    )


def _state_quality(qualities: Sequence[RecordingQuality]) -> str:
    """State how late presses and frames were over all timed sessions, and which sessions were not timed."""
    timed = [quality for quality in qualities if _is_timed(quality)]
    late = sum(quality.late for quality in timed)
    presses = sum(quality.presses for quality in timed)
    lead = f"{late} of {presses} presses were processed more than {LATE_MS:g} ms after the key moved"
    slowest_ms = [quality.key_to_flip_ms[2] for quality in timed if not np.isnan(quality.key_to_flip_ms[2])]
    if slowest_ms:
        within_ms = format_number(float(max(slowest_ms)))
        lead += f"; in every session 99 % of frames appeared within {within_ms} ms of their key"
    periods = sum(quality.periods for quality in timed)
    if periods:
        missed = sum(quality.periods_missed for quality in timed)
        lead += f"; {missed} of {periods} periods of real time passed without a step"
    for quality in qualities:
        if quality.doubtful_presses:
            lead += f"; {quality.participant}, session {quality.session}: {quality.doubtful_presses}"
    untimed = list(_state_untimed(qualities))
    if not timed and untimed:
        return ". ".join(untimed)
    return ". ".join([lead, *untimed])


def _state_untimed(qualities: Sequence[RecordingQuality]) -> Iterator[str]:
    """Yield a sentence for the simulated sessions, and one for the others that recorded no display."""
    untimed = [quality for quality in qualities if not _is_timed(quality)]
    n_simulated = sum(bool(quality.displays) for quality in untimed)
    if n_simulated:
        sessions = "1 session was" if n_simulated == 1 else f"{n_simulated} sessions were"
        yield (
            f"{sessions} simulated: reaction and playing times are the simulated player's, and neither a keyboard nor "
            "a display was measured"
        )
    n_others = len(untimed) - n_simulated
    if n_others:
        sessions = "1 session" if n_others == 1 else f"{n_others} sessions"
        yield f"{sessions} recorded no display, so how late keys and pictures were is not known"


def _is_timed(quality: RecordingQuality) -> bool:
    """Return whether a session recorded a display other than that of a simulated window, which measures no time."""
    return any(display.get("window") != "simulated" for display in quality.displays)


class ExclusionsSection(NamedTuple):
    """The exclusions: a table of totals by reason, and a table of single exclusions."""

    totals: Table
    each: Table


def exclusions_section(rows: pd.DataFrame) -> ExclusionsSection | None:
    """Build the section on exclusions from the rows of ``list_exclusions``; None if nothing is excluded.

    In the totals, a participant who is excluded in several sessions counts once.
    """
    if rows.empty:
        return None
    is_repeated = (rows["level"] == "participant") & rows.duplicated(["exclusion_reason", "level", "participant"])
    counts = rows[~is_repeated].groupby(["exclusion_reason", "level"]).size().reset_index(name="count")
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
    """Tabulate the skipped logs, such as those that cannot be read, with the reasons."""
    return Table(("log", "reason"), [(str(log.path), log.reason) for log in logs], words=2)


if not TYPE_CHECKING:
    __getattr__ = forward_names(__name__)
