"""Expansion: protocol and participant in, the full list of episodes out. Pure; the same on every machine."""

import hashlib
import re

import msgspec

from minihuman.errors import AllocationError, ProtocolError
from minihuman.study.activities.pages import PagePlan
from minihuman.study.allocation import Slot, allocation, allocation_sha256, slot_of
from minihuman.study.chance import permutation, seeds
from minihuman.study.plan import BlockText, EpisodePlan, KeyMap, Participant, SessionPlan
from minihuman.study.planned import consent_text, own_words, planned_parts, words_of
from minihuman.study.protocol import Block, Protocol
from minihuman.study.resolve import KEYBOARD, part_names

_CODE = re.compile(r"sub-(?P<number>\d{2,6})")
MOST_SLOTS = 100_000  # of an allocation list; codes from there on are of those who take a slot over


def participant_index(code: str) -> int:
    """The slot that a participant's code says: 6 for "sub-07", and for "sub-100007", who took the slot over.

    Raises:
        AllocationError: if it is no such code.
    """
    match = _CODE.fullmatch(code)
    if match is None or int(match["number"]) == 0:
        raise AllocationError(f"participant {code!r} is no code; use 'sub-' and a number from 01, never a name")
    return (int(match["number"]) - 1) % MOST_SLOTS


def participant_code(index: int, before: int = 0) -> str:
    """The code of whoever has a slot: "sub-07" for 6, "sub-100007" for the next after one who left it."""
    return f"sub-{before * MOST_SLOTS + index + 1:02d}"


def enrol(protocol: Protocol, index: int, group: str | None = None, *, stratum: str | None = None) -> Participant:
    """The participant at a place of the allocation list; ``group`` overrides the list's.

    Where groups are drawn after an answer it is a place of a stratum's list, the first stratum's where none is given.

    Raises:
        AllocationError: if the list is not that long, or there is no such stratum.
        ProtocolError: if there is no such group.
    """
    slot = slot_of(protocol, index, stratum)
    return placed(protocol, Participant(participant_code(index), index, group or ""), slot)


def placed(protocol: Protocol, who: Participant, slot: Slot) -> Participant:
    """A participant in a slot, in its group unless they are in one already.

    Raises:
        ProtocolError: if there is no such group.
    """
    group = protocol.group(who.group or slot.group).name
    own = slot.index if slot.stratum else None
    return msgspec.structs.replace(who, group=group, stratum=slot.stratum, slot=own)


def expand(
    protocol: Protocol,
    participant: Participant,
    *,
    session: int = 1,
    overridden: bool = False,
    first_episode: int = 0,
    segment: int = 1,
) -> SessionPlan:
    """Everything the session will ask for, before the first key press.

    ``overridden`` says that participant or group was chosen by hand; ``first_episode`` and ``segment`` say where a
    resumed session goes on, and change nothing else. For somebody whose group is not drawn yet the plan is right up to
    the draw, and some group's from there on.
    """
    slots = allocation(protocol)
    slot = slots[participant.place if participant.group else 0]
    drawn, participant = participant, placed(protocol, participant, slot)
    names = part_names(protocol, slot, participant.group, session)
    blocks = [protocol.block_for(name, participant.group) for name in names if _is_block(protocol, name)]
    episodes: list[EpisodePlan] = []
    key_map: KeyMap | None = None
    for number, block in enumerate(blocks):
        place = _place(protocol, block, blocks, number)
        if block.key_map == "fixed":
            key_map = _deal(protocol, block, dict(block.fixed), participant, session, place)
        elif block.key_map == "kept":
            key_map = _on_keys(protocol, block, slot.kept, participant, session, place)
        elif key_map is None or block.key_map != "carry":
            key_map = _draw(protocol, block, slot.positions[place], participant, session, place)
        else:
            key_map = _carry(protocol, blocks[number - 1], block, key_map, participant, session, place)
        episodes += _episodes(protocol, block, number, place, key_map, participant, session, len(episodes))
    words = words_of(protocol)
    texts = tuple(
        BlockText(b.instruction, b.feedback if isinstance(b.feedback, str) else "", b.rest, protocol.study.break_s)
        for b in blocks
    )
    parts = tuple(planned_parts(protocol, participant, session, names, blocks, episodes))
    agreed = [part.plan for part in parts if isinstance(part.plan, PagePlan) and part.plan.agree]
    consent = consent_text(protocol, participant.group, names)
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
        words=own_words(protocol),
        language=protocol.study.language,
        bonus=protocol.bonus,
        fonts=protocol.study.fonts,
    )


