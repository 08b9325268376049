"""Plans of a session's parts: texts in pages, questions in order, and each block as its kind defines it."""

import hashlib
from collections.abc import Iterator, Sequence
from typing import Any

import msgspec

from minihuman.activities.keyboard_check.plan import KeyboardCheckPlan
from minihuman.activities.pages.plan import PagePlan
from minihuman.activities.play.plan import ComputedBy, PlayPlan
from minihuman.activities.questions.plan import QuestionsPlan
from minihuman.activities.team.debrief import DebriefPlan
from minihuman.display.text import PAGINATION_RULES, paginate_text
from minihuman.errors import ProtocolError
from minihuman.experiment.machine.activity import ActivityKind, find_kind
from minihuman.experiment.machine.bindings import Bindings
from minihuman.experiment.plan import trials
from minihuman.experiment.plan.part_names import CLOSING, CONSENT, DEBRIEF, KEYBOARD, is_block
from minihuman.experiment.plan.random_streams import draw_permutation
from minihuman.experiment.plan.session_plan import EpisodePlan, Participant, PlannedPart
from minihuman.experiment.protocol.protocol import BlockSpec, Protocol
from minihuman.experiment.protocol.specs import (
    PageSpec,
    QuestionnaireSpec,
    apply_overrides,
    list_question_kinds,
    load_form,
)
from minihuman.experiment.words import ENGLISH, LANGUAGES, InterfaceWords, flatten_words, load_kind_words, load_words
from minihuman.worlds.catalogue import is_compiled_grid, is_first_person

OUTCOMES = ("goal", "timeout", "failure", "abandoned", "ended")


def list_changed_words(protocol: Protocol) -> dict[str, str]:
    """Return, by key, the interface texts of a study that differ from English; empty for most English studies."""
    language = protocol.study.language
    stated_words = flatten_words(protocol.words)
    if protocol.study.theme != "dark":
        stated_words["theme"] = protocol.study.theme  # logged with the texts, since it changes how they are displayed
    if language == ENGLISH or language not in LANGUAGES:
        return stated_words
    kind_words: dict[str, str] = {}
    for kind in list_question_kinds(protocol.questions, [group.name for group in protocol.groups]):
        kind_words |= load_kind_words(kind, language)
    return {**kind_words, **load_words(language), **stated_words}


def load_study_words(protocol: Protocol) -> InterfaceWords:
    """Return the interface texts of a study, in its language and with its replacements."""
    return InterfaceWords(protocol.study.language, list_changed_words(protocol), protocol.study.fonts)


def find_consent_text(protocol: Protocol, group: str, names: Sequence[str]) -> str:
    """Return the text of the first consent page among the parts ``names``; without one, the consent text in [study]."""
    for name in names:
        page = protocol.page_for(name, group)
        if page is not None and page.asks_consent:
            return page.text
    return protocol.study.consent


def plan_parts(
    protocol: Protocol,
    participant: Participant,
    session: int,
    names: Sequence[str],
    blocks: Sequence[BlockSpec],
    episodes: Sequence[EpisodePlan],
) -> Iterator[PlannedPart]:
    """Yield the plan of each part of a session, in order; ``blocks`` and ``episodes`` are in the order of ``names``.

    Raises:
        ProtocolError: if a page's picture is missing, or questions return to a part outside the session.
    """
    words = load_study_words(protocol)
    group = participant.group
    block_number = 0
    for name in names:
        page = protocol.page_for(name, group)
        questionnaire = next((spec for spec in protocol.questions if spec.name == name), None)
        if page is not None:
            yield PlannedPart("page", name, _plan_page(protocol, page, words))
        elif questionnaire is not None:
            spec = apply_overrides(questionnaire, group)
            yield PlannedPart("questions", name, _plan_questionnaire(protocol, participant, session, spec, names))
        elif any(block.name == name for block in protocol.blocks):
            block = blocks[block_number]
            kind = find_kind(block.kind)
            play = _plan_block(kind, protocol, blocks, block_number, episodes, words)
            optional_fields = _plan_optional_fields(protocol, participant, session, block)
            yield PlannedPart(kind.name, name, msgspec.structs.replace(play, **optional_fields))
            block_number += 1
        elif (activity := next((spec for spec in protocol.activities if spec.name == name), None)) is not None:
            yield PlannedPart(activity.kind, name, find_kind(activity.kind).read(activity.settings))
        elif name == DEBRIEF:
            yield PlannedPart("debrief", name, DebriefPlan())
        elif name == KEYBOARD:
            yield PlannedPart("keyboard_check", name, KeyboardCheckPlan(protocol.keys.pool))
        else:
            yield PlannedPart("page", name, _plan_page(protocol, _build_default_page(protocol, name, words), words))


