"""Expand a protocol and a participant into a session plan. Pure, and the same on every machine.

Resolves groups, orders and sessions into parts, texts into pages, and blocks into episodes with seeds and key maps.
"""

import hashlib
import re
from collections.abc import Iterator, Sequence
from typing import Any

import msgspec

from minihuman.activities.keyboard_check.plan import KeyboardCheckPlan
from minihuman.activities.pages.plan import PagePlan
from minihuman.activities.play.plan import ComputedBy, PlayPlan
from minihuman.activities.questions.plan import QuestionsPlan
from minihuman.activities.team.debrief import DebriefPlan
from minihuman.activities.team.plan import TeamPlayPlan
from minihuman.display.text import PAGINATION_RULES, paginate_text
from minihuman.errors import AllocationError, ProtocolError
from minihuman.experiment.machine.activity import ActivityKind, find_kind
from minihuman.experiment.machine.bindings import Bindings
from minihuman.experiment.plan import trials
from minihuman.experiment.plan.allocation import AllocationSlot, allocation_sha256, build_allocation_list, find_slot
from minihuman.experiment.plan.random_streams import draw_permutation, draw_seeds
from minihuman.experiment.plan.session_plan import BlockText, EpisodePlan, KeyMap, Participant, PlannedPart, SessionPlan
from minihuman.experiment.protocol.protocol import BlockSpec, Protocol
from minihuman.experiment.protocol.specs import PageSpec, QuestionnaireSpec, apply_overrides, load_form
from minihuman.experiment.words import ENGLISH, LANGUAGES, InterfaceWords, flatten_words, load_words
from minihuman.worlds.catalogue import is_compiled_grid, is_first_person

MAX_SESSION_EPISODES = 20_000  # the plan is made and logged whole

CONSENT, KEYBOARD, DEBRIEF, CLOSING = "consent", "keyboard_check", "debrief", "closing"


def list_part_names(protocol: Protocol, slot: AllocationSlot, group: str, session: int) -> list[str]:
    """The names of a session's parts in order, keyboard check and closing included where they come by themselves.

    Raises:
        AllocationError: if the study has no such session.
    """
    if not protocol.lists_parts:  # a group lists blocks: what belongs around them comes by itself
        parts = [
            *([CONSENT] if protocol.study.consent else []),
            *([KEYBOARD] if protocol.keys.keyboard_check else []),
            *protocol.group(group).blocks,
            *([CLOSING] if protocol.study.closing != "" else []),
        ]
        return _add_debrief(protocol, parts, group)
    if protocol.sessions:
        if session > len(protocol.sessions):
            raise AllocationError(
                f"study {protocol.study.name!r} has {len(protocol.sessions)} sessions, not {session}; "
                "choose another number with --session, or add one to [[sessions]]"
            )
        listed = protocol.sessions[session - 1].parts
    else:
        listed = protocol.group(group).parts
    instead = protocol.group(group).replace_parts
    names: list[str] = []
    for name in listed:
        chosen = instead.get(name, name)
        inside = _apply_order(protocol, slot, chosen)
        names += [chosen] if inside is None else [instead.get(part, part) for part in inside]
    return _add_debrief(protocol, _add_default_parts(protocol, [name for name in names if name], session), group)


def _apply_order(protocol: Protocol, slot: AllocationSlot, name: str) -> list[str] | None:
    """The parts that an order stands for, in the slot's order; None for the name of a part."""
    for number, order in enumerate(protocol.orders):
        if order.name == name:
            return [part for place in slot.orders[number] for part in order.units[place]]
    return None


def _add_default_parts(protocol: Protocol, names: list[str], session: int) -> list[str]:
    """Parts, with the consent of the first session, a keyboard check before the first block, and last words."""
    blocks = {block.name for block in protocol.blocks}
    if protocol.keys.keyboard_check and KEYBOARD not in names:
        first = next((place for place, name in enumerate(names) if name in blocks), None)
        if first is not None:
            names = [*names[:first], KEYBOARD, *names[first:]]
    if protocol.study.consent and session == 1 and not _has_page(protocol, names, "asks_consent"):
        names = [CONSENT, *names]
    if protocol.study.closing != "" and not _has_page(protocol, names, "closing"):
        names = [*names, CLOSING]
    return names


