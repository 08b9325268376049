"""Topics of the log, and the message type that each carries; docs/log-format.md documents them.

A topic that is not listed belongs to another program and is neither read nor rejected.
"""

from dataclasses import dataclass, field
from functools import cache
from typing import Any

from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PosesInFrame_pb2 import PosesInFrame
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.message import Message

from minihuman.log.names import STEP as STEP
from minihuman.log.proto import minihuman_agent_v1_pb2 as agent_v1, minihuman_v1_pb2 as v1

PLAN = "/session/plan"
NOTE = "/session/note"
PAUSE = "/session/pause"
SESSION_END = "/session/end"
KEY_MAP = "/episode/keys"
EPISODE_START = "/episode/start"
EPISODE_END = "/episode/end"
KEY = "/input/key"
FRAME = "/frame"
OBSERVATION = "/obs"
SKIP = "/episode/skip"
POINTS = "/episode/points"
CLAUSE = "/episode/clause"
PART = "/session/part"
PART_END = "/session/part_end"
PAGE = "/page"
TEXT = "/input/text"
ANSWER_TEXT = "/answer/text"
POINTER = "/input/pointer"
AXIS = "/input/axis"
ANSWER_CHANGE = "/answer/change"
ANSWER = "/answer"
SAMPLE = "/sample"
LINK = "/link"
MODEL_CALL = "/model/call"
DESIGN = "/design"

POSE = "/pose"
MAP_IMAGE = "/map/image"
OBSERVATION_IMAGE = "/obs/image"
LOG = "/log"


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic, its message type, and whether it is a preview, which only repeats the record for viewers."""

    name: str
    message: type[Message]
    is_preview: bool = field(default=False, kw_only=True)


TOPICS = (
    Topic(PLAN, v1.SessionPlan),
    Topic(NOTE, v1.Note),
    Topic(PAUSE, v1.Pause),
    Topic(KEY_MAP, v1.KeyMapDrawn),
    Topic(EPISODE_START, v1.EpisodeStart),
    Topic(KEY, v1.KeyEvent),
    Topic(OBSERVATION, v1.Observation),
    Topic(STEP, v1.Step),
    Topic(FRAME, v1.FrameShown),
    Topic(SAMPLE, v1.Sample),
    Topic(LINK, v1.Linked),
    Topic(EPISODE_END, v1.EpisodeEnd),
    Topic(SKIP, v1.EpisodesSkipped),
    Topic(POINTS, v1.Scored),
    Topic(CLAUSE, v1.ClauseDone),
    Topic(PART, v1.PartStarted),
    Topic(PART_END, v1.PartEnded),
    Topic(PAGE, v1.PageShown),
    Topic(TEXT, v1.TextTyped),
    Topic(POINTER, v1.PointerUsed),
    Topic(ANSWER_CHANGE, v1.AnswerChanged),
    Topic(ANSWER, v1.Answered),
    Topic(SESSION_END, v1.SessionEnd),
    Topic(POSE, PosesInFrame, is_preview=True),
    Topic(MAP_IMAGE, CompressedImage, is_preview=True),
    Topic(OBSERVATION_IMAGE, CompressedImage, is_preview=True),
    Topic(LOG, Log, is_preview=True),
)
RARE_TOPICS = (  # a log has their channels only where it has their messages
    Topic(MODEL_CALL, agent_v1.ModelCall),
    Topic(DESIGN, agent_v1.DesignDecided),
    Topic(AXIS, v1.AxisMoved),
    Topic(ANSWER_TEXT, v1.TextChanged),
)
BY_NAME = {topic.name: topic for topic in (*TOPICS, *RARE_TOPICS)}


def schema_bytes(message: type[Message]) -> bytes:
    """Serialise a message type and all types that it needs, as MCAP's protobuf encoding requires."""
    return _serialise_schema(message.DESCRIPTOR)


@cache
def _serialise_schema(descriptor: Any) -> bytes:
    """Serialise the files that define a message type, given its descriptor, reduced to the types that it needs."""
    needed_names: set[str] = set()
    files: dict[str, Any] = {}

    def collect_types(kind: Any) -> None:
        if kind.full_name not in needed_names:
            needed_names.add(kind.full_name)
            for field in kind.fields:
                if field.message_type is not None:
                    collect_types(field.message_type)

    def collect_files(file: Any) -> None:
        for imported in file.dependencies:
            collect_files(imported)
        files.setdefault(file.name, file)

    collect_types(descriptor)
    collect_files(descriptor.file)
    reduced = FileDescriptorSet()
    for file in files.values():
        copy = reduced.file.add()
        file.CopyToProto(copy)
        needed_types = [kind for kind in copy.message_type if f"{copy.package}.{kind.name}" in needed_names]
        del copy.message_type[:]
        copy.message_type.extend(needed_types)
    return reduced.SerializeToString(deterministic=True)
