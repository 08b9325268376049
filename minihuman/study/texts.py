"""The words of every screen but the world's own: what a participant reads, from the plan and what just happened."""

import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from minihuman.study.activities.drafts import Question
from minihuman.study.activities.play_plan import PlayPlan
from minihuman.study.events import EndReason, Outcome
from minihuman.study.phases import Phase
from minihuman.study.plan import Bonus, EpisodePlan
from minihuman.study.play import Play
from minihuman.study.screens import Button, Item, Mark, PageScreen, Pointed, QuestionScreen, TextScreen
from minihuman.study.words import Words

if TYPE_CHECKING:
    from minihuman.study.stage import Stage

ABORT_REASONS = (
    "the participant asked to stop",
    "the participant is unwell",
    "technical trouble",
    "wrong participant or protocol",
    "another reason",
)
_MARKS: dict[Outcome, Mark] = {"goal": "good", "timeout": "neutral", "failure": "bad", "abandoned": ""}
_SIGNED = re.compile(r"(?<!\w)[-+\u2212](?=\d)")
_FAILURES = ("disk_full", "world_error", "internal_error")


def page(
    words: Words,
    *,
    title: str,
    body: str,
    page: int,
    pages: int,
    last: str,
    button: str,
    picture: NDArray[np.uint8] | None = None,
    marks: tuple[Pointed, ...] = (),
    declining: str = "",
) -> PageScreen:
    """A page of a text; ``last`` is the last page's prompt, ``button`` what its button says.

    ``declining`` is what a button to say no to it says; "" where there is nothing to decline.
    """
    at_end = page == pages - 1
    buttons: tuple[Button, ...] = (Button("back", words["button.back"]),) if page else ()
    buttons += (Button("decline", declining),) if declining else ()
    buttons += (Button("go_on", button if at_end else words["button.next"]),)
    progress = words.fill("page.progress", page=page + 1, pages=pages) if pages > 1 else ""
    prompt = last if at_end else words["page.prompt"]
    return PageScreen(title, body, page + 1, pages, prompt, buttons, progress, picture, marks, words.script)


def question(
    words: Words, *, title: str, asked: Question, item: Item, number: int, count: int, note: str
) -> QuestionScreen:
    """One question and its answer so far."""
    buttons: tuple[Button, ...] = (Button("back", words["button.back"]),) if number else ()
    buttons += (Button("go_on", words["button.go_on"]),)
    progress = words.fill("question.progress", number=number + 1, count=count) if count > 1 else ""
    return QuestionScreen(title, asked.ask, item, words[f"prompt.{asked.kind}"], buttons, progress, note, words.script)


def wrong(words: Words, text: str) -> TextScreen:
    """Some answers were wrong, and there is another try."""
    return TextScreen(words["wrong.title"], text.strip() or words["wrong.body"], words["go_on"], script=words.script)


def progress(stage: "Stage", block: PlayPlan, episode: EpisodePlan, points: float | None) -> str:
    """Where in the session an episode is: "Part 1 of 2, episode 3 of 10", and the points so far."""
    words = stage.words
    fields = {
        "part": block.block + 1,
        "parts": block.blocks,
        "episode": episode.episode_in_block + 1,
        "episodes": episode.episodes_in_block,
    }
    key = "progress.of_one" if block.blocks < 2 else "progress.of_many"
    if block.until is not None:
        key += "_open"  # nobody knows how many there will be
    line = words.fill(key, **fields)
    if points is None:
        return line
    return f"{line}    {_signs(words, words.fill('progress.points', points=number(points)))}"


def keyboard_check(words: Words, keys: Sequence[str], pressed: frozenset[str]) -> TextScreen:
    """Every key of the pool, and whether it has arrived yet."""
    left = len(set(keys)) - len(pressed)
    return TextScreen(
        words["keyboard_check.title"],
        words["keyboard_check.body"],
        words["keyboard_check.one_left"] if left == 1 else words.fill("keyboard_check.left", count=left),
        keys=tuple((key, key in pressed) for key in keys),
        script=words.script,
        labels=words.labels(tuple(keys)),
    )


def ready(words: Words, mission: str, progress_line: str) -> TextScreen:
    """The last screen before play; the mission is there to be read in peace."""
    return TextScreen(
        words["ready.title"], _sentence(mission), words["ready.prompt"], progress_line, script=words.script
    )


def feedback(
    words: Words, block: PlayPlan, played: Play, progress_line: str, points: float, total: float
) -> TextScreen:
    """The block's feedback for this outcome, its fields filled in."""
    outcome = played.outcome or "abandoned"
    body = block.feedback[outcome].format(
        outcome=words[f"outcome.{outcome}"],
        reward=played.return_,
        steps=played.steps,
        episode=played.plan.episode_in_block + 1,
        episodes=played.plan.episodes_in_block,
        points=Number(points),
        total=Number(total),
    )
    body = _signs(words, _sentence(body.strip()))
    return TextScreen("", body, words["go_on"], progress_line, script=words.script)