def _add_debrief(protocol: Protocol, names: list[str], group: str) -> list[str]:
    """Parts, with the page that tells what the partners were before the last words, where the protocol defers it."""
    teams = [protocol.block_for(name, group).team for name in names if _is_block(protocol, name)]
    if DEBRIEF in names or not any(team and team.partner_disclosure == "debrief" for team in teams):
        return names
    at = len(names) - (names[-1] == CLOSING or _has_page(protocol, names[-1:], "closing"))
    return [*names[:at], DEBRIEF, *names[at:]]


def _has_page(protocol: Protocol, names: list[str], what: str) -> bool:
    return any(page.name in names and getattr(page, what) for page in protocol.pages)


OUTCOMES = ("goal", "timeout", "failure", "abandoned")


def list_changed_words(protocol: Protocol) -> dict[str, str]:
    """The interface's words of a study, as far as they are not English's: none for most English studies."""
    language, instead = protocol.study.language, flatten_words(protocol.words)
    if protocol.study.theme != "dark":
        instead["theme"] = protocol.study.theme  # so that it is in the log, with how else words are shown
    return instead if language == ENGLISH or language not in LANGUAGES else {**load_words(language), **instead}


def load_study_words(protocol: Protocol) -> InterfaceWords:
    """The interface's words of a study."""
    return InterfaceWords(protocol.study.language, list_changed_words(protocol), protocol.study.fonts)


def find_consent_text(protocol: Protocol, group: str, names: Sequence[str]) -> str:
    """The text that is agreed to in a session with these parts."""
    texts = (protocol.page_for(name, group) for name in names)
    agreed = next((page.text for page in texts if page and page.asks_consent), None)
    return protocol.study.consent if agreed is None else agreed


def plan_parts(
    protocol: Protocol,
    participant: Participant,
    session: int,
    names: Sequence[str],
    blocks: Sequence[BlockSpec],
    episodes: Sequence[EpisodePlan],
) -> Iterator[PlannedPart]:
    """A plan for each part of a session, in order."""
    words, group = load_study_words(protocol), participant.group
    number = 0
    for name in names:
        page = protocol.page_for(name, group)
        asked = next((apply_overrides(asked, group) for asked in protocol.questions if asked.name == name), None)
        if page is not None:
            yield PlannedPart("page", name, _plan_page(protocol, page, words))
        elif asked is not None:
            yield PlannedPart("questions", name, _plan_questionnaire(protocol, participant, session, asked, names))
        elif any(block.name == name for block in protocol.blocks):
            kind = find_kind(blocks[number].kind)
            play = _plan_block(kind, protocol, blocks, number, episodes, words)
            purpose = f"{name}-session-{session}"
            trial = trials.plan_rules(blocks[number], protocol.study.seed, purpose, participant.index)
            bound = Bindings(blocks[number].axes, blocks[number].spot)
            own = {
                "trial": trial,
                "bindings": msgspec.UNSET if bound == Bindings() else bound,
                "design": blocks[number].design or msgspec.UNSET,
            }
            yield PlannedPart(kind.name, name, msgspec.structs.replace(play, **own))
            number += 1
        elif (other := next((other for other in protocol.activities if other.name == name), None)) is not None:
            yield PlannedPart(other.kind, name, find_kind(other.kind).read(other.settings))
        elif name == DEBRIEF:
            yield PlannedPart("debrief", name, DebriefPlan())
        elif name == KEYBOARD:
            yield PlannedPart("keyboard_check", name, KeyboardCheckPlan(protocol.keys.pool))
        else:
            yield PlannedPart("page", name, _plan_page(protocol, _build_default_page(protocol, name, words), words))


