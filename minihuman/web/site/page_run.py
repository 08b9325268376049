"""Describes the screens that a page without a server runs by itself, as time and keys change more than the screen.

An activity kind that has such screens names a function that builds a `PageRun` (``ActivityKind.page_run``).
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
    """A screen that a page runs by itself until the run reaches one of its ends.

    Attributes:
        module: the JavaScript module that runs the screen, as "package:file"; it exports the class ``PageRun``
            (``page_tools.d.ts``).
        values: the JSON values that the module needs.
        looks: the content from which the screen's digest is computed, with marks in place of the values that the module
            fills in; empty if the digest is computed from the screen itself.
        ends: for each end of the run, by name, a function that yields the inputs that lead a part to that end.
    """

    module: str
    values: Mapping[str, Any]
    looks: object
    ends: Mapping[str, Callable[[Activity], Iterator[Input]]]


def build_page_run(session: SessionMachine) -> PageRun | None:
    """Build the run of a session's present screen; return None if a page does not run the screen by itself."""
    if session.over or session.phase in (Phase.START, Phase.UNFOCUSED, Phase.PAUSED, Phase.QUIT_QUESTION):
        return None
    module, _, name = find_kind(session.part.part.kind).page_run.partition(":")
    if not module:
        return None
    page_run: PageRun | None = getattr(import_module(module), name)(session.part)
    return page_run
