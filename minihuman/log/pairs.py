"""The topics of comparisons: what was shown on either side, and what was said of it."""

from typing import get_args

from minihuman.log.kinds import Row
from minihuman.log.proto import minihuman_agent_v1_pb2 as agent_v1
from minihuman.log.topics import Topic
from minihuman.study.activities import pair_events as ev

STRETCH = "/preference/stretch"
NOTHING = "/preference/none"
FRAME = "/preference/frame"
PREFERENCE = "/preference"

PREFERENCES = (
    Row(
        ev.StretchShown,
        Topic(STRETCH, agent_v1.StretchShown, "one side of a pair that is compared, by seed and actions"),
        {"side": get_args(ev.Side)},
    ),
    Row(ev.NothingToCompare, Topic(NOTHING, agent_v1.NothingToCompare, "there are no two stretches that differ")),
    Row(ev.PairSeen, Topic(FRAME, agent_v1.PairSeen, "when a pair's pictures were on the display")),
    Row(
        ev.Preferred,
        Topic(PREFERENCE, agent_v1.Preferred, "which side of a pair was said to be better"),
        {"answer": get_args(ev.Verdict)},
    ),
)
