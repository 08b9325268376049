"""Log rows of comparisons: each event with its topic and message."""

from minihuman.activities.preferences.events import NothingToCompare, PairSeen, Preferred, StretchShown
from minihuman.log.codec import EventRow
from minihuman.log.proto import minihuman_agent_v1_pb2 as agent_v1
from minihuman.log.topics import Topic

PREFERENCE_CLIP_TOPIC = "/preference/stretch"
NO_PREFERENCE_TOPIC = "/preference/none"
PREFERENCE_FRAME_TOPIC = "/preference/frame"
PREFERENCE_TOPIC = "/preference"

PREFERENCE_ROWS = (
    EventRow(StretchShown, Topic(PREFERENCE_CLIP_TOPIC, agent_v1.StretchShown)),
    EventRow(NothingToCompare, Topic(NO_PREFERENCE_TOPIC, agent_v1.NothingToCompare)),
    EventRow(PairSeen, Topic(PREFERENCE_FRAME_TOPIC, agent_v1.PairSeen)),
    EventRow(Preferred, Topic(PREFERENCE_TOPIC, agent_v1.Preferred)),
)
