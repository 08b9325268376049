"""Measures that a protocol can name in addition to the columns of the table of blocks.

They are answers, teaching, another block's value, an adaptive design's estimate, what a world's info says, trials, and
those of a lab's own package (entry-point group `minihuman.measures`). A name is ``KIND:ARGUMENT``, such as
``answer:load.mental``.
"""

import json
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping
from importlib import import_module

import numpy as np
import pandas as pd

from minihuman.errors import ReportError
from minihuman.experiment.machine.activity import find_kind, list_kinds
from minihuman.plugins import make_plugin
from minihuman.reporting.questionnaire_scores import name_last_blocks
from minihuman.statistics.circular import find_mean_direction_deg, find_resultant_length

GROUP = "minihuman.measures"
Tables = Mapping[str, pd.DataFrame]


class StudyMeasure(ABC):
    """A measure computed from a study's tables: one number per participant and session, or per block of a session.

    Args:
        argument: the text after the colon in the protocol; an invalid argument raises ReportError.
    """

    label: str  # in the report: "mental demand (0 to 100)"
    is_log = False  # whether groups are compared on its logarithm; for times
    formula = ""  # in the methods, where the label does not say it

    @abstractmethod
    def __init__(self, argument: str) -> None: ...

    @abstractmethod
    def compute(self, tables: Tables) -> pd.DataFrame:
        """Compute the values, in columns participant, session and value, and block if the blocks of a session differ.

        ``tables`` holds the tables of `minihuman query` by name, except those of single steps, keys and pictures, and
        the table ``teaching``, with a row per session and block in which an agent played. Rows with an
        ``exclusion_reason`` are omitted.
        """


class AnswerScore(StudyMeasure):
    """``answer:QUESTIONS.ITEM`` is the answer as a number; ``answer:QUESTIONS`` is the mean of all numeric items.

    If the questions were asked after several blocks, each of these blocks has a value; an answer belongs to the block
    that was played last before it.
    """

    def __init__(self, argument: str) -> None:
        self.questions, _, self.item = argument.partition(".")
        if not self.questions:
            raise ReportError(
                "measure 'answer:' does not name a question; use answer:QUESTIONS.ITEM or answer:QUESTIONS"
            )
        self.label = f"answer to {argument}"

    def compute(self, tables: Tables) -> pd.DataFrame:
        """Return the mean of the last answers per session or, if a session asked several times, per preceding block."""
        answers = tables["answers"]
        answers = answers[(answers["questions"] == self.questions) & answers["number"].notna()]
        if self.item:
            answers = answers[answers["item"] == self.item]
        answers = answers.drop_duplicates(["participant", "session", "part", "item"], keep="last")
        scores = answers.groupby(["participant", "session", "part"])["number"].mean().rename("value").reset_index()
        is_asked_repeatedly = scores.groupby(["participant", "session"]).size().max() != 1
        if is_asked_repeatedly:
            last = name_last_blocks(scores, tables["parts"], tables["blocks"]["block"].unique())
            scores = last[["participant", "session", "block", "value"]]
        return scores


class TeachingMeasure(StudyMeasure):
    """``teaching:NAME`` is a measure of blocks in which an agent played."""

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
        """Return the measure's column of the table ``teaching``."""
        return tables["teaching"].rename(columns={self.name: "value"})[["participant", "session", "block", "value"]]


class BlockValue(StudyMeasure):
    """``block:BLOCK/MEASURE`` is a measure of another block, such as a baseline, in each session that has the block."""

    def __init__(self, argument: str) -> None:
        self.block, _, self.measure = argument.partition("/")
        if not self.measure:
            raise ReportError(f"measure 'block:{argument}' does not name a measure; use block:BLOCK/MEASURE")
        self.label = f"{self.measure} in block {self.block}"

    def compute(self, tables: Tables) -> pd.DataFrame:
        """Return the measure's column for the other block; raise ReportError if the table of blocks lacks it."""
        rows = tables["blocks"]
        if self.measure not in rows:
            raise ReportError(
                f"measure 'block:{self.block}/{self.measure}': the table blocks has no column {self.measure}; name one "
                "that it has"
            )
        return rows[rows["block"] == self.block].rename(columns={self.measure: "value"})[
            ["participant", "session", "value"]
        ]


class InfoAtEnd(StudyMeasure):
    """``info:KEY`` is the number under a recorded key of the world's ``info`` after an episode's last step.

    A block has the mean over its episodes. ``KEY.PART`` is a part of a dictionary. A boolean counts as 0 or 1.
    """

    def __init__(self, argument: str) -> None:
        if not argument:
            raise ReportError("measure 'info:' does not name a key; use info:KEY with a KEY of record_info")
        self.key = argument
        self.label = f"{argument} at the end of an episode"

    def compute(self, tables: Tables) -> pd.DataFrame:
        """Return a row for each episode after which the key held a number."""
        episodes = tables["episodes"]
        values = episodes["info_at_end"].map(self._read_number, na_action="ignore")
        rows = episodes.assign(value=pd.to_numeric(values, errors="coerce"))
        return rows.loc[rows["value"].notna(), ["participant", "session", "block", "value"]]

    def _read_number(self, text: str) -> float | None:
        """Return the number under the key in an info object, given as JSON; None if there is none."""
        info = json.loads(text or "{}")
        number = info.get(self.key)
        return float(number) if isinstance(number, bool | int | float) else None


