"""Log rows of agent blocks: each event with its topic and message."""

from minihuman.activities.agent_blocks.events import Advised, ControlChanged, LearnerAsked, PolicyGiven
from minihuman.log.codec import EventRow
from minihuman.log.proto import minihuman_agent_v1_pb2 as agent_v1
from minihuman.log.topics import Topic

POLICY_TOPIC = "/policy"
LEARNER_REQUEST_TOPIC = "/policy/asked"
ADVICE_TOPIC = "/policy/advice"
CONTROL_TOPIC = "/control"

AGENT_ROWS = (
    EventRow(PolicyGiven, Topic(POLICY_TOPIC, agent_v1.PolicyGiven)),
    EventRow(LearnerAsked, Topic(LEARNER_REQUEST_TOPIC, agent_v1.LearnerAsked)),
    EventRow(Advised, Topic(ADVICE_TOPIC, agent_v1.Advised)),
    EventRow(ControlChanged, Topic(CONTROL_TOPIC, agent_v1.ControlChanged)),
)
