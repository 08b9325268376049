"""Blocks in plans that were recorded before plans had parts."""

from collections.abc import Iterator

from minihuman.activities.play.plan import PlayPlan
from minihuman.experiment.plan.session_plan import PlannedPart, SessionPlan
from minihuman.experiment.words import InterfaceWords

_OUTCOMES = ("goal", "timeout", "failure", "abandoned")


def find_early_blocks(plan: SessionPlan) -> Iterator[tuple[int, PlannedPart]]:
    """Yield the blocks of an early plan, each with its place in the session."""
    words = InterfaceWords(plan.language, plan.words, plan.fonts)
    count = len(plan.texts)
    for number, text in enumerate(plan.texts):
        episodes = [episode for episode in plan.episodes if episode.block == number]
        is_last = number + 1 == count
        block = PlayPlan(
            block=number,
            blocks=count,
            first=episodes[0].episode,
            count=len(episodes),
            title="" if count < 2 else words.fill("progress.part", part=number + 1, parts=count),
            instruction=(text.instruction.strip(),) if text.instruction else (),
            feedback=dict.fromkeys(_OUTCOMES, text.feedback) if text.feedback else {},
            rest="" if is_last else text.rest,
            rest_s=0.0 if is_last else text.rest_s,
        )
        yield 2, PlannedPart("play", episodes[0].block_name, block)
