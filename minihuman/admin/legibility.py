"""Check that a plan can be read: a font has every character, and every text fits on its screen."""

from collections.abc import Iterator
from typing import Any

import msgspec

from minihuman.activities.pages.plan import PagePlan
from minihuman.activities.play.plan import PlayPlan
from minihuman.activities.questions.plan import QuestionsPlan
from minihuman.activities.questions.question import QuestionItemSpec, build_draft
from minihuman.activities.questions.screens import build_question_screen, build_wrong_answer_screen
from minihuman.display.drawing.questions import question_fits
from minihuman.display.drawing.text_screens import text_fits
from minihuman.display.shaping import measure_width_px
from minihuman.display.typefaces import TypefaceSet, find_installed_typeface, select_typefaces, user_font_folder
from minihuman.errors import ProtocolError
from minihuman.experiment.machine.screens import TextScreen
from minihuman.experiment.plan.allocation import AllocationSlot, build_allocation_list
from minihuman.experiment.plan.expansion import assign_slot, expand_protocol
from minihuman.experiment.plan.participant_codes import format_participant_code
from minihuman.experiment.plan.session_plan import Participant, PlannedPart, SessionPlan
from minihuman.experiment.protocol.protocol import Protocol
from minihuman.experiment.words import ENGLISH, LANGUAGES, InterfaceWords, load_words
from minihuman.worlds.adapters.world import World

NARROWEST_SCREEN_PX = (1024, 768)  # the narrowest screen that a study is likely to meet
_MEASURED_HEIGHT_PX = 1000  # height of the screen for which titles are measured
_SMALLEST_TYPE_PX = 25  # size of the smallest type on that screen
_LONGEST_TITLE = 1.25  # as a multiple of the screen's height


def require_legible(protocol: Protocol, source: str) -> None:
    """Check that participants can read every text of a protocol; ``source`` names the file in the errors.

    Raises:
        ProtocolError: with everything that is illegible in any session of any group.
    """
    # groups and sessions share texts, so that a problem can be found several times
    if problems := list(dict.fromkeys(find_illegible_in_study(protocol))):
        raise ProtocolError.of([f"{source}: {problem}" for problem in problems], source)


def find_illegible_in_study(protocol: Protocol) -> Iterator[str]:
    """Yield a message for each text that cannot be read on the screen, in any session of any group.

    A text that several groups or sessions share can be reported several times.
    """
    first_slots: dict[str, AllocationSlot] = {}
    for slot in build_allocation_list(protocol):
        first_slots.setdefault(slot.group, slot)
    n_sessions = max(1, len(protocol.sessions))
    for slot in first_slots.values():
        participant = assign_slot(protocol, Participant(format_participant_code(slot.index), slot.index, ""), slot)
        for session in range(1, n_sessions + 1):
            yield from find_illegible_in_plan(expand_protocol(protocol, participant, session=session))


def find_illegible_in_plan(plan: SessionPlan) -> Iterator[str]:
    """Yield a message for each text of a session that cannot be read on the screen; each message says how to fix it."""
    words = InterfaceWords(plan.language, plan.words, plan.fonts)
    faces = select_typefaces(plan.language, fonts=plan.fonts)
    for name in plan.fonts:
        if find_installed_typeface(name) is None:
            yield f"$.study.fonts names {name!r}, a face that is not installed here; install it, or leave it out"
    yield from _find_missing_characters(plan, faces)
    for part in plan.parts:
        yield from _find_long_texts(part, words, faces)
    yield from _find_untranslated_missions(plan, words)


def _find_missing_characters(plan: SessionPlan, faces: TypefaceSet) -> Iterator[str]:
    """Yield at most one message: the first text with a character that no font has, and the number of such texts.

    Args:
        plan: the session's plan.
        faces: the fonts that set the plan's texts.
    """
    missing_by_field = [(field, faces.missing(text)) for field, text in _list_texts(plan)]
    undrawable = [(field, character) for field, character in missing_by_field if character]
    if undrawable:
        field, character = undrawable[0]
        more = ""
        if len(undrawable) > 1:
            more = f" (and {len(undrawable) - 1} more texts have such characters)"
        yield f"{field}: {describe_missing_face(character, more)} or use another character"


def describe_missing_face(character: str, more: str = "") -> str:
    """Explain that no font has a character, and how to install one that does.

    Args:
        character: the character.
        more: a text that follows the character in the message, such as the number of further texts; "" for none.
    """
    return (
        f"no face on this machine can set {character!r} (U+{ord(character):04X}){more}; install a Noto font that can "
        f"(Debian: fonts-noto-core, fonts-noto-cjk; or put its file, such as NotoSansSC-Regular.otf for Chinese, into "
        f"{user_font_folder()})"
    )


