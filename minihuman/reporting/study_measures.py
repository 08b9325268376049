"""Measures that a protocol can name besides the columns of the table of blocks: answers, teaching, another block's
value, a design's estimate, and those of a lab's own package (entry-point group `minihuman.measures`).

A name is ``KIND:ARGUMENT``, such as ``answer:load.mental``.
"""

import json
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from importlib import import_module

import numpy as np
import pandas as pd

from minihuman.errors import ReportError
from minihuman.experiment.machine.activity import find_kind, list_kinds
from minihuman.plugins import make_plugin

GROUP = "minihuman.measures"
Tables = Mapping[str, pd.DataFrame]


class StudyMeasure(ABC):
    """One number per participant and session, or per block of it, computed from the study's tables.

    Args:
        argument: what follows the colon in the protocol; a measure refuses with ReportError what it cannot read.
    """

    label: str  # in the report: "mental demand (0 to 100)"
    is_log = False  # whether groups are compared on its logarithm; for times

    @abstractmethod
    def __init__(self, argument: str) -> None: ...

    @abstractmethod
    def compute(self, tables: Tables) -> pd.DataFrame:
        """Compute the values: columns participant, session and value, and block where a session's blocks differ.

        ``tables`` are those of `minihuman query` by name, without the tables of single steps, keys and pictures, and
        ``teaching``, a row per session and block that an agent played in. Rows with an ``exclusion_reason`` are left
        out.
        """


class AnswerScore(StudyMeasure):
    """``answer:QUESTIONS.ITEM``: the answer as a number; ``answer:QUESTIONS``: the mean of all items with numbers.

    Questions that are asked after several blocks have a value for each: the block that was played last before them.
    """

    def __init__(self, argument: str) -> None:
        self.questions, _, self.item = argument.partition(".")
        if not self.questions:
            raise ReportError(
                "measure 'answer:' does not name a question; use answer:QUESTIONS.ITEM or answer:QUESTIONS"
            )
        self.label = f"answer to {argument}"

    def compute(self, tables: Tables) -> pd.DataFrame:
        """Return the last answers that were given to each asking."""
        answers = tables["answers"]
        answers = answers[(answers["questions"] == self.questions) & answers["number"].notna()]
        if self.item:
            answers = answers[answers["item"] == self.item]
        answers = answers.drop_duplicates(["participant", "session", "part", "item"], keep="last")
        scores = answers.groupby(["participant", "session", "part"])["number"].mean().rename("value").reset_index()
        if scores.groupby(["participant", "session"]).size().max() != 1:
            parts = tables["parts"]
            blocks = tables["blocks"]["block"].unique()
            played = parts[(parts["what"] == "started") & parts["name"].isin(blocks)]
            candidates = scores.merge(played[["participant", "session", "part", "name"]], on=["participant", "session"])
            candidates = candidates[candidates["part_y"] < candidates["part_x"]].sort_values("part_y")
            last = candidates.drop_duplicates(["participant", "session", "part_x"], keep="last")
            scores = last.rename(columns={"name": "block"})[["participant", "session", "block", "value"]]
        return scores


class TeachingMeasure(StudyMeasure):
    """``teaching:NAME``: of the blocks that an agent played in."""

    LABELS: Mapping[str, str] = {
        "takeovers": "takeovers per episode",
        "person": "share of steps in the person's control",
        "minutes": "minutes in the person's control",
        "agreement": "share of the person's steps at which the policy would have acted alike",
        "gain": "growth of the agent's share per minute of the person's control",
    }

    def __init__(self, argument: str) -> None:
        if argument not in self.LABELS:
            raise ReportError(
                f"measure 'teaching:{argument}' is unknown; after teaching:, use one of {', '.join(self.LABELS)}"
            )
        self.name = argument
        self.label = self.LABELS[argument]

    def compute(self, tables: Tables) -> pd.DataFrame:
        """Return the column of the table of teaching."""
        return tables["teaching"].rename(columns={self.name: "value"})[["participant", "session", "block", "value"]]