def _list_images(protocol: Protocol, page: PageSpec) -> tuple[str, ...]:
    """The files of a page's pictures: a consent and last words without one have the study's logo."""
    has_logo = protocol.study.logo and (page.asks_consent or page.closing) and page.example is None
    return page.images or ((protocol.study.logo,) if has_logo else ())


def _build_default_page(protocol: Protocol, name: str, words: InterfaceWords) -> PageSpec:
    """The consent or the last words of ``[study]``."""
    study = protocol.study
    if name == CONSENT:
        return PageSpec(CONSENT, study.consent, words["consent.title"], asks_consent=True)
    assert name == CLOSING
    return PageSpec(CLOSING, words["closing.text"] if study.closing is None else study.closing, closing=True)


def _plan_page(protocol: Protocol, page: PageSpec, words: InterfaceWords) -> PagePlan:
    title = page.title
    if not title and (page.asks_consent or page.closing):
        title = words["consent.title" if page.asks_consent else "closing.title"]
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
        sha256=hashlib.sha256(page.text.encode()).hexdigest() if page.asks_consent else "",
        closing=page.closing,
        pictures=tuple(protocol.files[name] for name in images),
        example=page.example,
        pagination=_pagination_of(pages),
    )


def _pagination_of(pages: Sequence[str]) -> int | msgspec.UnsetType:
    """Return the rules by which a text was divided; unset where there was nothing to divide."""
    return PAGINATION_RULES if len(pages) > 1 else msgspec.UNSET


def find_paged_text(protocol: Protocol, name: str, group: str) -> str | None:
    """Return the whole text that a page or a block's instructions show in pages; None for an activity with its own."""
    if any(activity.name == name for activity in protocol.activities):
        return None
    if _is_block(protocol, name):
        return protocol.block_for(name, group).instructions
    page = protocol.page_for(name, group)
    return (page or _build_default_page(protocol, name, load_study_words(protocol))).text


def _plan_questionnaire(
    protocol: Protocol, participant: Participant, session: int, asked: QuestionnaireSpec, names: Sequence[str]
) -> QuestionsPlan:
    title, items = asked.title, asked.items
    if asked.form:
        shipped = load_form(asked.form, protocol.study.language)
        title, items = title or shipped.title, shipped.items
    if asked.shuffle:
        purpose = f"items-{asked.name}-session-{session}"
        order = draw_permutation(len(items), seed=protocol.study.seed, purpose=purpose, index=participant.index)
        items = tuple(items[place] for place in order)
    back_to = protocol.group(participant.group).replace_parts.get(asked.return_to, asked.return_to)
    if back_to and back_to not in names:
        raise ProtocolError(
            f"questions {asked.name!r} return to {back_to!r}, which is not in session {session}; add it to the session"
        )
    return QuestionsPlan(
        title=title,
        items=items,
        tries=asked.max_attempts,
        wrong=asked.wrong_answer_text,
        back_to=names.index(back_to) if back_to else None,
        failed=asked.on_failure,
    )


def _plan_block(
    kind: ActivityKind,
    protocol: Protocol,
    blocks: Sequence[BlockSpec],
    number: int,
    episodes: Sequence[EpisodePlan],
    words: InterfaceWords,
) -> PlayPlan:
    """A block's plan as its kind has it."""
    play = _plan_play(protocol, blocks, number, episodes, words)
    if kind.plan is PlayPlan:
        return play
    fields = {name: getattr(play, name) for name in play.__struct_fields__}
    if blocks[number].agent is not None:
        fields["agent"] = blocks[number].agent
    if kind.plan is TeamPlayPlan and (team := blocks[number].team) is not None:
        seeds = blocks[number].seeds
        fields |= {"team": team, "seeds": "listed" if isinstance(seeds, tuple) else seeds}
    made = kind.plan(**fields)
    assert isinstance(made, PlayPlan)  # the protocol's check has seen to it
    return made


