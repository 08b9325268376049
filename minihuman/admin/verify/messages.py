"""Verify a segment's messages: each has the bytes that its event is written with, and the right preview messages."""

import io

import msgspec
import numpy as np
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from google.protobuf.message import Message
from numpy.typing import NDArray
from PIL import Image, ImageChops, ImageFilter

from minihuman.experiment.machine.events import Event, Stepped
from minihuman.log import topics
from minihuman.log.codec import EventDecoder, encode_event, event_cause_ns
from minihuman.log.preview import PreviewEncoder
from minihuman.log.proto import minihuman_v1_pb2 as v1
from minihuman.log.salvage.records import LogMessage

_FOR_VIEWERS = frozenset(topic.name for topic in topics.TOPICS if topic.is_preview)


class MessageVerifier:
    """Verifies a segment's messages in order.

    Args:
        started_ns: the wall-clock time of the segment's time 0, in nanoseconds.
        decode: the function that decodes the segment's messages.
        live: whether the messages are from a live file, which has no previews for viewers yet.
    """

    def __init__(self, started_ns: int, decode: EventDecoder, *, live: bool) -> None:
        self._started_ns = started_ns
        self._decode = decode
        self._live = live
        self._previews = PreviewEncoder(started_ns, self._keep_picture)  # pictures are compared by their pixels
        self._picture: Image.Image | None = None  # of the latest expected preview
        self._waiting: list[LogMessage] = []  # preview messages since the last message of the record
        self._last: LogMessage | None = None  # the last message of the record

    def decode_and_compare(self, message: LogMessage, schema: str) -> tuple[Event | None, list[str]]:
        """Return the event in the next message, and a line for each way in which it differs from the expected message.

        The event is None for a preview message, or for a message that cannot be read. Preview messages are kept, and
        compared with the next message of the record.

        Args:
            message: the message.
            schema: the name of the message's schema.
        """
        topic = message.channel.topic
        if topic in _FOR_VIEWERS:
            self._waiting.append(message)
            self._previews.is_pose_per_step |= schema == PoseInFrame.DESCRIPTOR.full_name
            return None, []
        previews = self._waiting
        self._waiting = []
        self._last = message
        message_name = f"message {message.sequence} on {topic}"
        try:
            event = self._decode(topic, message.data)
        except Exception as error:  # a changed message can make protobuf raise anything
            return None, [f"{message_name} cannot be read: {error}"]
        if event is None:
            return None, [f"{message_name} says nothing"]
        differences = []
        event_topic, encoded = encode_event(event)
        log_time = self._started_ns + event.t_ns
        if event_topic != topic or not _is_as_written(encoded, message.data):
            differences.append(f"{message_name} is not as it is written")
        if message.log_time != log_time:
            differences.append(f"{message_name}: log time {message.log_time}, by its own time {log_time}")
        if message.publish_time != self._started_ns + event_cause_ns(event):
            differences.append(f"{message_name}: publish time {message.publish_time} is not when it was caused")
        expected = list(self._previews.encode(topic, message.data, event))
        return event, differences + self._compare_previews(expected, message, previews, message_name)

    def _keep_picture(self, picture: Image.Image) -> bytes:
        """Keep a picture to be compared, instead of encoding it; return no bytes."""
        self._picture = picture
        return b""

    def try_accept(self, message: LogMessage, event: Event) -> bool:
        """Accept the next message without comparing it, since it certainly has the bytes and times of its event.

        Return False, and do nothing, if previews belong to the message, since these must be compared.
        """
        if self._waiting or self._previews.is_pose_per_step:
            return False
        self._last = message
        if isinstance(event, Stepped):
            self._previews.add_step(event)
        return True

    def finish(self) -> list[str]:
        """Return a line for each difference of the previews at the segment's end.

        Only the message with the poses of an interrupted episode may remain there.
        """
        if self._last is None:
            return [f"a message on {message.channel.topic} repeats nothing" for message in self._waiting]
        return self._compare_previews(list(self._previews.finish()), self._last, self._waiting, "the segment's end")

    def _compare_previews(
        self, expected: list[tuple[str, Message]], message: LogMessage, previews: list[LogMessage], message_name: str
    ) -> list[str]:
        """Return a line for each difference between the logged and the expected previews of a message.

        Args:
            expected: the topic and the message of each expected preview.
            message: the message that the previews belong to, whose times they must have.
            previews: the logged previews.
            message_name: the name of the message, for the lines.
        """
        if self._live and not previews:
            return []
        topics_expected = [topic for topic, _ in expected]
        topics_logged = [preview.channel.topic for preview in previews]
        if topics_expected != topics_logged:
            logged = ", ".join(topics_logged) or "none"
            return [f"{message_name} is repeated for viewers on {logged}; it should be on {topics_expected}"]
        differences = []
        for (topic, expected_preview), preview in zip(expected, previews, strict=True):
            numbers = (preview.sequence, preview.log_time, preview.publish_time)
            has_same_times = numbers == (0, message.log_time, message.publish_time)  # previews have no sequence number
            if not has_same_times or not _shows_same(topic, expected_preview, preview.data, self._picture):
                differences.append(f"{message_name}: its copy for viewers on {topic} is another")
        return differences