class BlockValue(StudyMeasure):
    """``block:BLOCK/MEASURE``: a measure of another block, for each of its sessions; a baseline for instance."""

    def __init__(self, argument: str) -> None:
        self.block, _, self.measure = argument.partition("/")
        if not self.measure:
            raise ReportError(f"measure 'block:{argument}' does not name a measure; use block:BLOCK/MEASURE")
        self.label = f"{self.measure} in block {self.block}"

    def compute(self, tables: Tables) -> pd.DataFrame:
        """Return that block's column."""
        rows = tables["blocks"]
        if self.measure not in rows:
            raise ReportError(
                f"measure 'block:{self.block}/{self.measure}': the table blocks has no column {self.measure}; name one "
                "that it has"
            )
        return rows[rows["block"] == self.block].rename(columns={self.measure: "value"})[
            ["participant", "session", "value"]
        ]


class DesignEstimate(StudyMeasure):
    """``design:NAME``: what a block's adaptive design estimated at last; a ``threshold`` is compared as logarithms."""

    def __init__(self, argument: str) -> None:
        self.name = argument
        self.label = f"{argument} by the adaptive design"
        self.is_log = argument == "threshold"

    def compute(self, tables: Tables) -> pd.DataFrame:
        """Return the last decision's estimate in each block; none where the design had too few episodes for it."""
        last = tables["decisions"].drop_duplicates(["participant", "session", "block"], keep="last")
        values = [json.loads(estimates).get(self.name, np.nan) for estimates in last["estimates"]]
        return last.assign(value=np.array(values, float))[["participant", "session", "block", "value"]]


class TrialMeasure(StudyMeasure):
    """``trials:NAME``: a measure of trials, such as ``trials:d_prime``."""

    def __init__(self, argument: str) -> None:
        labels = load_trial_measures()
        if argument not in labels:
            raise ReportError(f"measure 'trials:{argument}' is unknown; after trials:, use one of {', '.join(labels)}")
        self.name = argument
        self.label = labels[argument]

    def compute(self, tables: Tables) -> pd.DataFrame:
        """Return the column of the measures of all trials of a block."""
        rows = tables.get("trial_measures", pd.DataFrame(columns=["participant", "session", "block", self.name]))
        return rows.rename(columns={self.name: "value"})[["participant", "session", "block", "value"]]


def load_trial_measures() -> dict[str, str]:
    """Load the measures of trials that kinds of activity have, by name, with what they are called."""
    labels: dict[str, str] = {}
    for kind in list_kinds(lambda kind: bool(kind.measures)):
        module, _, name = find_kind(kind).measures.partition(":")
        labels |= getattr(import_module(module), name)
    return labels


_BUILT_IN: Mapping[str, type[StudyMeasure]] = {
    "answer": AnswerScore,
    "block": BlockValue,
    "design": DesignEstimate,
    "teaching": TeachingMeasure,
    "trials": TrialMeasure,
}


def find_measure(name: str) -> StudyMeasure:
    """Find the measure of that name, ``KIND:ARGUMENT``.

    Raises:
        ReportError: if there is no such kind, or it refuses the argument.
    """
    kind, _, argument = name.partition(":")
    if kind in _BUILT_IN:
        return _BUILT_IN[kind](argument)
    return make_plugin(GROUP, name, StudyMeasure, ReportError, noun="measure")  # type: ignore[type-abstract]


def _keep_included(table: pd.DataFrame) -> pd.DataFrame:
    """Leave out the rows that have a reason for exclusion."""
    if "exclusion_reason" not in table:
        return table
    return table[table["exclusion_reason"].isna()]


def add_measures(rows: pd.DataFrame, tables: Tables, names: Iterable[str]) -> pd.DataFrame:
    """Add a column for each of these measures to the rows of the table of blocks; NaN where one has no value.

    Raises:
        ReportError: if a measure is unknown, or gives other columns than it should.
    """
    included = {name: _keep_included(table) for name, table in tables.items()}
    for name in names:
        values = find_measure(name).compute(included)
        keys = [column for column in ("participant", "session", "block") if column in values]
        if keys[:2] != ["participant", "session"] or "value" not in values:
            raise ReportError(
                f"measure {name!r} gives columns {', '.join(map(str, values.columns))}; it must give participant, "
                "session, value and optionally block"
            )
        means = values.assign(value=pd.to_numeric(values["value"])).groupby(keys)["value"].mean().rename(name)
        rows = rows.merge(means.reset_index(), on=keys, how="left", validate="many_to_one")
        rows[name] = rows[name].astype(np.float64)
    return rows
