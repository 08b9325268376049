"""What was answered, how well it was recorded, and what does not count: the page's sections about the data."""

from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np
import pandas as pd

from minihuman.data.opened import Skipped
from minihuman.data.quality import LATE_MS, Quality
from minihuman.report.html import number, records, table


def answers(found: pd.DataFrame | None) -> list[str]:
    """Every question: how often each answer was given, or its mean."""
    if found is None or found.empty:
        return []
    rows = []
    for (part, question), given in found.groupby(["part", "question"], sort=False):
        numbers = pd.to_numeric(given["answer"], errors="coerce")
        if numbers.notna().all():
            mean, low, high = (number(float(one)) for one in (numbers.mean(), numbers.min(), numbers.max()))
            said = f"mean {mean}, {low} to {high}"
        else:
            said = ", ".join(f"{answer} ({count})" for answer, count in given["answer"].value_counts().head(8).items())
        rows.append((str(part), str(question), str(len(given)), said))
    return ["<h2>Answers</h2>", table("", ("part", "question", "n", "answers"), rows, words=2)]


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
    worst = f"; 99 % of pictures came within {number(float(slowest.max()))} ms of their key in every session"
    lead = (
        f"{late} of {presses} presses were taken more than {LATE_MS:g} ms after they were made"
        f"{worst if slowest.size else ''}."
    )
    shown = "".join(f"<p>Display: {escape(one)}.</p>" for one in displays if one)
    return f"<p>{escape(lead)}</p>{shown}" + table("", heads, rows)


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
