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

    def check(self, message: LogMessage, schema: str) -> tuple[Event | None, list[str]]:
        """Return the event in a message, and a line for each way in which the message differs from the expected one.

        The event is None for a preview message, or for a message that cannot be read.
        """
        topic = message.channel.topic
        if topic in _FOR_VIEWERS:
            self._waiting.append(message)
            self._previews.is_pose_per_step |= schema == PoseInFrame.DESCRIPTOR.full_name
            return None, []
        previews = self._waiting
        self._waiting = []
        self._last = message
        place = f"message {message.sequence} on {topic}"
        try:
            event = self._decode(topic, message.data)
        except Exception as error:  # a changed message can make protobuf raise anything
            return None, [f"{place} cannot be read: {error}"]
        if event is None:
            return None, [f"{place} says nothing"]
        differences = []
        event_topic, encoded = encode_event(event)
        log_time = self._started_ns + event.t_ns
        if event_topic != topic or not _is_as_written(encoded, message.data):
            differences.append(f"{place} is not as it is written")
        if message.log_time != log_time:
            differences.append(f"{place}: log time {message.log_time}, by its own time {log_time}")
        if message.publish_time != self._started_ns + event_cause_ns(event):
            differences.append(f"{place}: publish time {message.publish_time} is not when it was caused")
        expected = list(self._previews.encode(topic, message.data, event))
        return event, differences + self._compare_previews(expected, message, previews, place)

    def _keep_picture(self, picture: Image.Image) -> bytes:
        """Keep a picture to be compared, instead of encoding it."""
        self._picture = picture
        return b""

    def accept(self, message: LogMessage, event: Event) -> bool:
        """Accept a message that surely has its event's bytes and times.

        Return False, and do nothing, if previews belong to it: these must be compared.
        """
        if self._waiting or self._previews.is_pose_per_step:
            return False
        self._last = message
        if isinstance(event, Stepped):
            self._previews.add_step(event)
        return True

    def finish(self) -> list[str]:
        """Compare the preview messages at the segment's end; only the poses of an interrupted episode may remain."""
        if self._last is None:
            return [f"a message on {message.channel.topic} repeats nothing" for message in self._waiting]
        return self._compare_previews(list(self._previews.finish()), self._last, self._waiting, "the segment's end")

    def _compare_previews(
        self, expected: list[tuple[str, Message]], message: LogMessage, previews: list[LogMessage], place: str
    ) -> list[str]:
        """Compare the previews of a message with the expected ones; return the differences."""
        if self._live and not previews:
            return []
        topics_expected = [topic for topic, _ in expected]
        topics_logged = [preview.channel.topic for preview in previews]
        if topics_expected != topics_logged:
            logged = ", ".join(topics_logged) or "none"
            return [f"{place} is repeated for viewers on {logged}; it should be on {topics_expected}"]
        differences = []
        for (topic, again), preview in zip(expected, previews, strict=True):
            times = (preview.sequence, preview.log_time, preview.publish_time)
            has_times = times == (0, message.log_time, message.publish_time)
            if not has_times or not _shows_same(topic, again, preview.data, self._picture):
                differences.append(f"{place}: its copy for viewers on {topic} is another")
        return differences


def _is_as_written(again: Message, logged: bytes) -> bool:
    """Return whether a message has the bytes that this version of minihuman, or an earlier one, writes for it."""
    if again.SerializeToString(deterministic=True) == logged:
        return True
    if not isinstance(again, v1.SessionPlan):
        return False
    for part, logged_part in zip(again.parts, v1.SessionPlan.FromString(logged).parts, strict=False):
        part.plan_json = _without_later_defaults(part.plan_json, logged_part.plan_json)
    return again.SerializeToString(deterministic=True) == logged


def _without_later_defaults(plan_json: str, logged_json: str) -> str:
    """Return a part's plan without the default values of fields that are missing from the logged plan."""
    plan = msgspec.json.decode(plan_json)
    logged = msgspec.json.decode(logged_json)
    if not isinstance(plan, dict) or not isinstance(logged, dict):
        return plan_json
    return msgspec.json.encode({name: value for name, value in plan.items() if name in logged}).decode()


def _shows_same(topic: str, again: Message, logged_bytes: bytes, picture: Image.Image | None) -> bool:
    """Return whether two previews show the same; other versions of a library may compress a picture differently.

    Args:
        topic: the topic of both.
        again: the expected preview; a floor plan without its picture.
        logged_bytes: the logged preview.
        picture: the floor plan.
    """
    expected_bytes = again.SerializeToString(deterministic=True)
    is_map = topic == topics.MAP_IMAGE and picture is not None
    is_same = expected_bytes == logged_bytes and not is_map
    if is_same or topic not in (topics.MAP_IMAGE, topics.OBSERVATION_IMAGE):
        return is_same
    try:
        if _without_picture(expected_bytes) != _without_picture(logged_bytes):
            return False
        logged = Image.open(io.BytesIO(CompressedImage.FromString(logged_bytes).data))
        if not is_map:
            expected = Image.open(io.BytesIO(CompressedImage.FromString(expected_bytes).data))
            return np.array_equal(np.asarray(expected), np.asarray(logged))
        assert picture is not None
        is_alike = (logged.mode, logged.size) == (picture.mode, picture.size)
        if is_alike and ImageChops.difference(logged, picture).getbbox() is None:
            return True
        # Pillow 10 and 12 put the outline of a disc on different pixels
        return _differ_by_a_pixel(np.asarray(picture), np.asarray(logged))
    except Exception:  # the bytes are no picture
        return False


def _differ_by_a_pixel(drawing: NDArray[np.uint8], other: NDArray[np.uint8]) -> bool:
    """Return whether two drawings [H, W, 3] are the same except for edges that lie up to one pixel apart."""
    return drawing.shape == other.shape and _lies_within(drawing, other) and _lies_within(other, drawing)


def _lies_within(drawing: NDArray[np.uint8], other: NDArray[np.uint8]) -> bool:
    """Return whether each pixel of a drawing has a colour within the range of the other drawing's adjacent pixels."""
    image = Image.fromarray(other)
    low = np.asarray(image.filter(ImageFilter.MinFilter(3)))
    high = np.asarray(image.filter(ImageFilter.MaxFilter(3)))
    return bool(((low <= drawing) & (drawing <= high)).all())


def _without_picture(data: bytes) -> bytes:
    message = CompressedImage.FromString(data)
    message.data = b""
    return message.SerializeToString(deterministic=True)
