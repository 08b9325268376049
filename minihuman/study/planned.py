"""The parts of a session as plans: every text in pages, every name a place, no chance left."""

import hashlib
from collections.abc import Iterator, Sequence

from minihuman.errors import ProtocolError
from minihuman.study.activities.keyboard import KeyboardPlan
from minihuman.study.activities.pages import PagePlan
from minihuman.study.activities.play_plan import PlayPlan
from minihuman.study.activities.port import Kind
from minihuman.study.activities.questions import QuestionsPlan
from minihuman.study.activities.registry import kind_of
from minihuman.study.chance import permutation
from minihuman.study.design import Questionnaire, Text
from minihuman.study.forms import form
from minihuman.study.plan import EpisodePlan, Part, Participant
from minihuman.study.protocol import Block, Protocol
from minihuman.study.resolve import CLOSING, CONSENT, KEYBOARD
from minihuman.study.words import ENGLISH, LANGUAGES, Words, flat, of
from minihuman.typeset.faces import Faces, faces_for
from minihuman.typeset.pages import pages

OUTCOMES = ("goal", "timeout", "failure", "abandoned")


def own_words(protocol: Protocol) -> dict[str, str]:
    """The interface's words of a study, as far as they are not English's: none for most English studies."""
    language, instead = protocol.study.language, flat(protocol.words)
    return instead if language == ENGLISH or language not in LANGUAGES else {**of(language), **instead}


def words_of(protocol: Protocol) -> Words:
    """The interface's words of a study."""
    return Words(protocol.study.language, own_words(protocol), protocol.study.fonts)


def faces_of(protocol: Protocol) -> Faces:
    """The faces that a study's texts are set in."""
    return faces_for(protocol.study.language, fonts=protocol.study.fonts)


def consent_text(protocol: Protocol, group: str, names: Sequence[str]) -> str:
    """The text that is agreed to in a session with these parts."""
    texts = (protocol.page_for(name, group) for name in names)
    agreed = next((page.text for page in texts if page and page.agree), None)
    return protocol.study.consent if agreed is None else agreed


def planned_parts(
    protocol: Protocol,
    participant: Participant,
    session: int,
    names: Sequence[str],
    blocks: Sequence[Block],
    episodes: Sequence[EpisodePlan],
) -> Iterator[Part]:
    """A plan for each part of a session, in order."""
    words, faces, group = words_of(protocol), faces_of(protocol), participant.group
    number = 0
    for name in names:
        page, asked = protocol.page_for(name, group), protocol.questions_for(name, group)
        if page is not None:
            yield Part("page", name, _page(protocol, page, words, faces))
        elif asked is not None:
            yield Part("questions", name, _questions(protocol, participant, session, asked, names))
        elif any(block.name == name for block in protocol.blocks):
            kind = kind_of(blocks[number].kind)
            yield Part(kind.name, name, _block(kind, protocol, blocks, number, episodes, words, faces))
            number += 1
        elif (other := next((other for other in protocol.activities if other.name == name), None)) is not None:
            yield Part(other.kind, name, kind_of(other.kind).read(other.plan))
        elif name == KEYBOARD:
            yield Part("keyboard_check", name, KeyboardPlan(protocol.keys.pool))
        else:
            yield Part("page", name, _page(protocol, _frame(protocol, name, words), words, faces))


def _frame(protocol: Protocol, name: str, words: Words) -> Text:
    """The consent or the last words of ``[study]``."""
    study = protocol.study
    if name == CONSENT:
        return Text(CONSENT, study.consent, words["consent.title"], agree=True)
    assert name == CLOSING
    return Text(CLOSING, words["closing.text"] if study.closing is None else study.closing, closing=True)


def _page(protocol: Protocol, page: Text, words: Words, faces: Faces) -> PagePlan:
    title = page.title
    if not title and (page.agree or page.closing):
        title = words["consent.title" if page.agree else "closing.title"]
    missing = [name for name in page.pictures if name not in protocol.files]
    if missing:
        raise ProtocolError(f"page {page.name!r} has the picture {missing[0]!r}, which is not beside the protocol")
    pictures = len(page.pictures) or bool(page.example)
    return PagePlan(
        title=title,
        pages=pages(page.text, faces, pictures=pictures),
        agree=page.agree,
        sha256=hashlib.sha256(page.text.encode()).hexdigest() if page.agree else "",
        closing=page.closing,
        pictures=tuple(protocol.files[name] for name in page.pictures),
        example=page.example,
    )


def _questions(
    protocol: Protocol, participant: Participant, session: int, asked: Questionnaire, names: Sequence[str]
) -> QuestionsPlan:
    title, items = asked.title, asked.items
    if asked.form:
        shipped = form(asked.form, protocol.study.language)
        title, items = title or shipped.title, shipped.items
    if asked.shuffle:
        purpose = f"items-{asked.name}-session-{session}"
        order = permutation(len(items), seed=protocol.study.seed, purpose=purpose, index=participant.index)
        items = tuple(items[place] for place in order)
    back_to = protocol.group(participant.group).instead.get(asked.back_to, asked.back_to)
    if back_to and back_to not in names:
        raise ProtocolError(f"questions {asked.name!r} lead back to {back_to!r}, which session {session} lacks")
    return QuestionsPlan(
        title=title,
        items=items,
        tries=asked.tries,
        wrong=asked.wrong,
        back_to=names.index(back_to) if back_to else None,
        failed=asked.failed,
    )


def _block(
    kind: Kind,
    protocol: Protocol,
    blocks: Sequence[Block],
    number: int,
    episodes: Sequence[EpisodePlan],
    words: Words,
    faces: Faces,
) -> PlayPlan:
    """A block's plan as its kind has it."""
    play = _play(protocol, blocks, number, episodes, words, faces)
    if kind.plan is PlayPlan:
        return play
    fields = {name: getattr(play, name) for name in play.__struct_fields__}
    if blocks[number].agent is not None:
        fields["agent"] = blocks[number].agent
    made = kind.plan(**fields)
    assert isinstance(made, PlayPlan)  # the protocol's check has seen to it
    return made


def _play(
    protocol: Protocol,
    blocks: Sequence[Block],
    number: int,
    episodes: Sequence[EpisodePlan],
    words: Words,
    faces: Faces,
) -> PlayPlan:
    block, count = blocks[number], len(blocks)
    its = [episode for episode in episodes if episode.block == number]
    last = number + 1 == count
    title = words.fill("progress.part", part=number + 1, parts=count) if count > 1 else ""
    feedback = dict.fromkeys(OUTCOMES, block.feedback) if isinstance(block.feedback, str) else dict(block.feedback)
    return PlayPlan(
        block=number,
        blocks=count,
        first=its[0].episode,
        count=len(its),
        title=block.title or title,
        instruction=pages(block.instruction, faces) if block.instruction else (),
        feedback={outcome: text for outcome, text in feedback.items() if text},
        rest="" if last else block.rest,
        rest_s=0.0 if last else protocol.study.break_s,
        interval_ms=block.interval_ms,
        fixation_ms=block.fixation_ms,
        hold_ms=block.hold_ms,
        marks=block.marks,
        max_s=block.max_s,
        block_max_s=block.block_max_s,
        until=block.until,
        points=block.points,
        show_points=block.show_points,
        mission=block.mission,
    )
