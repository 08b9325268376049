"""Whether a plan can be read: every character has a face on this machine, and every text fits its screen."""

from collections.abc import Iterator
from typing import Any

import msgspec

from minihuman.errors import ProtocolError
from minihuman.study import texts
from minihuman.study.activities.drafts import Question, draft_of
from minihuman.study.activities.pages import PagePlan
from minihuman.study.activities.play_plan import PlayPlan
from minihuman.study.activities.questions import QuestionsPlan
from minihuman.study.allocation import allocation
from minihuman.study.expand import expand, participant_code, placed
from minihuman.study.plan import Part, Participant, SessionPlan
from minihuman.study.protocol import Protocol
from minihuman.study.screens import TextScreen
from minihuman.study.words import ENGLISH, Words
from minihuman.typeset.faces import Faces, faces_for, installed
from minihuman.typeset.line import width_px
from minihuman.windows.draw_question import fits as question_fits
from minihuman.windows.draw_text import fits as text_fits
from minihuman.worlds.adapt.world import World

SIZE_PX = (1024, 768)  # the narrowest screen that a study is likely to meet
_LONGEST_TITLE = 1.25  # of the height


def refuse_unreadable(protocol: Protocol, source: str) -> None:
    """Let nobody sit down before what they could not read; ``source`` names the file.

    Raises:
        ProtocolError: with everything that cannot be read in any session of any group.
    """
    if problems := list(dict.fromkeys(study_unreadable(protocol))):
        raise ProtocolError.of([f"{source}: {problem}" for problem in problems], source)


def study_unreadable(protocol: Protocol) -> Iterator[str]:
    """What cannot be read in any session of any group."""
    first = {slot.group: slot for slot in reversed(allocation(protocol))}
    for slot in sorted(first.values(), key=lambda slot: slot.index):
        who = placed(protocol, Participant(participant_code(slot.index), slot.index, ""), slot)
        for session in range(1, max(1, len(protocol.sessions)) + 1):
            yield from unreadable(expand(protocol, who, session=session))


def unreadable(plan: SessionPlan) -> Iterator[str]:
    """What cannot be read of a session, and the way out, one sentence each."""
    words, faces = Words(plan.language, plan.words, plan.fonts), faces_for(plan.language, fonts=plan.fonts)
    for name in plan.fonts:
        if installed(name) is None:
            yield f"$.study.fonts names {name!r}, a face that is not installed here; install it, or leave it out"
    yield from _faceless(plan, faces)
    for part in plan.parts:
        yield from _too_long(part, words, faces)
    yield from _speechless(plan, words)


def _faceless(plan: SessionPlan, faces: Faces) -> Iterator[str]:
    """The first text with a character that no face has, and how many more there are: one font helps all of a script."""
    found = [(where, missing) for where, text in _texts(plan) if (missing := faces.missing(text))]
    if found:
        where, missing = found[0]
        more = f" (and {len(found) - 1} more texts have such characters)" if len(found) > 1 else ""
        yield (
            f"{where}: no face on this machine has {missing!r} (U+{ord(missing):04X}){more}; install a Noto font that "
            "has it (Debian: fonts-noto-core, fonts-noto-cjk) or use another character"
        )


def _texts(plan: SessionPlan) -> Iterator[tuple[str, str]]:
    for key, word in plan.words.items():
        yield f"word {key}", word
    for part in plan.parts:
        for field, text in _strings(msgspec.to_builtins(part.plan, builtin_types=(bytes,))):
            yield f"{part.name}, {field}", text


def _strings(value: Any, field: str = "") -> Iterator[tuple[str, str]]:
    match value:
        case str():
            yield field, value
        case dict():
            for key, inner in value.items():
                yield from _strings(inner, f"{field}.{key}" if field else str(key))
        case list() | tuple():
            for number, inner in enumerate(value, 1):
                yield from _strings(inner, f"{field} {number}")


def _too_long(part: Part, words: Words, faces: Faces) -> Iterator[str]:
    match part.plan:
        case PlayPlan() as play:
            for outcome, text in play.feedback.items():
                if not text_fits(TextScreen("", text, "", script=words.script), SIZE_PX):
                    yield f"{part.name}, feedback for {outcome}: {_does_not_fit(text)}"
            if not text_fits(TextScreen(words["rest.title"], play.rest, "", script=words.script), SIZE_PX):
                yield f"{part.name}, rest: {_does_not_fit(play.rest)}"
        case QuestionsPlan() as asked:
            if not text_fits(texts.wrong(words, asked.wrong), SIZE_PX):
                yield f"{part.name}, wrong: {_does_not_fit(asked.wrong)}"
            for item in asked.items:
                if not question_fits(_empty(item, words), SIZE_PX):
                    yield f"{part.name}, question {item.name!r}: {_does_not_fit(item.ask)}"
    for title in _titles(part):
        if _width(title, faces) > _LONGEST_TITLE:
            yield f"{part.name}, title: is too long for one line: {title[:40]!r}; shorten it"


def _does_not_fit(text: str) -> str:
    return f"does not fit a screen in type of 1/40 of its height: {text[:40]!r}...; shorten it, or give it a page"


def _titles(part: Part) -> Iterator[str]:
    if isinstance(part.plan, PagePlan | QuestionsPlan | PlayPlan):
        yield part.plan.title


def _width(title: str, faces: Faces) -> float:
    """How long a title is in the smallest type it may be set in, as a share of the height."""
    return width_px(title, faces, 25) / 1000


def _empty(item: Question, words: Words) -> Any:
    draft = draft_of(item, rtl=words.rtl)
    return texts.question(words, title="", asked=item, item=draft.item(), number=0, count=1, note="")


def _speechless(plan: SessionPlan, words: Words) -> Iterator[str]:
    """Blocks whose world says in English what is to be done, in a study in another language."""
    if plan.language == ENGLISH:
        return
    for part in plan.parts:
        if not isinstance(part.plan, PlayPlan) or part.plan.mission:
            continue
        first = plan.episodes[part.plan.first]
        world = World(first.world, first.options)
        said = world.reset(first.seed).mission
        world.close()
        if said and not words.mission(said):
            yield (
                f"{part.name}: the world says {said!r}, for which there are no words in {plan.language!r}, so nothing "
                'is shown; give the block a mission = "..." or the words under [words.mission]'
            )
