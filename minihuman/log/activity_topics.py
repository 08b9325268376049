"""Topics that our activity kinds add to a log: agents and ratings, pairs of clips, corrections, teams."""

from minihuman.activities.agent_blocks import events as agent_blocks
from minihuman.activities.correction import events as correction
from minihuman.activities.preferences import events as preferences
from minihuman.activities.rating.events import Rated
from minihuman.activities.team import events as team_play, message_events as team_messages
from minihuman.log.codec import EventRow
from minihuman.log.proto import minihuman_agent_v1_pb2 as agent_v1
from minihuman.log.topics import Topic

POLICY_TOPIC = "/policy"
LEARNER_REQUEST_TOPIC = "/policy/asked"
ADVICE_TOPIC = "/policy/advice"
CONTROL_TOPIC = "/control"
RATING_TOPIC = "/rating"

_AGENT_ROWS = (
    EventRow(agent_blocks.PolicyGiven, Topic(POLICY_TOPIC, agent_v1.PolicyGiven)),
    EventRow(agent_blocks.LearnerAsked, Topic(LEARNER_REQUEST_TOPIC, agent_v1.LearnerAsked)),
    EventRow(agent_blocks.Advised, Topic(ADVICE_TOPIC, agent_v1.Advised)),
    EventRow(agent_blocks.ControlChanged, Topic(CONTROL_TOPIC, agent_v1.ControlChanged)),
)
TAKEOVER_ROWS = _AGENT_ROWS
RATING_ROWS = (
    *_AGENT_ROWS,
    EventRow(Rated, Topic(RATING_TOPIC, agent_v1.Rated)),
)

PREFERENCE_CLIP_TOPIC = "/preference/stretch"
NO_PREFERENCE_TOPIC = "/preference/none"
PREFERENCE_FRAME_TOPIC = "/preference/frame"
PREFERENCE_TOPIC = "/preference"

PREFERENCE_ROWS = (
    EventRow(preferences.StretchShown, Topic(PREFERENCE_CLIP_TOPIC, agent_v1.StretchShown)),
    EventRow(preferences.NothingToCompare, Topic(NO_PREFERENCE_TOPIC, agent_v1.NothingToCompare)),
    EventRow(preferences.PairSeen, Topic(PREFERENCE_FRAME_TOPIC, agent_v1.PairSeen)),
    EventRow(preferences.Preferred, Topic(PREFERENCE_TOPIC, agent_v1.Preferred)),
)

CORRECTION_EPISODE_TOPIC = "/correction/episode"
NO_CORRECTION_TOPIC = "/correction/none"
CORRECTION_FRAME_TOPIC = "/correction/frame"
CORRECTION_TOPIC = "/correction"
CORRECTION_STEP_TOPIC = "/correction/step"
CORRECTION_END_TOPIC = "/correction/end"

CORRECTION_ROWS = (
    EventRow(correction.EpisodeLookedAt, Topic(CORRECTION_EPISODE_TOPIC, agent_v1.EpisodeLookedAt)),
    EventRow(correction.NothingToCorrect, Topic(NO_CORRECTION_TOPIC, agent_v1.NothingToCorrect)),
    EventRow(correction.CorrectionSeen, Topic(CORRECTION_FRAME_TOPIC, agent_v1.CorrectionSeen)),
    EventRow(correction.CorrectionBegun, Topic(CORRECTION_TOPIC, agent_v1.CorrectionBegun)),
    EventRow(correction.CorrectionStepped, Topic(CORRECTION_STEP_TOPIC, agent_v1.CorrectionStepped)),
    EventRow(correction.CorrectionEnded, Topic(CORRECTION_END_TOPIC, agent_v1.CorrectionEnded)),
)

TEAM_TOPIC = "/team"
JOINT_STEP_TOPIC = "/team/step"

TEAM_ROWS = (
    EventRow(team_play.TeamFormed, Topic(TEAM_TOPIC, agent_v1.TeamFormed)),
    EventRow(team_play.SeatsReadied, Topic("/team/ready", agent_v1.SeatsReadied)),
    EventRow(team_play.JointStepped, Topic(JOINT_STEP_TOPIC, agent_v1.JointStepped)),
    EventRow(team_play.InputLate, Topic("/team/late", agent_v1.InputLate)),
    EventRow(team_play.PictureCorrected, Topic("/team/corrected", agent_v1.PictureCorrected)),
    EventRow(team_play.SeatTaken, Topic("/team/seat", agent_v1.SeatTaken)),
    EventRow(team_play.TeamEnded, Topic("/team/end", agent_v1.TeamEnded)),
    EventRow(team_messages.MessageTyped, Topic("/team/typed", agent_v1.MessageTyped)),
    EventRow(team_messages.MessageShown, Topic("/team/message", agent_v1.MessageShown)),
)
