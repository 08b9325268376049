"""What was answered, how well it was recorded, and what does not count: the page's sections about the data."""

from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np
import pandas as pd

from minihuman.data.opened import Skipped
from minihuman.data.quality import LATE_MS, Quality
from minihuman.report.html import long_table, number, records, table

_MOST_ANSWERS = 8  # of a question, that are told one by one
_MEASURED = ("likert", "slider", "number")  # kinds whose answers have a mean; an option's code has none
_GIVEN_ONCE = ["participant", "session", "part", "questions", "item", "attempt"]  # who goes back answers anew


def answers(found: pd.DataFrame) -> list[str]:
    """Every question: how often each answer was given, or its mean and range, and how long it took.

    One that was asked in several sessions, or several times in one, has a row for each: a second day's answers are not
    the first day's, and those after a block not those after the one before.
    """
    if found.empty:
        return []
    rows = []
    last = found.drop_duplicates(_GIVEN_ONCE, keep="last")
    times = last.groupby(["participant", "session", "questions"])["part"].rank(method="dense").astype(int)
    last = last.assign(time=times)  # that somebody was asked them in that session, 1 for the first
    whens = [when for when in ("session", "time") if (last.groupby(["questions", "item"])[when].nunique() > 1).any()]
    in_order: list[tuple[object, ...]] = list(zip(last["questions"], last["item"], strict=True))  # as first asked
    asked = last.groupby(["questions", "item", "session", "time"])
    for (part, item, *which), given in sorted(asked, key=lambda one: (in_order.index(one[0][:2]), one[0][2:])):
        numbers = given["number"].dropna()
        if len(numbers) and set(given["kind"]) <= set(_MEASURED):
            mean, low, high = (number(float(one)) for one in (numbers.mean(), numbers.min(), numbers.max()))
            none = len(given) - len(numbers)
            said = f"mean {mean}, {low} to {high}" + (f"; none ({none})" if none else "")
        else:
            told = given["said"].fillna(given["answer"]).fillna("nothing").value_counts()
            said = ", ".join(f"{answer} ({count})" for answer, count in told.head(_MOST_ANSWERS).items())
            said += f" and {len(told) - _MOST_ANSWERS} others" if len(told) > _MOST_ANSWERS else ""
        right = given["right"].dropna()
        share = f"{100 * float(right.astype(float).mean()):.0f} %" if len(right) else "\N{EN DASH}"
        took = number(float(given["answer_ms"].median()) / 1000)
        when = [str(number) for name, number in zip(("session", "time"), which, strict=True) if name in whens]
        rows.append((str(part), str(item), *when, said, str(len(given)), share, took))
    heads = ("questions", "question", *whens, "answers", "n", "right", "median time (s)")
    caption = "Over all participants." + (" Time: which in the session." if "time" in whens else "")
    return ["<h2>Answers</h2>", table(caption, heads, rows, words=3 + len(whens))]


def quality(qualities: Sequence[Quality]) -> str:
    """Late presses, pictures, focus, pauses, display."""
    rows: list[tuple[str, ...]] = [
        (
            one.participant, str(one.session), str(one.presses),
            *((f"{one.late}", number(one.latest_ms)) if _sat(one) else ("n/a", "n/a")),
            f"{one.pictures_missing} of {one.steps}" if _sat(one) else "n/a",
            *(number(ms) if _sat(one) else "n/a" for ms in one.key_to_flip_ms),
            str(one.focus_lost), f"{one.pauses}, {one.paused_s:.0f} s",
            f"{one.segments}{'' if one.clean else ', cut off'}",
        )
        for one in qualities
    ]  # fmt: skip
    heads: tuple[str, ...] = (
        "participant", "session", "presses", f"late (over {LATE_MS:g} ms)", "latest (ms)", "pictures missing",
        "key to flip: median", "95 %", "99 % (ms)", "focus lost", "pauses", "segments",
    )  # fmt: skip
    if not any(map(_sat, qualities)):  # nothing was timed
        rows, heads = [row[:3] + row[9:] for row in rows], heads[:3] + heads[9:]
    displays = sorted(
        {", ".join(f"{name} {value}" for name, value in shown.items()) for one in qualities for shown in one.displays}
    )
    sat = [one for one in qualities if _sat(one)]
    presses = sum(one.presses for one in sat)
    late = sum(one.late for one in sat)
    slowest = np.array([one.key_to_flip_ms[2] for one in sat])
    slowest = slowest[~np.isnan(slowest)]
    lead = f"{late} of {presses} presses were taken more than {LATE_MS:g} ms after they were made"
    if slowest.size:
        lead += f"; 99 % of pictures came within {number(float(slowest.max()))} ms of their key in every session"
    if len(sat) < len(qualities):
        none = f"In {len(qualities) - len(sat)} sessions there was neither keyboard nor display, so nothing to time"
        lead = f"{lead}. {none}" if sat else none
    shown = "".join(f"<p>Display: {escape(one)}.</p>" for one in displays if one)
    return f"<p>{escape(lead)}.</p>{shown}" + long_table("", heads, rows)


def _sat(one: Quality) -> bool:
    """Whether somebody sat at something: a simulated window has a clock of its own."""
    return any(shown.get("window") != "simulated" for shown in one.displays)


def left_out(rows: pd.DataFrame) -> str:
    """What does not count, by rule, and each."""
    if rows.empty:
        return "<p>Nothing.</p>"
    counts = rows.groupby(["left_out", "level"]).size().reset_index(name="count")
    totals = [(row["left_out"], row["level"], str(row["count"])) for row in records(counts)]
    each = [(row["left_out"], row["participant"], str(row["session"]), _which(row["episode"])) for row in records(rows)]
    return table("Rules and what they removed.", ("reason", "level", "removed"), totals, words=2) + long_table(
        "", ("reason", "participant", "session", "episode"), each, words=2
    )


def _which(episode: Any) -> str:
    return "all" if pd.isna(episode) else str(episode)


def skipped(logs: Sequence[Skipped]) -> str:
    """Logs that could not be read, and why."""
    if not logs:
        return "<p>None.</p>"
    return long_table("", ("log", "reason"), [(str(one.path), one.reason) for one in logs], words=2)