def _plan_optional_fields(
    protocol: Protocol, participant: Participant, session: int, block: BlockSpec
) -> dict[str, Any]:
    """Return the fields of a block's plan that only some blocks have: rules of trials, bindings and a design.

    Fields that the block lacks are unset.
    """
    purpose = f"{block.name}-session-{session}"
    bindings = Bindings(block.axes, block.spot)
    return {
        "trial": trials.plan_rules(block, protocol.study.seed, purpose, participant.index),
        "bindings": msgspec.UNSET if bindings == Bindings() else bindings,
        "design": block.design or msgspec.UNSET,
    }


def _list_images(protocol: Protocol, page: PageSpec) -> tuple[str, ...]:
    """Return the files of a page's pictures; consent and closing pages without any show the study's logo."""
    if page.images:
        return page.images
    shows_logo = (page.asks_consent or page.closing) and page.example is None
    if shows_logo and protocol.study.logo:
        return (protocol.study.logo,)
    return ()


def _build_default_page(protocol: Protocol, name: str, words: InterfaceWords) -> PageSpec:
    """Return the consent or closing page, whichever ``name`` is, with the text in ``[study]``."""
    study = protocol.study
    if name == CONSENT:
        return PageSpec(CONSENT, study.consent, words["consent.title"], asks_consent=True)
    assert name == CLOSING
    return PageSpec(CLOSING, words["closing.text"] if study.closing is None else study.closing, closing=True)


def _plan_page(protocol: Protocol, page: PageSpec, words: InterfaceWords) -> PagePlan:
    """Return the plan of a page of text; a consent page is identified by the SHA-256 of its text.

    Raises:
        ProtocolError: if a picture of the page is missing.
    """
    title = page.title
    sha256 = ""
    if page.asks_consent:
        title = title or words["consent.title"]
        sha256 = hashlib.sha256(page.text.encode()).hexdigest()
    elif page.closing:
        title = title or words["closing.title"]
    images = _list_images(protocol, page)
    missing = [name for name in images if name not in protocol.files]
    if missing:
        raise ProtocolError(
            f"page {page.name!r} uses the picture {missing[0]!r}, which is not in the protocol's folder; copy it there"
        )
    pages = paginate_text(page.text, pictures=len(images) or bool(page.example))
    return PagePlan(
        title=title,
        pages=pages,
        agree=page.asks_consent,
        sha256=sha256,
        closing=page.closing,
        pictures=tuple(protocol.files[name] for name in images),
        example=page.example,
        pagination=_find_pagination_rules(pages),
    )


def _find_pagination_rules(pages: Sequence[str]) -> int | msgspec.UnsetType:
    """Return the version of the rules that divided a text into pages; unset for a text of one page, or without text."""
    if len(pages) > 1:
        return PAGINATION_RULES
    return msgspec.UNSET


def find_paged_text(protocol: Protocol, name: str, group: str) -> str | None:
    """Return the whole text of a page or of a block's instructions; None for a part in [[activities]]."""
    if any(activity.name == name for activity in protocol.activities):
        return None
    if is_block(protocol, name):
        return protocol.block_for(name, group).instructions
    page = protocol.page_for(name, group)
    return (page or _build_default_page(protocol, name, load_study_words(protocol))).text


def _plan_questionnaire(
    protocol: Protocol, participant: Participant, session: int, spec: QuestionnaireSpec, names: Sequence[str]
) -> QuestionsPlan:
    """Return the plan of a questionnaire, with its own items or its shipped form's, in the participant's order.

    Raises:
        ProtocolError: if the questions return to a part that is not among the session's ``names``.
    """
    title = spec.title
    items = spec.items
    if spec.form:
        shipped = load_form(spec.form, protocol.study.language)
        title = title or shipped.title
        items = shipped.items
    if spec.shuffle:
        purpose = f"items-{spec.name}-session-{session}"
        order = draw_permutation(len(items), seed=protocol.study.seed, purpose=purpose, index=participant.index)
        items = tuple(items[index] for index in order)
    back_to = protocol.group(participant.group).replace_parts.get(spec.return_to, spec.return_to)
    if back_to and back_to not in names:
        raise ProtocolError(
            f"questions {spec.name!r} return to {back_to!r}, which is not in session {session}; add it to the session"
        )
    return QuestionsPlan(
        title=title,
        items=items,
        tries=spec.max_attempts,
        wrong=spec.wrong_answer_text,
        back_to=names.index(back_to) if back_to else None,
        failed=spec.on_failure,
    )


