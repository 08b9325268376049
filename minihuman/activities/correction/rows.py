"""Log rows of corrections: each event with its topic and message."""

from minihuman.activities.correction.events import (
    CorrectionBegun,
    CorrectionEnded,
    CorrectionSeen,
    CorrectionStepped,
    EpisodeLookedAt,
    NothingToCorrect,
)
from minihuman.log.codec import EventRow
from minihuman.log.proto import minihuman_agent_v1_pb2 as agent_v1
from minihuman.log.topics import Topic

CORRECTION_EPISODE_TOPIC = "/correction/episode"
NO_CORRECTION_TOPIC = "/correction/none"
CORRECTION_FRAME_TOPIC = "/correction/frame"
CORRECTION_TOPIC = "/correction"
CORRECTION_STEP_TOPIC = "/correction/step"
CORRECTION_END_TOPIC = "/correction/end"

CORRECTION_ROWS = (
    EventRow(EpisodeLookedAt, Topic(CORRECTION_EPISODE_TOPIC, agent_v1.EpisodeLookedAt)),
    EventRow(NothingToCorrect, Topic(NO_CORRECTION_TOPIC, agent_v1.NothingToCorrect)),
    EventRow(CorrectionSeen, Topic(CORRECTION_FRAME_TOPIC, agent_v1.CorrectionSeen)),
    EventRow(CorrectionBegun, Topic(CORRECTION_TOPIC, agent_v1.CorrectionBegun)),
    EventRow(CorrectionStepped, Topic(CORRECTION_STEP_TOPIC, agent_v1.CorrectionStepped)),
    EventRow(CorrectionEnded, Topic(CORRECTION_END_TOPIC, agent_v1.CorrectionEnded)),
)
