"""Log rows of trials with a time course: each event with its topic and message."""

from minihuman.activities.trials.events import ResponseTaken, SoundPlayed, StimuliShown, TrialResolved
from minihuman.log.codec import EventRow
from minihuman.log.field_codec import FieldCodec
from minihuman.log.proto import minihuman_v1_pb2 as v1
from minihuman.log.topics import Topic

TRIAL_TOPIC = "/trial"
STIMULI_TOPIC = "/trial/stimuli"
RESPONSE_TOPIC = "/trial/response"
SOUND_TOPIC = "/trial/sound"

TRIAL_ROWS = (
    EventRow(TrialResolved, Topic(TRIAL_TOPIC, v1.TrialResolved), {"schedule": FieldCodec("schedule_json")}),
    EventRow(StimuliShown, Topic(STIMULI_TOPIC, v1.StimuliShown)),
    EventRow(ResponseTaken, Topic(RESPONSE_TOPIC, v1.ResponseTaken)),
    EventRow(SoundPlayed, Topic(SOUND_TOPIC, v1.SoundPlayed)),
)
