"""Blocks in plans that were recorded before plans had parts."""

from collections.abc import Iterator

from minihuman.activities.play.plan import PlayPlan
from minihuman.experiment.plan.session_plan import PlannedPart, SessionPlan
from minihuman.experiment.words import InterfaceWords

_OUTCOMES = ("goal", "timeout", "failure", "abandoned")


def find_early_blocks(plan: SessionPlan) -> Iterator[tuple[int, PlannedPart]]:
    """Yield the blocks of an early plan, each with its position in the session."""
    words = InterfaceWords(plan.language, plan.words, plan.fonts)
    count = len(plan.texts)
    for number, text in enumerate(plan.texts):
        episodes = [episode for episode in plan.episodes if episode.block == number]
        part = number + 1
        title = words.fill("progress.part", part=part, parts=count) if count > 1 else ""
        rest_text = ""
        rest_s = 0.0
        if part < count:
            rest_text = text.rest
            rest_s = text.rest_s
        block = PlayPlan(
            block=number,
            blocks=count,
            first=episodes[0].episode,
            count=len(episodes),
            title=title,
            instruction=(text.instruction.strip(),) if text.instruction else (),
            feedback=dict.fromkeys(_OUTCOMES, text.feedback) if text.feedback else {},
            rest=rest_text,
            rest_s=rest_s,
        )
        yield 2, PlannedPart("play", episodes[0].block_name, block)