def _is_block(protocol: Protocol, name: str) -> bool:
    return any(block.name == name for block in protocol.blocks)


def _place(protocol: Protocol, block: Block, blocks: list[Block], number: int) -> int:
    """Which draw is the block's: its place in its group, or in the file where its place in the session varies."""
    if not protocol.designed:
        return number
    return next(place for place, other in enumerate(protocol.blocks) if other.name == block.name)


def _draw(
    protocol: Protocol, block: Block, row: tuple[int, ...], participant: Participant, session: int, number: int
) -> KeyMap:
    pool = protocol.keys.pool
    if session > 1:  # the balanced list is for first sessions; later ones draw on their own
        row = permutation(
            len(pool), seed=protocol.study.seed, purpose=f"key-map-{number}-session-{session}", index=participant.index
        )
    return _on_keys(protocol, block, row, participant, session, number)


def _on_keys(
    protocol: Protocol, block: Block, row: tuple[int, ...], participant: Participant, session: int, number: int
) -> KeyMap:
    pool = protocol.keys.pool
    keys = {pool[place]: action for place, action in zip(row, block.actions, strict=False)}
    return _deal(protocol, block, keys, participant, session, number)


def _carry(
    protocol: Protocol,
    before: Block,
    block: Block,
    key_map: KeyMap,
    participant: Participant,
    session: int,
    number: int,
) -> KeyMap:
    """The same keys, action for action by position in the two blocks' lists."""
    if len(before.actions) != len(block.actions):  # only in a log: a new protocol is refused
        counts = f"{len(before.actions)} actions carried to {len(block.actions)}"
        raise ProtocolError(f"block {block.name!r} has {counts}; give it a key map of its own")
    renamed = dict(zip(before.actions, block.actions, strict=True))
    keys = {key: renamed[action] for key, action in key_map.keys.items() if action in renamed}
    return _deal(protocol, block, keys, participant, session, number)


def _deal(
    protocol: Protocol, block: Block, keys: dict[str, str], participant: Participant, session: int, number: int
) -> KeyMap:
    """Add what spare keys do: distractors in turn over the spare keys, in random order."""
    seed = protocol.study.seed
    spare = tuple(key for key in protocol.keys.pool if key not in keys)
    purpose = f"distractors-{number}-session-{session}"
    if block.distractors:
        order = permutation(len(spare), seed=seed, purpose=purpose, index=participant.index)
        dealt = {spare[place]: block.distractors[turn % len(block.distractors)] for turn, place in enumerate(order)}
        keys, spare = {**keys, **dealt}, ()
    return KeyMap(keys=keys, spare_keys=spare, spare=protocol.keys.spare, seed=seed)


def _episodes(
    protocol: Protocol,
    block: Block,
    number: int,
    drawn: int,
    key_map: KeyMap,
    participant: Participant,
    session: int,
    first: int,
) -> list[EpisodePlan]:
    return [
        EpisodePlan(
            episode=first + place,
            block=number,
            block_name=block.name,
            episode_in_block=place,
            episodes_in_block=block.episodes,
            world=block.world,
            options=dict(block.options),
            seed=layout,
            actions=block.actions,
            key_map=key_map,
            show_keys=block.key_map == "shown" or block.show_keys,
            pace=block.pace,
            step_period_ms=block.step_period_ms,
            noop=block.noop,
            auto_repeat=block.auto_repeat,
            max_steps=block.max_steps,
            view=block.view,
            palette=block.palette,
            record_observations=block.record_observations,
        )
        for place, layout in enumerate(_layouts(protocol, block, drawn, participant, session))
    ]


def _layouts(protocol: Protocol, block: Block, number: int, participant: Participant, session: int) -> tuple[int, ...]:
    """The seed of each episode's layout."""
    if isinstance(block.seeds, tuple):
        return block.seeds
    purpose = f"layouts-{number}-{block.name}-session-{session}"
    drawn = seeds(block.episodes, seed=protocol.study.seed, purpose=purpose, index=participant.index)
    return drawn if block.seeds == "new" else drawn[:1] * block.episodes
