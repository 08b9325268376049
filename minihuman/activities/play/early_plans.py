"""Blocks in plans that were recorded before plans had parts."""

from collections.abc import Iterator

from minihuman.activities.play.plan import PlayPlan
from minihuman.experiment.plan.session_plan import PlannedPart, SessionPlan
from minihuman.experiment.words import InterfaceWords

_POSITION = 2  # of the blocks in an early session: after the first pages and the keyboard check
_OUTCOMES = ("goal", "timeout", "failure", "abandoned")


def find_early_blocks(plan: SessionPlan) -> Iterator[tuple[int, PlannedPart]]:
    """Yield the blocks of a plan from before plans had parts, in order.

    Each comes with the position of the blocks among the session's parts, which is the same for all.
    """
    words = InterfaceWords(plan.language, plan.words, plan.fonts)
    n_blocks = len(plan.texts)
    for block_index, text in enumerate(plan.texts):
        episodes = [episode for episode in plan.episodes if episode.block == block_index]
        part = block_index + 1
        title = words.fill("progress.part", part=part, parts=n_blocks) if n_blocks > 1 else ""
        rest_text = ""
        rest_s = 0.0
        if part < n_blocks:
            rest_text = text.rest
            rest_s = text.rest_s
        block = PlayPlan(
            block=block_index,
            blocks=n_blocks,
            first=episodes[0].episode,
            count=len(episodes),
            title=title,
            instruction=(text.instruction.strip(),) if text.instruction else (),
            feedback=dict.fromkeys(_OUTCOMES, text.feedback) if text.feedback else {},
            rest=rest_text,
            rest_s=rest_s,
        )
        yield _POSITION, PlannedPart("play", episodes[0].block_name, block)
