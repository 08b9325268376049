"""Sections of the report that activity kinds write: their contents, their data, and how all of them are built."""

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from importlib import import_module
from pathlib import Path

import pandas as pd

from minihuman.dataset.tables import Tables
from minihuman.errors import ProtocolError
from minihuman.experiment.machine.activity import GROUP, find_kind
from minihuman.log.model.session_log import SessionLog
from minihuman.plugins import list_plugin_names
from minihuman.reporting.template import ReportFigure, Table


@dataclass(frozen=True, slots=True)
class CaptionedTable:
    """A table in a section of the report, and the text above it."""

    table: Table
    caption: str


@dataclass(frozen=True, slots=True)
class ReportSection:
    """An activity kind's section of the report; sections with the same title are shown together.

    Args:
        title: the heading; a section without tables is not shown.
        tables: the section's tables, in order.
        rank: the position among sections with the same title; smaller numbers come first.
        figures: figures that are shown among the report's other figures, and drawn when they are iterated over.
        measure_tables: tables by name, with participant, session and block, that the protocol's measures can use.
        blocks: blocks that this section reports in full, namely blocks of trials, which have no paths to a goal.
        is_leading: whether the figures come before the report's own figures of a block.
    """

    title: str
    tables: Sequence[CaptionedTable] = ()
    rank: int = 0
    figures: Iterable[ReportFigure] = ()
    measure_tables: Mapping[str, pd.DataFrame] = field(default_factory=dict)
    blocks: frozenset[str] = frozenset()
    is_leading: bool = False

    @property
    def anchor(self) -> str:
        """Return the heading's anchor for links."""
        return self.title.lower().replace(" ", "-")


class SectionSource:
    """The data from which a section is built: a study's tables, and the sessions behind them.

    Args:
        tables: the study's tables.
        figures: the folder for figures.
        practice: the group and the block of every practice block.
    """

    def __init__(self, tables: Tables, figures: Path, practice: frozenset[tuple[str, str]] = frozenset()) -> None:
        self.figures = figures
        self._practice = practice
        self._tables = tables

    def table(self, name: str) -> pd.DataFrame:
        """Return a table of the study as a data frame."""
        return self._tables.frame(name)

    def keep_included(self, rows: pd.DataFrame) -> pd.DataFrame:
        """Return the rows of a table of episodes that the statistics include, with the column ``world`` added."""
        keys = ["participant", "session", "episode", "attempt"]
        episodes = self._tables.frame("episodes", [*keys, "world", "exclusion_reason"])
        included = episodes[episodes["exclusion_reason"].isna()][[*keys, "world"]]
        return rows.merge(included, on=keys, validate="one_to_one")

    def keep_analysed(self, rows: pd.DataFrame) -> pd.DataFrame:
        """Return the rows of a table that do not belong to practice blocks."""
        pairs = zip(rows["group"], rows["block"], strict=True)
        return rows[[pair not in self._practice for pair in pairs]]

    def read_logs(self, rows: pd.DataFrame) -> Mapping[str, SessionLog]:
        """Read the sessions that have rows in a table, with their included episodes.

        The key of a session is a text such as "sub-07 session 1". No session is opened for an empty table; sessions
        without an included episode are omitted.
        """
        if rows.empty:
            return {}
        selected_sessions = set(zip(rows["participant"], rows["session"], strict=True))
        return {
            f"{code} session {number}": log
            for (code, number), log in self._logs.items()
            if (code, number) in selected_sessions
        }

    @cached_property
    def _logs(self) -> dict[tuple[str, int], SessionLog]:
        """Read the included episodes of all selected sessions, once for all sections; by participant and session."""
        cached_sessions = (session for session in self._tables.sessions if session.outline is not None)
        selected_sessions = (self._tables.read_session(session) for session in cached_sessions)
        logs = [session.session for session in selected_sessions if session.places]
        return dict(sorted(((log.plan.participant.id, log.plan.session), log) for log in logs))


def build_activity_sections(source: SectionSource) -> list[ReportSection]:
    """Build the sections of all installed activity kinds, in the order of the kinds' names.

    A section that several kinds share is built once. A kind has no section if it cannot be loaded, if it declares no
    builder, or if its builder returns None.
    """
    builders: dict[str, None] = {}  # "module:function" of each section, without duplicates
    for name in list_plugin_names(GROUP):
        with suppress(ProtocolError):  # a kind that cannot be loaded here has no section
            if find_kind(name).report:
                builders[find_kind(name).report] = None
    sections = []
    for builder in builders:
        module, _, function = builder.partition(":")
        section = getattr(import_module(module), function)(source)
        if section is not None:
            sections.append(section)
    return sections


def join_sections(sections: Iterable[ReportSection]) -> list[ReportSection]:
    """Join the tables of sections with the same title under one heading, in the order of the sections' ranks.

    Sections without tables are omitted.
    """
    sections_by_title: dict[str, list[ReportSection]] = defaultdict(list)
    for section in sections:
        if section.tables:
            sections_by_title[section.title].append(section)
    joined = []
    for title, parts in sections_by_title.items():
        parts.sort(key=lambda part: part.rank)
        joined.append(ReportSection(title, [table for part in parts for table in part.tables]))
    return joined
