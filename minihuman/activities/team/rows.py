"""Log rows of team blocks: each event with its topic and message."""

from minihuman.activities.team.events import (
    InputLate,
    JointStepped,
    PictureCorrected,
    SeatSeen,
    SeatsReadied,
    SeatTaken,
    TeamEnded,
    TeamFormed,
)
from minihuman.activities.team.message_events import MessageEdited, MessageShown, MessageTyped
from minihuman.log.codec import EventRow
from minihuman.log.proto import minihuman_agent_v1_pb2 as agent_v1
from minihuman.log.topics import Topic

TEAM_TOPIC = "/team"
READY_TOPIC = "/team/ready"
JOINT_STEP_TOPIC = "/team/step"
LATE_TOPIC = "/team/late"
PICTURE_CORRECTION_TOPIC = "/team/corrected"
SEAT_TOPIC = "/team/seat"
SEEN_TOPIC = "/team/seen"
TEAM_END_TOPIC = "/team/end"
TYPED_TOPIC = "/team/typed"
EDITED_TOPIC = "/team/edited"
MESSAGE_TOPIC = "/team/message"

TEAM_ROWS = (
    EventRow(TeamFormed, Topic(TEAM_TOPIC, agent_v1.TeamFormed)),
    EventRow(SeatsReadied, Topic(READY_TOPIC, agent_v1.SeatsReadied)),
    EventRow(JointStepped, Topic(JOINT_STEP_TOPIC, agent_v1.JointStepped)),
    EventRow(InputLate, Topic(LATE_TOPIC, agent_v1.InputLate)),
    EventRow(PictureCorrected, Topic(PICTURE_CORRECTION_TOPIC, agent_v1.PictureCorrected)),
    EventRow(SeatTaken, Topic(SEAT_TOPIC, agent_v1.SeatTaken)),
    EventRow(SeatSeen, Topic(SEEN_TOPIC, agent_v1.SeatSeen)),
    EventRow(TeamEnded, Topic(TEAM_END_TOPIC, agent_v1.TeamEnded)),
    EventRow(MessageTyped, Topic(TYPED_TOPIC, agent_v1.MessageTyped)),
    EventRow(MessageEdited, Topic(EDITED_TOPIC, agent_v1.MessageEdited)),
    EventRow(MessageShown, Topic(MESSAGE_TOPIC, agent_v1.MessageShown)),
)
