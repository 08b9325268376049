"""The topics of sessions with an agent: policies, what they would do, who steers, what was pressed."""

from typing import get_args

from minihuman.log.kinds import Row
from minihuman.log.proto import minihuman_agent_v1_pb2 as agent_v1
from minihuman.log.topics import Topic
from minihuman.study.activities import agent_events as ev

POLICY = "/policy"
ASKED = "/policy/asked"
ADVICE = "/policy/advice"
CONTROL = "/control"
RATINGS = "/rating"

_AGENT = (
    Row(ev.PolicyGiven, Topic(POLICY, agent_v1.PolicyGiven, "which policy plays from the next episode on")),
    Row(ev.LearnerAsked, Topic(ASKED, agent_v1.LearnerAsked, "a learner is to make a policy of all that was shown")),
    Row(ev.Advised, Topic(ADVICE, agent_v1.Advised, "what the policy would do after a step, whoever steers")),
    Row(
        ev.ControlChanged,
        Topic(CONTROL, agent_v1.ControlChanged, "who steers from now on, and why"),
        {"who": get_args(ev.Who), "reason": get_args(ev.ControlReason)},
    ),
)
TAKEOVER = _AGENT
RATING = (*_AGENT, Row(ev.Rated, Topic(RATINGS, agent_v1.Rated, "a press that says good or bad, whatever was seen")))