class AngleMean(InfoAtEnd):
    """``angle_mean:KEY`` is the circular mean, -180 to 180 degrees, of the angles that a block has as ``info:KEY``."""

    def __init__(self, argument: str) -> None:
        super().__init__(argument)
        self.label = f"mean direction of {argument}"

    def compute(self, tables: Tables) -> pd.DataFrame:
        """Return the value of each block that has angles."""
        by_block = super().compute(tables).groupby(["participant", "session", "block"], sort=False)
        return by_block["value"].agg(self._summarize).reset_index()

    def _summarize(self, angles_deg: "pd.Series[float]") -> float:
        return find_mean_direction_deg(angles_deg)


class AngleConcentration(AngleMean):
    """``angle_concentration:KEY`` is the mean resultant length of a block's angles: 1 if all are equal."""

    def __init__(self, argument: str) -> None:
        super().__init__(argument)
        self.label = f"mean resultant length of {argument}"

    def _summarize(self, angles_deg: "pd.Series[float]") -> float:
        return find_resultant_length(angles_deg)


class DesignEstimate(StudyMeasure):
    """``design:NAME`` is the last estimate of a block's adaptive design; a ``threshold`` is compared on a log scale."""

    def __init__(self, argument: str) -> None:
        self.name = argument
        self.label = f"{argument} by the adaptive design"
        self.is_log = argument == "threshold"

    def compute(self, tables: Tables) -> pd.DataFrame:
        """Return the last decision's estimate in each block; NaN if the design had too few episodes for one."""
        last = tables["decisions"].drop_duplicates(["participant", "session", "block"], keep="last")
        values = [json.loads(estimates).get(self.name, np.nan) for estimates in last["estimates"]]
        return last.assign(value=np.array(values, float))[["participant", "session", "block", "value"]]


class TrialMeasure(StudyMeasure):
    """``trials:NAME`` is a measure of trials, such as ``trials:d_prime``."""

    def __init__(self, argument: str) -> None:
        labels = load_trial_measures()
        if argument not in labels:
            raise ReportError(f"measure 'trials:{argument}' is unknown; after trials:, use one of {', '.join(labels)}")
        self.name = argument
        self.label = labels[argument]
        self.formula = load_trial_formulas().get(argument, "")

    def compute(self, tables: Tables) -> pd.DataFrame:
        """Return the measure over all trials of each block."""
        rows = tables.get("trial_measures", pd.DataFrame(columns=["participant", "session", "block", self.name]))
        return rows.rename(columns={self.name: "value"})[["participant", "session", "block", "value"]]


def load_trial_measures() -> dict[str, str]:
    """Return the labels of the trial measures that activity kinds define, by name."""
    labels: dict[str, str] = {}
    for module, name in _list_trial_measure_sources():
        labels |= getattr(import_module(module), name)
    return labels


def load_trial_formulas() -> dict[str, str]:
    """Return the formulas of trial measures, by name, from the activity kinds that define ``FORMULAS``."""
    formulas: dict[str, str] = {}
    for module, _ in _list_trial_measure_sources():
        formulas |= getattr(import_module(module), "FORMULAS", {})
    return formulas


def _list_trial_measure_sources() -> Iterator[tuple[str, str]]:
    """Yield the module and the name of each table of labels that an activity kind registers."""
    for kind in list_kinds(lambda kind: bool(kind.measures)):
        module, _, name = find_kind(kind).measures.partition(":")
        yield module, name


_BUILT_IN: Mapping[str, type[StudyMeasure]] = {
    "angle_concentration": AngleConcentration,
    "angle_mean": AngleMean,
    "answer": AnswerScore,
    "block": BlockValue,
    "design": DesignEstimate,
    "info": InfoAtEnd,
    "teaching": TeachingMeasure,
    "trials": TrialMeasure,
}


def find_measure(name: str) -> StudyMeasure:
    """Return the measure with the name ``KIND:ARGUMENT``.

    Raises:
        ReportError: if there is no such kind, or its argument is not valid.
    """
    kind, _, argument = name.partition(":")
    if kind in _BUILT_IN:
        return _BUILT_IN[kind](argument)
    return make_plugin(GROUP, name, StudyMeasure, ReportError, noun="measure")  # type: ignore[type-abstract]


def _keep_included(table: pd.DataFrame) -> pd.DataFrame:
    """Return the rows that have no reason for exclusion; all rows of a table without a column of reasons."""
    if "exclusion_reason" not in table:
        return table
    return table[table["exclusion_reason"].isna()]


def add_measures(rows: pd.DataFrame, tables: Tables, names: Iterable[str]) -> pd.DataFrame:
    """Return rows of the table of blocks with a column for each measure in ``names``; NaN where it has no value.

    ``tables`` holds the study's tables by name, from which the measures are computed.

    Raises:
        ReportError: if a measure is unknown, or returns other columns than it should.
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
