"""Verify a logged plan: it and the participant's slot are those that the protocol's bytes produce.

A plan from an earlier version can lack later fields and be divided into other pages; both are allowed for.
"""

import hashlib
from collections.abc import Iterator
from functools import lru_cache
from itertools import zip_longest

import msgspec

from minihuman.activities.pages.plan import PagePlan
from minihuman.activities.play.plan import PlayPlan
from minihuman.admin.design_decisions import decide_again
from minihuman.admin.verify.contents import LogSegment
from minihuman.display.text import is_division
from minihuman.errors import MinihumanError
from minihuman.experiment.plan.allocation import AllocationSlot, build_allocation_list
from minihuman.experiment.plan.expansion import expand_protocol
from minihuman.experiment.plan.part_plans import find_paged_text
from minihuman.experiment.plan.participant_codes import parse_participant_code
from minihuman.experiment.plan.session_plan import EpisodePlan, PlannedPart, SessionPlan
from minihuman.experiment.protocol.protocol import Protocol, decode_logged_protocol
from minihuman.experiment.protocol.strata import build_strata
from minihuman.worlds.hashing import resolve_files

_LATER_OUTCOMES = {"ended"}
_ONCE_PER_PLAN = ("first_episode", "segment", "standing")  # fields that a resumed session changes


def compare_plan(segment: LogSegment) -> Iterator[str]:
    """Compare a segment's plan with the one that its protocol produces; yield the differences."""
    if segment.started is None:
        return
    plan = segment.started.plan
    if hashlib.sha256(plan.protocol_toml).hexdigest() != plan.protocol_sha256:
        yield "plan: protocol_sha256 is not the protocol's"
    try:
        protocol = _decode_protocol(plan.protocol_toml)
        protocol = msgspec.structs.replace(protocol, files=_find_page_pictures(protocol, plan) | plan.files)
        expected_plan = expand_protocol(
            protocol,
            plan.participant,
            session=plan.session,
            overridden=plan.overridden,
            outcome_rules=plan.outcome_rules,
        )
        yield from compare_slot(protocol, segment, plan)
        if parse_participant_code(plan.participant.id) != plan.participant.index:
            yield f"plan: participant {plan.participant.id} is at index {plan.participant.index}"
    except MinihumanError as error:
        yield f"plan: {error}"
        return
    for name in SessionPlan.__struct_fields__:
        logged = getattr(plan, name)
        expected = getattr(expected_plan, name)
        if name == "parts":
            expected = tuple(_adapt_part(protocol, plan, *parts) for parts in zip_longest(expected, logged))
        if name == "words":  # later versions added texts
            expected = {key: text for key, text in expected.items() if key in logged}
        if name == "episodes":
            expected = tuple(_adapt_episode(*episodes) for episodes in zip_longest(expected, logged))
        if name not in _ONCE_PER_PLAN and logged != expected:
            yield f"plan: {name} is not what the protocol gives"


@lru_cache(maxsize=4)  # the sessions of a study have the same bytes
def _decode_protocol(protocol_toml: bytes) -> Protocol:
    return decode_logged_protocol(protocol_toml)


def _find_page_pictures(protocol: Protocol, plan: SessionPlan) -> dict[str, bytes]:
    """Return the pictures of a plan's pages by their names in the protocol, since a log holds them without names."""
    pictures: dict[str, bytes] = {}
    for part in plan.parts:
        if not isinstance(part.plan, PagePlan):
            continue
        page = protocol.page_for(part.name, plan.participant.group)
        names = page.images if page else ()
        if not names:
            names = (protocol.study.logo,)
        pictures.update(zip(names, part.plan.pictures, strict=False))
    return pictures


def _adapt_part(
    protocol: Protocol, plan: SessionPlan, part: PlannedPart | None, logged: PlannedPart | None
) -> PlannedPart | None:
    """Return the expected part in the form of the logged part's version: with the same pages and fields.

    Args:
        protocol: the study's protocol.
        plan: the logged plan.
        part: the part that the protocol produces; None if it produces fewer parts.
        logged: the logged part; None if the log has fewer parts.
    """
    if part is None or logged is None or part.name != logged.name:
        return part
    return _drop_later_fields(_adopt_pages(protocol, plan, part, logged), logged)