def list_undrawable_languages() -> dict[str, str]:
    """Return the shipped languages whose interface texts cannot be drawn here, each with a missing character."""
    missing_characters = {}
    for language in LANGUAGES:
        texts = "".join(load_words(language).values())
        character = select_typefaces(language).missing(texts)
        if character:
            missing_characters[language] = character
    return missing_characters


def _list_texts(plan: SessionPlan) -> Iterator[tuple[str, str]]:
    """Yield the name of the field and the text for every text of a session's plan."""
    for key, word in plan.words.items():
        yield f"word {key}", word
    for part in plan.parts:
        for field, text in _walk_strings(msgspec.to_builtins(part.plan, builtin_types=(bytes,))):
            yield f"{part.name}, {field}", text


def _walk_strings(node: Any, field: str = "") -> Iterator[tuple[str, str]]:
    """Yield the path and the text of every string inside a value of JSON's types.

    Args:
        node: the value.
        field: the path of the value, with which all paths begin.
    """
    match node:
        case str():
            yield field, node
        case dict():
            for key, child in node.items():
                path = f"{field}.{key}" if field else str(key)
                yield from _walk_strings(child, path)
        case list() | tuple():
            for number, child in enumerate(node, 1):
                yield from _walk_strings(child, f"{field} {number}")


def _find_long_texts(part: PlannedPart, words: InterfaceWords, faces: TypefaceSet) -> Iterator[str]:
    """Yield a message for each text of a part that does not fit its screen, and each title longer than a line.

    Args:
        part: the part of the session.
        words: the interface's texts in the study's language.
        faces: the fonts that set the titles.
    """
    match part.plan:
        case PlayPlan() as play:
            yield from _find_long_play_texts(part.name, play, words)
        case QuestionsPlan() as questions:
            yield from _find_long_questions(part.name, questions, words)
    if isinstance(part.plan, PagePlan | QuestionsPlan | PlayPlan):
        title = part.plan.title
        width = measure_width_px(title, faces, _SMALLEST_TYPE_PX) / _MEASURED_HEIGHT_PX
        if width > _LONGEST_TITLE:
            yield f"{part.name}, title: is too long for one line: {title[:40]!r}; shorten it"


def _find_long_play_texts(part: str, play: PlayPlan, words: InterfaceWords) -> Iterator[str]:
    """Yield a message for each text between a part's episodes that does not fit its screen."""
    for outcome, text in play.feedback.items():
        feedback_screen = TextScreen("", text, "", locale=words.locale)
        if not text_fits(feedback_screen, NARROWEST_SCREEN_PX):
            yield f"{part}, feedback for {outcome}: {_describe_long_text(text)}"
    rest_screen = TextScreen(words["rest.title"], play.rest, "", locale=words.locale)
    if not text_fits(rest_screen, NARROWEST_SCREEN_PX):
        yield f"{part}, rest: {_describe_long_text(play.rest)}"


def _find_long_questions(part: str, questions: QuestionsPlan, words: InterfaceWords) -> Iterator[str]:
    """Yield a message for each of a part's questions, and its text for wrong answers, that does not fit its screen."""
    if not text_fits(build_wrong_answer_screen(words, questions.wrong), NARROWEST_SCREEN_PX):
        yield f"{part}, wrong: {_describe_long_text(questions.wrong)}"
    for question in questions.items:
        draft = build_draft(question, rtl=words.rtl)
        screen: Any = build_question_screen(words, title="", draft=draft, number=0, count=1, note="")
        if not question_fits(screen, NARROWEST_SCREEN_PX):
            yield f"{part}, question {question.name!r}: {_describe_long_question(question)}"


def _describe_long_text(text: str) -> str:
    return f"does not fit a screen in type of 1/40 of its height: {text[:40]!r}...; shorten it, or give it a page"


def _describe_long_question(question: QuestionItemSpec) -> str:
    """Say which of a question's texts are too long for one screen."""
    if not isinstance(question.statements, dict):
        return _describe_long_text(question.ask)
    count = len(question.statements)
    return (
        f"does not fit a screen in type of 1/40 of its height, with its {count} statements and its points; "
        "shorten them, or divide the statements between two questions"
    )


def _find_untranslated_missions(plan: SessionPlan, words: InterfaceWords) -> Iterator[str]:
    """Yield a message for each block whose world states its task in English, without words in the study's language."""
    if plan.language == ENGLISH:
        return
    for part in plan.parts:
        if not isinstance(part.plan, PlayPlan) or part.plan.mission:
            continue
        first_episode = plan.episodes[part.plan.first]
        world = World(first_episode.world, first_episode.options)
        mission = world.reset(first_episode.seed).mission
        world.close()
        if mission and not words.mission(mission):
            yield (
                f"{part.name}: the world says {mission!r}, for which there are no words in {plan.language!r}, so "
                'nothing is shown; give the block a mission = "..." or the words under [words.mission]'
            )
