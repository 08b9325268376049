"""The moves of a block that is played, and on which conditions a phase has something to show."""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from minihuman.study.moves import Move, Moves
from minihuman.study.phases import Cause, Phase

if TYPE_CHECKING:
    from minihuman.study.activities.play import Playing


def _another_episode_follows(play: "Playing") -> bool:
    return play.another_episode


MOVES: "Moves[Playing]" = Moves(
    [
        Move(Phase.START, Cause.BEGAN, Phase.INSTRUCTIONS),
        Move(Phase.INSTRUCTIONS, Cause.DONE, Phase.PREPARING),
        Move(Phase.PREPARING, Cause.DONE, Phase.READY),
        Move(Phase.READY, Cause.DONE, Phase.INTERVAL),
        Move(Phase.INTERVAL, Cause.DONE, Phase.FIXATION),
        Move(Phase.FIXATION, Cause.DONE, Phase.PLAYING),
        Move(Phase.PLAYING, Cause.EPISODE_ENDED, Phase.HOLD),
        Move(Phase.HOLD, Cause.DONE, Phase.FEEDBACK),
        Move(Phase.FEEDBACK, Cause.DONE, Phase.LEARNING, _another_episode_follows),
        Move(Phase.LEARNING, Cause.DONE, Phase.PREPARING),
        Move(Phase.FEEDBACK, Cause.DONE, Phase.REST),
        Move(Phase.REST, Cause.DONE, Phase.OVER),
    ]
)

SHOWN_IF: "Mapping[Phase, Callable[[Playing], bool]]" = {
    Phase.INSTRUCTIONS: lambda play: bool(play.plan.instruction),
    Phase.LEARNING: lambda play: play.learning_s > 0,
    Phase.PREPARING: lambda play: play.world_takes_a_moment,
    Phase.READY: lambda play: play.wants_ready,
    Phase.INTERVAL: lambda play: play.plan.interval_ms > 0,
    Phase.FIXATION: lambda play: play.plan.fixation_ms > 0,
    Phase.HOLD: lambda play: play.plan.hold_ms > 0,
    Phase.FEEDBACK: lambda play: bool(play.feedback_text),
    Phase.REST: lambda play: bool(play.plan.rest) or play.plan.rest_s > 0,
}


def mermaid() -> str:
    """The table as a Mermaid state diagram. A phase with nothing to show is done as soon as it is entered."""
    return MOVES.mermaid(Phase.START, Phase.OVER)