def _adopt_pages(protocol: Protocol, plan: SessionPlan, part: PlannedPart, logged: PlannedPart) -> PlannedPart:
    """Return a part with the logged pages, if the logged plan has no pagination rules and they contain the whole text.

    Such pages were measured with the fonts and libraries of the recording machine, so they cannot be reproduced
    elsewhere.
    """
    match part.plan, logged.plan:
        case PagePlan(), PagePlan(pages=pages, pagination=msgspec.UNSET) as page:
            n_pictures = len(page.pictures) or int(bool(page.example))
            logged_fields = {"pages": pages, "pagination": msgspec.UNSET}
        case PlayPlan(), PlayPlan(instruction=pages, pagination=msgspec.UNSET) if pages:
            n_pictures = 0
            logged_fields = {"instruction": pages, "pagination": msgspec.UNSET}
        case _:
            return part
    text = find_paged_text(protocol, part.name, plan.participant.group)
    if text is None or not is_division(pages, text, pictures=n_pictures):
        return part
    return msgspec.structs.replace(part, plan=msgspec.structs.replace(part.plan, **logged_fields))


def _drop_later_fields(part: PlannedPart, logged: PlannedPart) -> PlannedPart:
    """Return the expected part without the fields and feedback that plans lacked when the logged part was made."""
    if not isinstance(part.plan, PlayPlan) or not isinstance(logged.plan, PlayPlan):
        return part
    # logs of schema 2 have no feedback for later outcomes
    feedback = {outcome: text for outcome, text in part.plan.feedback.items() if outcome in logged.plan.feedback}
    if part.plan.feedback.keys() - feedback.keys() <= _LATER_OUTCOMES:
        part = msgspec.structs.replace(part, plan=msgspec.structs.replace(part.plan, feedback=feedback))
    if logged.plan.computed == "page":
        return part
    # earlier versions had the server compute all first-person worlds, or did not say who computes
    return msgspec.structs.replace(part, plan=msgspec.structs.replace(part.plan, computed=logged.plan.computed))


def _adapt_episode(episode: EpisodePlan | None, logged: EpisodePlan | None) -> EpisodePlan | None:
    """Return the expected episode in the form of the logged episode's version; None if the protocol produces none.

    Earlier versions had images and labels among an episode's options, and computed first-person worlds only with the
    host's sine.
    """
    if episode is None or logged is None:
        return episode
    options = {name: setting for name, setting in episode.options.items() if name != "trig" or name in logged.options}
    if options.get("image") != logged.options.get("image"):
        options = resolve_files(options)
    if not logged.labels and not set(episode.labels).isdisjoint(logged.options):
        return msgspec.structs.replace(episode, options=options | episode.labels, labels={})
    return msgspec.structs.replace(episode, options=options)


def compare_slot(protocol: Protocol, segment: LogSegment, plan: SessionPlan) -> Iterator[str]:
    """Compare a participant's group and stratum with the allocation list, and the stratum with their answer.

    Args:
        protocol: the study's protocol.
        segment: the segment, whose events include the answer if the participant was asked in it.
        plan: the segment's plan.

    Yields:
        A line for each difference.
    """
    participant = plan.participant
    slots = build_allocation_list(protocol)
    if not 0 <= participant.place < len(slots):
        yield f"plan: slot {participant.place} is outside the allocation list of {len(slots)}"
        return
    slot = slots[participant.place]
    yield from _compare_group(protocol, plan, slot)
    if slot.stratum != participant.stratum:
        yield f"plan: participant's stratum {participant.stratum!r}, in the allocation list {slot.stratum!r}"
    strata = build_strata(protocol)
    is_asked = plan.session == 1 and plan.segment == 1
    if strata is None or not is_asked:
        return
    answered = strata.find_stratum(segment.events)
    if answered not in (None, participant.stratum):
        yield f"plan: participant's stratum {participant.stratum!r}, by the answer to {strata.question} {answered!r}"


def _compare_group(protocol: Protocol, plan: SessionPlan, slot: AllocationSlot) -> Iterator[str]:
    """Yield how a participant's group differs from the design's decision or, without a design, the allocation list.

    Args:
        protocol: the study's protocol.
        plan: the logged plan, which has the participant.
        slot: the participant's slot in the allocation list.
    """
    participant = plan.participant
    assigned = participant.assigned
    has_design = protocol.allocation.design is not None
    if assigned is not None and has_design:
        decided = decide_again(protocol, assigned, participant.index, participant.stratum).group
        if decided != participant.group:
            yield (
                f"plan: participant's group {participant.group!r}, by the statistics of {assigned.design} {decided!r}"
            )
        return
    if plan.overridden:
        return
    if has_design or assigned is not None:
        yield "plan: the group's assignment is not by the protocol's design"
    elif slot.group != participant.group:
        yield f"plan: participant's group {participant.group!r}, in the allocation list {slot.group!r}"