def learning(words: Words) -> TextScreen:
    """The agent learns from what it was shown; the next episode waits for it a while."""
    return TextScreen(words["learning.title"], words["learning.body"], "", script=words.script)


def rest(words: Words, text: str, left_s: int) -> TextScreen:
    """The rest after a block, with the seconds that must still pass."""
    prompt = words["go_on"] if left_s <= 0 else words.fill("rest.wait", seconds=left_s)
    return TextScreen(words["rest.title"], text.strip() or words["rest.body"], prompt, script=words.script)


def paused(words: Words) -> TextScreen:
    """Play is suspended."""
    return TextScreen(words["paused.title"], words["paused.body"], words["go_on"], script=words.script)


def unfocused(words: Words) -> TextScreen:
    """The keys go to another window."""
    return TextScreen(words["unfocused.title"], words["unfocused.body"], "", script=words.script)


def getting_ready(words: Words) -> TextScreen:
    """Something takes a moment."""
    return TextScreen("", words["getting_ready"], "", script=words.script)


def quit_question(words: Words) -> TextScreen:
    """Question before Escape ends anything."""
    return TextScreen(words["quit.title"], words["quit.body"], words["quit.prompt"], script=words.script)


def abort_question(words: Words) -> TextScreen:
    """For the experimenter: why the session is to end."""
    reasons = (words[f"abort.reason_{number}"] for number in range(1, len(ABORT_REASONS) + 1))
    body = "\n".join(f"{number}  {reason}" for number, reason in enumerate(reasons, start=1))
    return TextScreen(words["abort.title"], body, words["abort.prompt"], script=words.script)


def abort_reason(key: str) -> str | None:
    """The reason a digit stands for, on the digit row or the keypad; None for any other key."""
    reasons = {str(number): reason for number, reason in enumerate(ABORT_REASONS, start=1)}
    return reasons.get(key.removeprefix("kp_"))


def over(words: Words, reason: EndReason, detail: str) -> TextScreen:
    """The session is over; a failure says what failed and that the data is kept."""
    if reason in _FAILURES:
        return TextScreen(words[f"over.{reason}"], f"{detail}\n\n{words['over.kept']}", "", script=words.script)
    if reason == "screened_out":
        return TextScreen(words["over.title"], words["over.screened_out"], "", script=words.script)
    return TextScreen(words["over.complete" if reason == "complete" else "over.title"], "", "", script=words.script)


def over_part(words: Words, phase: Phase, reason: EndReason, detail: str) -> TextScreen | None:
    """What stands in front of a part, or after the last; None while a part is seen."""
    match phase:
        case Phase.PAUSED:
            return paused(words)
        case Phase.UNFOCUSED:
            return unfocused(words)
        case Phase.QUIT_QUESTION:
            return quit_question(words)
        case Phase.ABORT_QUESTION:
            return abort_question(words)
        case Phase.OVER:
            return over(words, reason, detail)
    return None


def mark(outcome: Outcome | None) -> Mark:
    """The mark on a last picture."""
    return _MARKS[outcome] if outcome else ""


def score(words: Words, points: float) -> str:
    """What an episode was worth: "+10 points"."""
    return _signs(words, words.fill("score", points=f"{'+' if points > 0 else ''}{number(points)}"))


def with_score(stage: "Stage", text: str) -> str:
    """A text with {points}, {bonus} and {currency} filled in, if it asks for them."""
    if not any(f"{{{field}}}" in text for field in ("points", "bonus", "currency")):
        return text
    bonus = stage.plan.bonus or Bonus(0.0)
    return _signs(
        stage.words,
        text.replace("{points}", number(stage.points))
        .replace("{bonus}", f"{bonus_of(bonus, stage.points):.2f}")
        .replace("{currency}", bonus.currency),
    )


def bonus_of(bonus: Bonus, points: float) -> float:
    """What points are worth, in the bonus's currency."""
    earned = max(0.0, bonus.base + bonus.per_point * points)
    return earned if bonus.most is None else min(earned, bonus.most)


def number(value: float) -> str:
    """A number of points without needless decimals."""
    shown = round(value, 1)
    return f"{shown:.1f}".rstrip("0").rstrip(".") if shown else "0"


class Number(float):
    """A number that a text shows without needless decimals, unless it asks for some."""

    def __format__(self, spec: str) -> str:
        """As ``number`` says."""
        return float.__format__(self, spec) if spec else number(self)


def _signs(words: Words, text: str) -> str:
    """A text in which signs stay before their numbers: from right to left, Unicode's rules put them behind."""
    return _SIGNED.sub("\u200e\\g<0>", text) if words.rtl else text


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:]
