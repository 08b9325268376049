"""The rules for which protocols can run without a server: a rule is a function that yields what stands against it."""

from collections.abc import Iterator
from typing import Any

import msgspec

from minihuman.experiment.plan.session_plan import PlannedPart, SessionPlan
from minihuman.experiment.protocol.protocol import Protocol
from minihuman.experiment.protocol.strata import build_strata
from minihuman.web.site.site_error import SiteError

_KINDS = ("page", "keyboard_check", "questions", "play")
_QUESTION_KINDS = ("choice", "choices", "likert")
_INSTEAD = "serve the study with: minihuman serve"


def require_site_support(protocol: Protocol, plan: SessionPlan) -> None:
    """Require that a static folder can run a participant's session.

    Raises:
        SiteError: if it cannot; the message names the first part that stands against it.
    """
    for obstacle in (*_list_study_obstacles(protocol), *_list_plan_obstacles(plan)):
        raise SiteError(f"{protocol.study.name}: {obstacle}; {_INSTEAD}")


def _list_study_obstacles(protocol: Protocol) -> Iterator[str]:
    if build_strata(protocol) is not None:
        yield "groups are drawn by strata, for which pages would have to know of each other"
    if len(protocol.sessions) > 1:
        yield f"the study has {len(protocol.sessions)} sessions, and a site runs one"
    if protocol.bonus is not None:
        yield "a bonus is paid, which a page could invent"


def _list_plan_obstacles(plan: SessionPlan) -> Iterator[str]:
    for part in plan.parts:
        if part.kind not in _KINDS:
            yield f"part {part.name!r} is of kind {part.kind!r}, which no page runs alone"
        elif part.kind == "questions":
            yield from _list_question_obstacles(part)
        elif part.kind == "play":
            yield from _list_block_obstacles(part)
    for episode in plan.episodes:
        if episode.pace != "on_key":
            yield f"block {episode.block_name!r} has pace {episode.pace!r}, and a site's blocks are played on_key"
        if episode.response_deadline_ms:
            yield f"block {episode.block_name!r} has a response deadline"


def _list_question_obstacles(part: PlannedPart) -> Iterator[str]:
    questions: tuple[Any, ...] = part.plan.items
    for question in questions:
        place = f"question {question.name!r} of {part.name!r}"
        if question.kind not in _QUESTION_KINDS:
            yield f"{place} is of kind {question.kind!r}; a site asks {', '.join(_QUESTION_KINDS)}"
        if question.only_if:
            yield f"{place} depends on an earlier answer (only_if)"
        if question.right is not None:
            yield f"{place} has a correct answer, which the page would have to hold"


def _list_block_obstacles(part: PlannedPart) -> Iterator[str]:
    plan: Any = part.plan
    for name, words in (
        ("until", "goes on until a criterion is met"),
        ("points", "gives points"),
        ("show_points", "shows points"),
        ("max_s", "limits an episode's time"),
        ("block_max_s", "limits the block's time"),
        ("trial", "is a block of trials"),
        ("bindings", "is played by pointer or gamepad"),
        ("design", "has an adaptive design"),
    ):
        setting = getattr(plan, name)
        if setting and setting is not msgspec.UNSET:
            yield f"block {part.name!r} {words}"
    if plan.computed != "page":
        yield f"block {part.name!r} is computed by the server"
