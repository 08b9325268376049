"""The topics of corrections: which episode was looked at, and what should have been done from which step on."""

from typing import get_args

from minihuman.log.kinds import Row
from minihuman.log.proto import minihuman_agent_v1_pb2 as agent_v1
from minihuman.log.topics import Topic
from minihuman.study.activities import correction_events as ev

EPISODE = "/correction/episode"
NOTHING = "/correction/none"
FRAME = "/correction/frame"
CORRECTION = "/correction"
STEP = "/correction/step"
END = "/correction/end"

CORRECTIONS = (
    Row(ev.EpisodeLookedAt, Topic(EPISODE, agent_v1.EpisodeLookedAt, "an episode that is looked at once more")),
    Row(ev.NothingToCorrect, Topic(NOTHING, agent_v1.NothingToCorrect, "there is no further episode to look at")),
    Row(ev.CorrectionSeen, Topic(FRAME, agent_v1.CorrectionSeen, "when a picture of it was on the display")),
    Row(ev.CorrectionBegun, Topic(CORRECTION, agent_v1.CorrectionBegun, "from which step on somebody shows otherwise")),
    Row(ev.CorrectionStepped, Topic(STEP, agent_v1.CorrectionStepped, "a step of what should have been done")),
    Row(
        ev.CorrectionEnded,
        Topic(END, agent_v1.CorrectionEnded, "the end of what should have been done"),
        {"outcome": get_args(ev.CorrectionOutcome)},
    ),
)
