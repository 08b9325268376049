"""The log's topics: which message type each carries. docs/log-format.md is written from this table.

Any other topic is a guest's: nothing here reads it, and nothing takes offence.
"""

from dataclasses import dataclass
from functools import cache
from typing import Any

from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.message import Message

from minihuman.log.names import END_METADATA as END_METADATA
from minihuman.log.names import FACTS_METADATA as FACTS_METADATA
from minihuman.log.names import FINISHED_LOG_WAS as FINISHED_LOG_WAS
from minihuman.log.names import MISSING_METADATA as MISSING_METADATA
from minihuman.log.names import PROFILE as PROFILE
from minihuman.log.names import REPAIRED_METADATA as REPAIRED_METADATA
from minihuman.log.names import SCHEMA_VERSION as SCHEMA_VERSION
from minihuman.log.names import SEGMENT_METADATA as SEGMENT_METADATA
from minihuman.log.names import STEP as STEP
from minihuman.log.proto import minihuman_v1_pb2 as v1

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
POINTER = "/input/pointer"
ANSWER_CHANGE = "/answer/change"
ANSWER = "/answer"
SAMPLE = "/sample"
LINK = "/link"

POSE = "/pose"
MAP_IMAGE = "/map/image"
OBSERVATION_IMAGE = "/obs/image"
LOG = "/log"


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic, its message type, and whether it holds the truth or only repeats it for viewers."""

    name: str
    message: type[Message]
    holds: str
    for_viewers: bool = False


TOPICS = (
    Topic(PLAN, v1.SessionPlan, "the whole plan and the station's facts; the first message of a segment"),
    Topic(NOTE, v1.Note, "consent, keyboard check, focus, phase changes, errors"),
    Topic(PAUSE, v1.Pause, "play stopped, and why; play goes on"),
    Topic(KEY_MAP, v1.KeyMapDrawn, "the key map that comes into force"),
    Topic(EPISODE_START, v1.EpisodeStart, "what is played, map, first pose and hashes"),
    Topic(KEY, v1.KeyEvent, "every press and release, mapped or not"),
    Topic(OBSERVATION, v1.Observation, "what was observed, where the protocol asks for it; before its step"),
    Topic(STEP, v1.Step, "one step of the world; the last message of its step"),
    Topic(FRAME, v1.FrameShown, "when a picture was handed over and when it was on the display"),
    Topic(SAMPLE, v1.Sample, "what a device of the protocol gave"),
    Topic(LINK, v1.Linked, "how a browser's clock lies to its server's, every ten seconds"),
    Topic(EPISODE_END, v1.EpisodeEnd, "outcome, steps, return, last state hash"),
    Topic(SKIP, v1.EpisodesSkipped, "planned episodes that are not played: a criterion was met, or the time is up"),
    Topic(POINTS, v1.Scored, "an episode's points, and the session's so far"),
    Topic(CLAUSE, v1.ClauseDone, "a clause of the episode's instruction is done; before the step that did it"),
    Topic(PART, v1.PartStarted, "a part of the session begins"),
    Topic(PART_END, v1.PartEnded, "a part is over, and which one is next"),
    Topic(PAGE, v1.PageShown, "a page of a text reached the display"),
    Topic(TEXT, v1.TextTyped, "text from the input method or the keyboard's layout"),
    Topic(POINTER, v1.PointerUsed, "mouse or finger: down, moved while down, up, and the spot that was hit"),
    Topic(ANSWER_CHANGE, v1.AnswerChanged, "an answer is another now, not given yet"),
    Topic(ANSWER, v1.Answered, "an answer was given: what, when, after how many changes, right or wrong"),
    Topic(SESSION_END, v1.SessionEnd, "why the segment ended; its last message"),
    Topic(POSE, PoseInFrame, "the pose after a reset or step", for_viewers=True),
    Topic(MAP_IMAGE, CompressedImage, "the floor plan of an episode, PNG", for_viewers=True),
    Topic(OBSERVATION_IMAGE, CompressedImage, "an observation that is a picture, PNG", for_viewers=True),
    Topic(LOG, Log, "a readable line for starts, ends, pauses and notes", for_viewers=True),
)
BY_NAME = {topic.name: topic for topic in TOPICS}


def schema_bytes(message: type[Message]) -> bytes:
    """Serialise a message type and everything it needs, as MCAP's protobuf encoding asks."""
    return _schema_bytes(message.DESCRIPTOR)


@cache
def _schema_bytes(message: Any) -> bytes:
    needed: set[str] = set()
    files: dict[str, Any] = {}

    def collect(kind: Any) -> None:
        if kind.full_name not in needed:
            needed.add(kind.full_name)
            for field in kind.fields:
                if field.message_type is not None:
                    collect(field.message_type)

    def collect_file(file: Any) -> None:
        for imported in file.dependencies:
            collect_file(imported)
        files.setdefault(file.name, file)

    collect(message)
    collect_file(message.file)
    result = FileDescriptorSet()
    for file in files.values():
        copy = result.file.add()
        file.CopyToProto(copy)
        kept = [kind for kind in copy.message_type if f"{copy.package}.{kind.name}" in needed]
        del copy.message_type[:]
        copy.message_type.extend(kept)
    return result.SerializeToString(deterministic=True)
