"""What was answered, how well it was recorded, and what does not count: the page's sections about the data."""

from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np
import pandas as pd

from minihuman.data.opened import Skipped
from minihuman.data.quality import LATE_MS, Quality
from minihuman.report.html import number, records, table

_MOST_ANSWERS = 8  # of a question, that are told one by one


def answers(found: pd.DataFrame) -> list[str]:
    """Every question: how often each answer was given, or its mean and range, and how long it took."""
    if found.empty:
        return []
    rows = []
    for (part, item), given in found.groupby(["questions", "item"], sort=False):
        numbers = given["number"].dropna()
        if len(numbers) == len(given):
            mean, low, high = (number(float(one)) for one in (numbers.mean(), numbers.min(), numbers.max()))
            said = f"mean {mean}, {low} to {high}"
        else:
            told = given["said"].fillna(given["answer"]).fillna("nothing").value_counts()
            said = ", ".join(f"{answer} ({count})" for answer, count in told.head(_MOST_ANSWERS).items())
            said += f" and {len(told) - _MOST_ANSWERS} others" if len(told) > _MOST_ANSWERS else ""
        right = given["right"].dropna()
        share = f"{100 * float(right.astype(float).mean()):.0f} %" if len(right) else "\N{EN DASH}"
        took = number(float(given["answer_ms"].median()) / 1000)
        rows.append((str(part), str(item), said, str(len(given)), share, took))
    heads = ("questions", "question", "answers", "n", "right", "median time (s)")
    return ["<h2>Answers</h2>", table("Over all participants and days.", heads, rows, words=3)]


def quality(qualities: Sequence[Quality]) -> str:
    """Late presses, pictures, focus, pauses, display."""
    rows = [
        (
            one.participant, str(one.session), str(one.presses), f"{one.late}", number(one.latest_ms),
            f"{one.pictures_missing} of {one.steps}", *(number(ms) for ms in one.key_to_flip_ms),
            str(one.focus_lost), f"{one.pauses}, {one.paused_s:.0f} s",
            f"{one.segments}{'' if one.clean else ', cut off'}",
        )
        for one in qualities
    ]  # fmt: skip
    heads = (
        "participant", "session", "presses", f"late (over {LATE_MS:g} ms)", "latest (ms)", "pictures missing",
        "key to flip: median", "95 %", "99 % (ms)", "focus lost", "pauses", "segments",
    )  # fmt: skip
    displays = sorted({", ".join(f"{name} {value}" for name, value in one.display.items()) for one in qualities})
    presses = sum(one.presses for one in qualities)
    late = sum(one.late for one in qualities)
    slowest = np.array([one.key_to_flip_ms[2] for one in qualities])
    slowest = slowest[~np.isnan(slowest)]
    lead = f"{late} of {presses} presses were taken more than {LATE_MS:g} ms after they were made"
    if slowest.size:
        lead += f"; 99 % of pictures came within {number(float(slowest.max()))} ms of their key in every session"
    shown = "".join(f"<p>Display: {escape(one)}.</p>" for one in displays if one)
    return f"<p>{escape(lead)}.</p>{shown}" + table("", heads, rows)


def left_out(rows: pd.DataFrame) -> str:
    """What does not count, by rule, and each."""
    if rows.empty:
        return "<p>Nothing.</p>"
    counts = rows.groupby(["left_out", "level"]).size().reset_index(name="count")
    totals = [(row["left_out"], row["level"], str(row["count"])) for row in records(counts)]
    each = [(row["left_out"], row["participant"], str(row["session"]), _which(row["episode"])) for row in records(rows)]
    return table("Rules and what they removed.", ("reason", "level", "removed"), totals, words=2) + table(
        "", ("reason", "participant", "session", "episode"), each, words=2
    )


def _which(episode: Any) -> str:
    return "all" if pd.isna(episode) else str(episode)


def skipped(logs: Sequence[Skipped]) -> str:
    """Logs that could not be read, and why."""
    if not logs:
        return "<p>None.</p>"
    return table("", ("log", "reason"), [(str(one.path), one.reason) for one in logs], words=2)
