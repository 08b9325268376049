"""The parts of a session: of a plan that lists them, or of one from before there were any."""

from collections.abc import Sequence

from minihuman.study.activities.keyboard import KeyboardPlan
from minihuman.study.activities.pages import PagePlan
from minihuman.study.activities.play_plan import PlayPlan
from minihuman.study.plan import Part, SessionPlan
from minihuman.study.words import Words

OUTCOMES = ("goal", "timeout", "failure", "abandoned")


def parts_of(plan: SessionPlan) -> tuple[Part, ...]:
    """The parts in order; those that a plan without any means: consent, keyboard check, block after block, closing."""
    if plan.parts:
        return plan.parts
    words = Words(plan.language, plan.words, plan.fonts)
    parts: list[Part] = []
    if plan.consent_text and plan.segment == 1:
        text = plan.consent_text.strip()
        page = PagePlan(words["consent.title"], (text,), agree=True, sha256=plan.consent_sha256)
        parts.append(Part("page", "consent", page))
    if plan.keyboard_check:
        parts.append(Part("keyboard_check", "keyboard_check", KeyboardPlan(plan.key_pool)))
    parts += _blocks(plan, words)
    if plan.closing_text:
        page = PagePlan(words["closing.title"], (plan.closing_text.strip(),), closing=True)
        parts.append(Part("page", "closing", page))
    return tuple(parts)


def _blocks(plan: SessionPlan, words: Words) -> list[Part]:
    count = len(plan.texts)
    parts = []
    for number, text in enumerate(plan.texts):
        its = [episode for episode in plan.episodes if episode.block == number]
        last = number + 1 == count
        play = PlayPlan(
            block=number,
            blocks=count,
            first=its[0].episode,
            count=len(its),
            title="" if count < 2 else words.fill("progress.part", part=number + 1, parts=count),
            instruction=(text.instruction.strip(),) if text.instruction else (),
            feedback=dict.fromkeys(OUTCOMES, text.feedback) if text.feedback else {},
            rest="" if last else text.rest,
            rest_s=0.0 if last else text.rest_s,
        )
        parts.append(Part("play", its[0].block_name, play))
    return parts


def first_part(plan: SessionPlan, parts: Sequence[Part]) -> list[int]:
    """Which parts are to be done, in order: all, or those from where a resumed session goes on; none if all is done.

    A resumed session begins with the keyboard check even so: it may be another station's keyboard.
    """
    left = [number for number in range(len(parts)) if not _done(number, parts[number], plan)]
    worth = [number for number in left if parts[number].kind != "keyboard_check"]
    only_closing = all(_is_closing(parts[number]) for number in worth)
    return [] if only_closing and not (worth and plan.standing.part) else left


def only_last_words(parts: Sequence[Part], begin: int) -> bool:
    """Whether from a part on there is nothing but last words to read."""
    return all(_is_closing(part) for part in parts[begin:])


def asks_for_consent_first(plan: SessionPlan) -> bool:
    """Whether a session asks for agreement before anything is played; one that goes on was agreed to before."""
    if plan.segment > 1:
        return False
    parts = parts_of(plan)
    for number in first_part(plan, parts):
        its = parts[number].plan
        if isinstance(its, PlayPlan):
            return False
        if isinstance(its, PagePlan) and its.agree:
            return True
    return False


def _done(number: int, part: Part, plan: SessionPlan) -> bool:
    if part.kind == "keyboard_check":
        return False
    if number < plan.standing.part:
        return True
    if isinstance(part.plan, PlayPlan):
        return plan.first_episode >= part.plan.first + part.plan.count
    return plan.first_episode > 0 and not plan.standing.part and isinstance(part.plan, PagePlan) and part.plan.agree


def _is_closing(part: Part) -> bool:
    return isinstance(part.plan, PagePlan) and part.plan.closing
