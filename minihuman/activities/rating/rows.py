"""Log rows of rated blocks: each event with its topic and message."""

from minihuman.activities.agent_blocks.rows import AGENT_ROWS
from minihuman.activities.rating.events import Rated
from minihuman.log.codec import EventRow
from minihuman.log.proto import minihuman_agent_v1_pb2 as agent_v1
from minihuman.log.topics import Topic

RATING_TOPIC = "/rating"

RATING_ROWS = (*AGENT_ROWS, EventRow(Rated, Topic(RATING_TOPIC, agent_v1.Rated)))
