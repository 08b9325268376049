"""Text of every screen except the world's own: built from the interface's words, the plan and what just happened."""

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from minihuman.activities.play.plan import PlayPlan
from minihuman.activities.questions.question import AnswerDraft, find_question_kind
from minihuman.experiment.machine.events import EndReason, Outcome
from minihuman.experiment.machine.running_episode import RunningEpisode
from minihuman.experiment.machine.screens import (
    Button,
    OutcomeMark,
    PageScreen,
    PictureLabel,
    QuestionScreen,
    TextScreen,
)
from minihuman.experiment.machine.transitions import Phase
from minihuman.experiment.plan.session_plan import BonusSpec, EpisodePlan
from minihuman.experiment.words import InterfaceWords

if TYPE_CHECKING:
    from minihuman.experiment.machine.activity import SessionContext

ABORT_REASONS = (
    "the participant asked to stop",
    "the participant is unwell",
    "technical trouble",
    "wrong participant or protocol",
    "another reason",
)
OUTCOME_MARKS: dict[Outcome | None, OutcomeMark] = {"goal": "good", "timeout": "neutral", "failure": "bad"}
_SIGNED = re.compile(r"(?<!\w)[-+\u2212](?=\d)")
_FAILURES = ("disk_full", "world_error", "internal_error")


def build_page_screen(
    words: InterfaceWords,
    *,
    title: str,
    body: str,
    page: int,
    pages: int,
    last: str,
    button: str,
    picture: NDArray[np.uint8] | None = None,
    marks: tuple[PictureLabel, ...] = (),
    decline_label: str = "",
) -> PageScreen:
    """A page of a text; ``last`` is the last page's prompt, ``button`` what its button says.

    ``decline_label`` is the label of the button that declines; "" shows no such button.
    """
    at_end = page == pages - 1
    buttons: tuple[Button, ...] = (Button("back", words["button.back"]),) if page else ()
    buttons += (Button("decline", decline_label),) if decline_label else ()
    buttons += (Button("go_on", button if at_end else words["button.next"]),)
    progress = words.fill("page.progress", page=page + 1, pages=pages) if pages > 1 else ""
    prompt = last if at_end else words["page.prompt"]
    return PageScreen(title, body, page + 1, pages, prompt, buttons, progress, picture, marks, words.locale)


def build_question_screen(
    words: InterfaceWords,
    *,
    title: str,
    draft: AnswerDraft,
    number: int,
    count: int,
    note: str,
) -> QuestionScreen:
    """One question and its answer so far."""
    buttons: tuple[Button, ...] = (Button("back", words["button.back"]),) if number else ()
    buttons += (Button("go_on", words["button.go_on"]),)
    progress = words.fill("question.progress", number=number + 1, count=count) if count > 1 else ""
    question = draft.question
    prompt = words.find(f"prompt.{question.kind}", find_question_kind(question.kind).prompt)
    return QuestionScreen(title, question.ask, draft.widget(), prompt, buttons, progress, note, words.locale)


def build_wrong_answer_screen(words: InterfaceWords, text: str) -> TextScreen:
    """Some answers were wrong, and there is another try."""
    return TextScreen(words["wrong.title"], text.strip() or words["wrong.body"], words["go_on"], locale=words.locale)


def format_progress(context: "SessionContext", block: PlayPlan, episode: EpisodePlan, points: float | None) -> str:
    """Where in the session an episode is: "Part 1 of 2, episode 3 of 10", and the points so far."""
    words = context.words
    fields = {
        "part": block.block + 1,
        "parts": block.blocks,
        "episode": episode.episode_in_block + 1,
        "episodes": episode.episodes_in_block,
    }
    key = "progress.of_one" if block.blocks < 2 else "progress.of_many"
    if block.until is not None:
        key += "_open"  # the number of episodes is open
    line = words.fill(key, **fields)
    if points is None:
        return line
    return f"{line}    {format_total(words, points)}"


def format_total(words: InterfaceWords, points: float) -> str:
    """The points so far."""
    return _isolate_signs(words, words.fill("progress.points", points=format_points(points)))


def build_keyboard_check_screen(words: InterfaceWords, keys: Sequence[str], pressed: frozenset[str]) -> TextScreen:
    """Every key of the pool, and whether it has arrived yet."""
    left = len(set(keys)) - len(pressed)
    return TextScreen(
        words["keyboard_check.title"],
        words["keyboard_check.body"],
        words["keyboard_check.one_left"] if left == 1 else words.fill("keyboard_check.left", count=left),
        keys=tuple((key, key in pressed) for key in keys),
        locale=words.locale,
        labels=words.labels(tuple(keys)),
    )


def build_feedback_screen(
    words: InterfaceWords, block: PlayPlan, played: RunningEpisode, progress_line: str, points: float, total: float
) -> TextScreen:
    """The block's feedback for this outcome, its fields filled in."""
    outcome = played.outcome or "abandoned"
    body = block.feedback[outcome].format(
        outcome=words[f"outcome.{outcome}"],
        reward=played.return_,
        steps=played.steps,
        episode=played.plan.episode_in_block + 1,
        episodes=played.plan.episodes_in_block,
        points=PointsNumber(points),
        total=PointsNumber(total),
    )
    body = _isolate_signs(words, capitalise(body.strip()))
    prompt = "" if block.trial and block.trial.feedback_ms else words["go_on"]
    return TextScreen("", body, prompt, progress_line, locale=words.locale)


def build_notice_screen(words: InterfaceWords, title: str, body: str, prompt: str = "") -> TextScreen:
    """A few words, and what to press where that leads on."""
    return TextScreen(title, body, prompt, locale=words.locale)