def _plan_play(
    protocol: Protocol,
    blocks: Sequence[BlockSpec],
    number: int,
    episodes: Sequence[EpisodePlan],
    words: InterfaceWords,
) -> PlayPlan:
    block, count = blocks[number], len(blocks)
    its = [episode for episode in episodes if episode.block == number]
    last = number + 1 == count
    title = words.fill("progress.part", part=number + 1, parts=count) if count > 1 else ""
    feedback = dict.fromkeys(OUTCOMES, block.feedback) if isinstance(block.feedback, str) else dict(block.feedback)
    instruction = paginate_text(block.instructions) if block.instructions else ()
    return PlayPlan(
        block=number,
        blocks=count,
        first=its[0].episode,
        count=len(its),
        title=block.title or title,
        instruction=instruction,
        feedback={outcome: text for outcome, text in feedback.items() if text},
        rest="" if last else block.rest_text,
        rest_s=0.0 if last else protocol.study.min_rest_s,
        interval_ms=0.0 if isinstance(block.inter_trial_interval_ms, tuple) else block.inter_trial_interval_ms,
        fixation_ms=block.fixation_ms,
        hold_ms=block.final_frame_ms,
        marks=block.show_outcome,
        max_s=block.max_episode_s,
        block_max_s=block.max_block_s,
        until=block.stop_criterion,
        points=block.points,
        show_points=block.show_points,
        mission=block.mission,
        computed=_computed_by(block),
        motion_ms=block.motion_ms or msgspec.UNSET,
        pagination=_pagination_of(instruction),
    )


def _computed_by(block: BlockSpec) -> ComputedBy:
    """The page, for an ordinary block in a world of ours; what the protocol says, if it does."""
    # what held keys combine to, and what a design decides, the server knows
    ordinary = block.kind == "play" and block.hold == "once" and block.design is None
    is_grid = is_compiled_grid(block.world, block.options) and block.view != "text"
    own = is_grid or (is_first_person(block.world) and block.view != "full")
    return block.computed or ("page" if ordinary and own else "server")


def list_world_options(block: BlockSpec) -> dict[str, Any]:
    """A block's options for its world; what a page computes goes by the sine that is the same everywhere."""
    portable = is_first_person(block.world) and _computed_by(block) == "page"
    return ({"trig": 1} if portable else {}) | dict(block.options)


_CODE = re.compile(r"(sub|model)-(?P<number>\d{2,6})")
MAX_SLOTS = 100_000  # of an allocation list; codes from there on are of those who take a slot over


def parse_participant_code(code: str) -> int:
    """The slot that a participant's code says: 6 for "sub-07", and for "sub-100007", who took the slot over.

    Raises:
        AllocationError: if it is no such code.
    """
    match = _CODE.fullmatch(code)
    if match is None or int(match["number"]) == 0:
        raise AllocationError(f"{code!r} is not a participant code; use 'sub-' and a number from 01, never a name")
    return (int(match["number"]) - 1) % MAX_SLOTS


def format_participant_code(index: int, before: int = 0, *, prefix: str = "sub") -> str:
    """The code of a slot's participant: "sub-07" for 6, "sub-100007" for the next after one who left it.

    ``prefix`` is "model" for a language model in a participant's place.
    """
    return f"{prefix}-{before * MAX_SLOTS + index + 1:02d}"


def enrol_participant(
    protocol: Protocol, index: int, group: str | None = None, *, stratum: str | None = None
) -> Participant:
    """The participant at a place of the allocation list; ``group`` overrides the list's.

    Where groups are drawn after an answer it is a place of a stratum's list, the first stratum's where none is given.

    Raises:
        AllocationError: if the list is not that long, or there is no such stratum.
        ProtocolError: if there is no such group.
    """
    slot = find_slot(protocol, index, stratum)
    return assign_slot(protocol, Participant(format_participant_code(index), index, group or ""), slot)


def assign_slot(protocol: Protocol, who: Participant, slot: AllocationSlot) -> Participant:
    """A participant in a slot, in its group unless they are in one already.

    Raises:
        ProtocolError: if there is no such group.
    """
    group = protocol.group(who.group or slot.group).name
    own = slot.index if slot.stratum else None
    return msgspec.structs.replace(who, group=group, stratum=slot.stratum, slot=own)