def _plan_block(
    kind: ActivityKind,
    protocol: Protocol,
    blocks: Sequence[BlockSpec],
    number: int,
    episodes: Sequence[EpisodePlan],
    words: InterfaceWords,
) -> PlayPlan:
    """Return the plan of ``blocks[number]``: the fields that all blocks have, and those that its kind adds."""
    play = _plan_play(protocol, blocks, number, episodes, words)
    if kind.plan is PlayPlan:
        return play
    block = blocks[number]
    kind_fields = {
        "agent": block.agent,
        "team": block.team,
        "timeline": block.timeline,
        "seeds": "listed" if isinstance(block.seeds, tuple) else block.seeds,
    }
    added_fields: dict[str, Any] = {
        name: content for name, content in kind_fields.items() if name in kind.plan_fields and content is not None
    }
    if "timeline" in added_fields:
        added_fields["hold_ms"] = 0.0  # the timeline defines what is shown until the trial ends
    plan = kind.plan(**msgspec.structs.asdict(play) | added_fields)
    assert isinstance(plan, PlayPlan), "the protocol's check refuses other kinds for blocks"
    return plan


def _find_fixed_interval_ms(block: BlockSpec) -> float:
    """Return the interval between a block's episodes in milliseconds; 0 if each is drawn from a range.

    Drawn intervals are in the block's `TrialRules`.
    """
    if isinstance(block.inter_trial_interval_ms, tuple):
        return 0.0
    return block.inter_trial_interval_ms


def _plan_play(
    protocol: Protocol,
    blocks: Sequence[BlockSpec],
    number: int,
    episodes: Sequence[EpisodePlan],
    words: InterfaceWords,
) -> PlayPlan:
    """Return the plan of ``blocks[number]`` with the fields that blocks of all kinds have."""
    block = blocks[number]
    n_blocks = len(blocks)
    block_episodes = [episode for episode in episodes if episode.block == number]
    is_last = number + 1 == n_blocks
    instruction = paginate_text(block.instructions) if block.instructions else ()
    return PlayPlan(
        block=number,
        blocks=n_blocks,
        first=block_episodes[0].episode,
        count=len(block_episodes),
        title=block.title or _format_block_number(words, number, n_blocks),
        instruction=instruction,
        feedback=_plan_feedback(block),
        rest="" if is_last else block.rest_text,
        rest_s=0.0 if is_last else protocol.study.min_rest_s,
        interval_ms=_find_fixed_interval_ms(block),
        fixation_ms=block.fixation_ms,
        hold_ms=block.final_frame_ms,
        marks=block.show_outcome,
        max_s=block.max_episode_s,
        block_max_s=block.max_block_s,
        until=block.stop_criterion,
        points=block.points,
        show_points=block.show_points,
        mission=block.mission,
        computed=_choose_computer(block),
        motion_ms=block.motion_ms or msgspec.UNSET,
        pagination=_find_pagination_rules(instruction),
    )


def _format_block_number(words: InterfaceWords, number: int, n_blocks: int) -> str:
    """Return a title for the block of index ``number``, such as "Part 1 of 2"; "" if there is only one block."""
    if n_blocks < 2:
        return ""
    return words.fill("progress.part", part=number + 1, parts=n_blocks)


def _plan_feedback(block: BlockSpec) -> dict[str, str]:
    """Return the feedback text by outcome, without outcomes that have none."""
    texts = dict.fromkeys(OUTCOMES, block.feedback) if isinstance(block.feedback, str) else block.feedback
    return {outcome: text for outcome, text in texts.items() if text}


def _choose_computer(block: BlockSpec) -> ComputedBy:
    """Return whether the page or the server computes a block's worlds if it is played in a browser.

    If the block does not state it, a page computes plain play in most built-in worlds, and the server anything else.
    """
    if block.computed:
        return block.computed
    if not find_kind(block.kind).is_plain_play:
        return "server"
    if block.design is not None:  # only the server asks designs
        return "server"
    is_view_from_inside = is_first_person(block.world) and block.view != "full"
    is_grid = is_compiled_grid(block.world, block.options) and block.view != "text" and block.hold == "once"
    return "page" if is_grid or is_view_from_inside else "server"


def list_world_options(block: BlockSpec) -> dict[str, Any]:
    """Return the options with which a block makes its world.

    A first-person world that a page computes gets ``trig = 1`` by default: sines that are equal on every machine.
    """
    options: dict[str, Any] = {}
    if is_first_person(block.world) and _choose_computer(block) == "page":
        options["trig"] = 1
    return options | dict(block.options)
