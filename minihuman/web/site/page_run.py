"""Describes what a page without a server runs by itself: screens on which time and keys do more than lead to another.

A kind of activity that has such screens names a function that builds a `PageRun` (``ActivityKind.page_run``).
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from minihuman.experiment.machine.activity import Activity, find_kind
from minihuman.experiment.machine.inputs import Input
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.machine.transitions import Phase


@dataclass(frozen=True, slots=True)
class PageRun:
    """A present screen that a page runs by itself until one of its ends.

    Attributes:
        module: the JavaScript module that runs it, as "package:file"; it exports the class ``PageRun``
            (``page_tools.d.ts``).
        values: what the module needs, as JSON values.
        looks: what the screen's digest is of, with marks for what the module fills in; empty where the screen that was
            described is what its digest is of.
        ends: for each end, by name, a function that yields the inputs that lead a part there.
    """

    module: str
    values: Mapping[str, Any]
    looks: object
    ends: Mapping[str, Callable[[Activity], Iterator[Input]]]


def build_page_run(session: SessionMachine) -> PageRun | None:
    """Build what a page runs by itself on a session's present screen; return None if it runs nothing."""
    if session.over or session.phase in (Phase.START, Phase.UNFOCUSED, Phase.PAUSED, Phase.QUIT_QUESTION):
        return None
    module, _, name = find_kind(session.part.part.kind).page_run.partition(":")
    if not module:
        return None
    page_run: PageRun | None = getattr(import_module(module), name)(session.part)
    return page_run