def expand_protocol(
    protocol: Protocol,
    participant: Participant,
    *,
    session: int = 1,
    overridden: bool = False,
    first_episode: int = 0,
    segment: int = 1,
) -> SessionPlan:
    """Everything the session will ask for, before the first key press.

    ``overridden`` says that participant or group was chosen by hand; ``first_episode`` and ``segment`` say where
    the session resumes, and change nothing else. For a participant whose group is not drawn yet the plan is right up
    to the draw, and some group's from there on.
    """
    slots = build_allocation_list(protocol)
    slot = slots[participant.place if participant.group else 0]
    drawn, participant = participant, assign_slot(protocol, participant, slot)
    names = list_part_names(protocol, slot, participant.group, session)
    blocks = [protocol.block_for(name, participant.group) for name in names if _is_block(protocol, name)]
    if (count := sum(block.episodes for block in blocks)) > MAX_SESSION_EPISODES:
        raise ProtocolError(f"session {session} has {count} episodes; use at most {MAX_SESSION_EPISODES}")
    episodes: list[EpisodePlan] = []
    key_map: KeyMap | None = None
    for number, block in enumerate(blocks):
        place = _find_draw(protocol, block, blocks, number)
        if block.key_map == "fixed":
            key_map = _deal_spare_keys(protocol, block, dict(block.fixed_keys), participant, session, place)
        elif block.key_map == "constant":
            key_map = _map_row_to_keys(protocol, block, slot.kept, participant, session, place)
        elif key_map is None or block.key_map != "carry_over":
            key_map = _draw_key_map(protocol, block, slot.positions[place], participant, session, place)
        else:
            key_map = _carry_key_map(protocol, blocks[number - 1], block, key_map, participant, session, place)
        episodes += _plan_episodes(protocol, block, number, place, key_map, participant, session, len(episodes))
    words = load_study_words(protocol)
    texts = tuple(
        BlockText(
            b.instructions, b.feedback if isinstance(b.feedback, str) else "", b.rest_text, protocol.study.min_rest_s
        )
        for b in blocks
    )
    parts = tuple(plan_parts(protocol, participant, session, names, blocks, episodes))
    agreed = [part.plan for part in parts if isinstance(part.plan, PagePlan) and part.plan.agree]
    consent = find_consent_text(protocol, participant.group, names)
    return SessionPlan(
        study=protocol.study.name,
        study_version=protocol.study.version,
        protocol_toml=protocol.toml,
        protocol_sha256=protocol.sha256,
        participant=drawn,
        session=session,
        study_seed=protocol.study.seed,
        allocation_sha256=allocation_sha256(slots),
        overridden=overridden,
        consent_text=consent if agreed else "",
        consent_sha256=hashlib.sha256((consent if agreed else "").encode()).hexdigest(),
        key_pool=protocol.keys.pool,
        keyboard_check=KEYBOARD in names,
        texts=texts,
        closing_text=words["closing.text"] if protocol.study.closing is None else protocol.study.closing,
        episodes=tuple(episodes),
        first_episode=first_episode,
        segment=segment,
        parts=parts,
        words=list_changed_words(protocol),
        language=protocol.study.language,
        bonus=protocol.bonus,
        fonts=protocol.study.fonts,
        files=trials.find_files(protocol),
    )


def _is_block(protocol: Protocol, name: str) -> bool:
    return any(block.name == name for block in protocol.blocks)


def _find_draw(protocol: Protocol, block: BlockSpec, blocks: list[BlockSpec], number: int) -> int:
    """Which draw is the block's: its place in its group, or in the file where its place in the session varies."""
    if not protocol.lists_parts:
        return number
    return next(place for place, other in enumerate(protocol.blocks) if other.name == block.name)