def build_rest_screen(words: InterfaceWords, text: str, left_s: int) -> TextScreen:
    """The rest after a block, with the seconds that must still pass."""
    prompt = words["go_on"] if left_s <= 0 else words.fill("rest.wait", seconds=left_s)
    return TextScreen(words["rest.title"], text.strip() or words["rest.body"], prompt, locale=words.locale)


def build_pause_screen(words: InterfaceWords) -> TextScreen:
    """Play is suspended."""
    return TextScreen(words["paused.title"], words["paused.body"], words["go_on"], locale=words.locale)


def build_focus_lost_screen(words: InterfaceWords) -> TextScreen:
    """The keys go to another window."""
    return TextScreen(words["unfocused.title"], words["unfocused.body"], "", locale=words.locale)


def build_wait_screen(words: InterfaceWords) -> TextScreen:
    """Something takes a moment."""
    return TextScreen("", words["getting_ready"], "", locale=words.locale)


def build_quit_screen(words: InterfaceWords, *, declining: bool = False) -> TextScreen:
    """The question before Escape ends the session; ``declining`` if that refuses consent."""
    if declining:
        return TextScreen(words["consent.decline"], "", words["quit.prompt"], locale=words.locale)
    return TextScreen(words["quit.title"], words["quit.body"], words["quit.prompt"], locale=words.locale)


def build_abort_screen(words: InterfaceWords) -> TextScreen:
    """For the experimenter: why the session is to end."""
    reasons = (words[f"abort.reason_{number}"] for number in range(1, len(ABORT_REASONS) + 1))
    body = "\n".join(f"{number}  {reason}" for number, reason in enumerate(reasons, start=1))
    return TextScreen(words["abort.title"], body, words["abort.prompt"], locale=words.locale)


def find_abort_reason(key: str) -> str | None:
    """The reason a digit stands for, on the digit row or the keypad; None for any other key."""
    reasons = {str(number): reason for number, reason in enumerate(ABORT_REASONS, start=1)}
    return reasons.get(key.removeprefix("kp_"))


def build_end_screen(words: InterfaceWords, reason: EndReason, detail: str) -> TextScreen:
    """The session is over; a failure says what failed and that the data is kept."""
    if reason in _FAILURES:
        return TextScreen(words[f"over.{reason}"], f"{detail}\n\n{words['over.kept']}", "", locale=words.locale)
    if reason == "screened_out":
        return TextScreen(words["over.title"], words["over.screened_out"], "", locale=words.locale)
    return TextScreen(words["over.complete" if reason == "complete" else "over.title"], "", "", locale=words.locale)


def build_overlay_screen(
    words: InterfaceWords, phase: Phase, reason: EndReason, detail: str, *, declining: bool = False
) -> TextScreen | None:
    """The screen in front of a part, or after the last; None while a part is shown."""
    match phase:
        case Phase.PAUSED:
            return build_pause_screen(words)
        case Phase.UNFOCUSED:
            return build_focus_lost_screen(words)
        case Phase.QUIT_QUESTION:
            return build_quit_screen(words, declining=declining)
        case Phase.ABORT_QUESTION:
            return build_abort_screen(words)
        case Phase.OVER:
            return build_end_screen(words, reason, detail)
    return None


def format_score(words: InterfaceWords, points: float) -> str:
    """What an episode was worth: "+10 points"."""
    return _isolate_signs(words, words.fill("score", points=f"{'+' if points > 0 else ''}{format_points(points)}"))


def fill_score_fields(context: "SessionContext", text: str) -> str:
    """A text with {points}, {bonus} and {currency} filled in, if it asks for them."""
    if not any(f"{{{field}}}" in text for field in ("points", "bonus", "currency")):
        return text
    bonus = context.plan.bonus or BonusSpec(0.0)
    return _isolate_signs(
        context.words,
        text.replace("{points}", format_points(context.points))
        .replace("{bonus}", f"{compute_bonus(bonus, context.points, context.waited_ns, context.stranded):.2f}")
        .replace("{currency}", bonus.currency),
    )


def compute_bonus(bonus: BonusSpec, points: float, waited_ns: int = 0, stranded: bool = False) -> float:
    """What a session earns, in the bonus's currency.

    Args:
        bonus: the protocol's.
        points: the session's.
        waited_ns: spent in lobbies; paid on top of all else.
        stranded: whether others, or the study, kept it from being played: it earns the base pay at least.
    """
    earned = max(0.0, bonus.base + bonus.per_point * points)
    earned = earned if bonus.most is None else min(earned, bonus.most)
    least = (bonus.base_pay or 0.0) if stranded else 0.0
    return max(earned, least) + (bonus.waiting_per_min or 0.0) * waited_ns / 60e9


def format_points(value: float) -> str:
    """A number of points without needless decimals."""
    shown = round(value, 1)
    return f"{shown:.1f}".rstrip("0").rstrip(".") if shown else "0"


class PointsNumber(float):
    """A number that templates show without needless decimals."""

    def __format__(self, spec: str) -> str:
        """Format as `format_points` unless ``spec`` is given."""
        return float.__format__(self, spec) if spec else format_points(self)


def _isolate_signs(words: InterfaceWords, text: str) -> str:
    """A text in which signs stay before their numbers: from right to left, Unicode's rules put them behind."""
    return _SIGNED.sub("\u200e\\g<0>", text) if words.rtl else text


def capitalise(text: str) -> str:
    """A text whose first letter is a capital."""
    return text[:1].upper() + text[1:]