def _is_as_written(expected: Message, logged: bytes) -> bool:
    """Return whether logged bytes are those that this version of minihuman, or an earlier one, writes for a message.

    An expected plan is changed to the form of the earlier version.
    """
    if expected.SerializeToString(deterministic=True) == logged:
        return True
    if not isinstance(expected, v1.SessionPlan):
        return False
    for part, logged_part in zip(expected.parts, v1.SessionPlan.FromString(logged).parts, strict=False):
        part.plan_json = _drop_later_defaults(part.plan_json, logged_part.plan_json)
    return expected.SerializeToString(deterministic=True) == logged


def _drop_later_defaults(plan_json: str, logged_json: str) -> str:
    """Return a part's plan as JSON without the fields that the logged plan, also JSON, does not have."""
    plan = msgspec.json.decode(plan_json)
    logged = msgspec.json.decode(logged_json)
    if not isinstance(plan, dict) or not isinstance(logged, dict):
        return plan_json
    return msgspec.json.encode({name: value for name, value in plan.items() if name in logged}).decode()


def _shows_same(topic: str, expected: Message, logged_bytes: bytes, floor_plan: Image.Image | None) -> bool:
    """Return whether two previews show the same; other versions of a library may compress a picture differently.

    Args:
        topic: the topic of both.
        expected: the expected preview; for a floor plan, without its picture.
        logged_bytes: the logged preview.
        floor_plan: the picture of the latest expected floor plan, if there was one.
    """
    expected_bytes = expected.SerializeToString(deterministic=True)
    if topic != topics.MAP_IMAGE:
        floor_plan = None
    if floor_plan is None and expected_bytes == logged_bytes:
        return True
    if topic not in (topics.MAP_IMAGE, topics.OBSERVATION_IMAGE):
        return False
    try:
        if _clear_picture(expected_bytes) != _clear_picture(logged_bytes):
            return False
        logged_picture = _open_picture(logged_bytes)
        if floor_plan is None:
            return np.array_equal(np.asarray(_open_picture(expected_bytes)), np.asarray(logged_picture))
        is_alike = (logged_picture.mode, logged_picture.size) == (floor_plan.mode, floor_plan.size)
        if is_alike and ImageChops.difference(logged_picture, floor_plan).getbbox() is None:
            return True
        # Pillow 10 and 12 put the outline of a disc on different pixels
        return _differ_by_a_pixel(np.asarray(floor_plan), np.asarray(logged_picture))
    except Exception:  # the bytes are no picture
        return False


def _open_picture(encoded: bytes) -> Image.Image:
    """Open the picture in an encoded preview."""
    return Image.open(io.BytesIO(CompressedImage.FromString(encoded).data))


def _differ_by_a_pixel(drawing: NDArray[np.uint8], other: NDArray[np.uint8]) -> bool:
    """Return whether two drawings, uint8[H, W, 3], differ at most by edges that lie one pixel apart."""
    if drawing.shape != other.shape:
        return False
    return _is_within_neighbours(drawing, other) and _is_within_neighbours(other, drawing)


def _is_within_neighbours(drawing: NDArray[np.uint8], other: NDArray[np.uint8]) -> bool:
    """Return whether each pixel of a drawing has a colour within the range of the other drawing's adjacent pixels."""
    image = Image.fromarray(other)
    low = np.asarray(image.filter(ImageFilter.MinFilter(3)))
    high = np.asarray(image.filter(ImageFilter.MaxFilter(3)))
    return bool(((low <= drawing) & (drawing <= high)).all())


def _clear_picture(encoded: bytes) -> bytes:
    """Return an encoded preview without its picture."""
    message = CompressedImage.FromString(encoded)
    message.data = b""
    return message.SerializeToString(deterministic=True)