def _draw_key_map(
    protocol: Protocol, block: BlockSpec, row: tuple[int, ...], participant: Participant, session: int, number: int
) -> KeyMap:
    pool = protocol.keys.pool
    if session > 1:  # the balanced list is for first sessions; later ones draw on their own
        row = draw_permutation(
            len(pool), seed=protocol.study.seed, purpose=f"key-map-{number}-session-{session}", index=participant.index
        )
    return _map_row_to_keys(protocol, block, row, participant, session, number)


def _map_row_to_keys(
    protocol: Protocol, block: BlockSpec, row: tuple[int, ...], participant: Participant, session: int, number: int
) -> KeyMap:
    pool = protocol.keys.pool
    keys = {pool[place]: action for place, action in zip(row, block.actions, strict=False)}
    return _deal_spare_keys(protocol, block, keys, participant, session, number)


def _carry_key_map(
    protocol: Protocol,
    before: BlockSpec,
    block: BlockSpec,
    key_map: KeyMap,
    participant: Participant,
    session: int,
    number: int,
) -> KeyMap:
    """The same keys, action for action by position in the two blocks' lists."""
    if len(before.actions) != len(block.actions):  # only in a log: a new protocol is refused
        counts = f"{len(block.actions)} actions for a key map with {len(before.actions)}"
        raise ProtocolError(f"block {block.name!r} has {counts}; give the block its own key map")
    renamed = dict(zip(before.actions, block.actions, strict=True))
    keys = {key: renamed[action] for key, action in key_map.keys.items() if action in renamed}
    return _deal_spare_keys(protocol, block, keys, participant, session, number)


def _deal_spare_keys(
    protocol: Protocol, block: BlockSpec, keys: dict[str, str], participant: Participant, session: int, number: int
) -> KeyMap:
    """Add what spare keys do: distractors in turn over the spare keys, in random order."""
    seed = protocol.study.seed
    spare = tuple(key for key in protocol.keys.pool if key not in keys)
    purpose = f"distractors-{number}-session-{session}"
    if block.distractors:
        order = draw_permutation(len(spare), seed=seed, purpose=purpose, index=participant.index)
        dealt = {spare[place]: block.distractors[turn % len(block.distractors)] for turn, place in enumerate(order)}
        keys, spare = {**keys, **dealt}, ()
    return KeyMap(keys=keys, spare_keys=spare, spare=protocol.keys.spare_keys, seed=seed)


def _plan_episodes(
    protocol: Protocol,
    block: BlockSpec,
    number: int,
    drawn: int,
    key_map: KeyMap,
    participant: Participant,
    session: int,
    first: int,
) -> list[EpisodePlan]:
    options = trials.plan_options(protocol, block, f"{block.name}-session-{session}", participant.index)
    return [
        EpisodePlan(
            episode=first + place,
            block=number,
            block_name=block.name,
            episode_in_block=place,
            episodes_in_block=block.episodes,
            world=block.world,
            options=list_world_options(block) | options[place],
            seed=layout,
            actions=block.actions,
            key_map=key_map,
            show_keys=block.key_map == "shown" or block.show_keys,
            pace=block.pace,
            step_period_ms=block.step_period_ms,
            noop=block.noop_action,
            auto_repeat=block.auto_repeat,
            max_steps=block.max_steps,
            view=block.view,
            palette=block.palette,
            record_observations=block.record_observations,
            onset_at_reset=block.stimulus_onset == "reset",
            hold=block.hold,
            response_deadline_ms=block.response_deadline_ms,
        )
        for place, layout in enumerate(_draw_layout_seeds(protocol, block, drawn, participant, session))
    ]


def _draw_layout_seeds(
    protocol: Protocol, block: BlockSpec, number: int, participant: Participant, session: int
) -> tuple[int, ...]:
    """The seed of each episode's layout."""
    if isinstance(block.seeds, tuple):
        return block.seeds
    purpose = f"layouts-{number}-{block.name}-session-{session}"
    drawn = draw_seeds(block.episodes, seed=protocol.study.seed, purpose=purpose, index=participant.index)
    return drawn if block.seeds == "new" else drawn[:1] * block.episodes
