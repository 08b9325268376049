"""Single messages of a log held against the events in them: their bytes, their times, what viewers are given."""

import io

import numpy as np
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from numpy.typing import NDArray
from PIL import Image

from minihuman.log import topics
from minihuman.log.encode import caused_ns, for_viewers, truth
from minihuman.log.read.chunk import LogMessage
from minihuman.log.versions import Decode
from minihuman.study.events import Event

_FOR_VIEWERS = frozenset(topic.name for topic in topics.TOPICS if topic.for_viewers)


class MessageProof:
    """Takes a segment's messages in their order.

    Args:
        started_ns: the wall clock at the segment's time 0.
        decode: reads its messages.
        live: it is of a live file, in which nothing is repeated for viewers yet.
    """

    def __init__(self, started_ns: int, decode: Decode, *, live: bool) -> None:
        self._started_ns = started_ns
        self._decode = decode
        self._live = live
        self._drawn: list[LogMessage] = []  # for viewers, since the last message that holds the truth

    def check(self, message: LogMessage) -> tuple[Event | None, list[str]]:
        """The event in a message, None in one for viewers; and what of it is not as minihuman writes it."""
        topic = message.channel.topic
        if topic in _FOR_VIEWERS:
            self._drawn.append(message)
            return None, []
        drawn, self._drawn = self._drawn, []
        where = f"message {message.sequence} on {topic}"
        try:
            event = self._decode(topic, message.data)
        except Exception as error:  # a changed message can make protobuf raise anything
            return None, [f"{where} cannot be read: {error}"]
        if event is None:
            return None, [f"{where} says nothing"]
        wrong = []
        again, encoded = truth(event)
        if again != topic or encoded.SerializeToString(deterministic=True) != message.data:
            wrong.append(f"{where} is not as it is written")
        if message.log_time != self._started_ns + event.t_ns:
            wrong.append(f"{where}: log time {message.log_time}, by its own time {self._started_ns + event.t_ns}")
        if message.publish_time != self._started_ns + caused_ns(event):
            wrong.append(f"{where}: publish time {message.publish_time} is not when it was caused")
        return event, wrong + self._viewers(message, drawn, where)

    def left(self) -> list[str]:
        """What is for viewers at the end, behind everything that it could repeat."""
        return [f"a message on {message.channel.topic} repeats nothing" for message in self._drawn]

    def _viewers(self, message: LogMessage, drawn: list[LogMessage], where: str) -> list[str]:
        if self._live and not drawn:
            return []
        expected = list(for_viewers(message.channel.topic, message.data, started_ns=self._started_ns))
        if [topic for topic, _ in expected] != [other.channel.topic for other in drawn]:
            found = ", ".join(other.channel.topic for other in drawn) or "none"
            return [f"{where} is repeated for viewers on {found}; it should be on {[topic for topic, _ in expected]}"]
        wrong = []
        for (topic, again), other in zip(expected, drawn, strict=True):
            times = (other.sequence, other.log_time, other.publish_time)
            same = times == (0, message.log_time, message.publish_time)
            if not same or not _same(topic, again.SerializeToString(deterministic=True), other.data):
                wrong.append(f"{where}: its copy for viewers on {topic} is another")
        return wrong


def _same(topic: str, again: bytes, found: bytes) -> bool:
    """Whether two messages show the same; a picture may be packed by another version of a library."""
    if again == found or topic not in (topics.MAP_IMAGE, topics.OBSERVATION_IMAGE):
        return again == found
    try:
        return _without_picture(again) == _without_picture(found) and bool((_picture(again) == _picture(found)).all())
    except Exception:  # what is no picture
        return False


def _without_picture(data: bytes) -> bytes:
    message = CompressedImage.FromString(data)
    message.data = b""
    return message.SerializeToString(deterministic=True)


def _picture(data: bytes) -> NDArray[np.uint8]:
    return np.array(Image.open(io.BytesIO(CompressedImage.FromString(data).data)))
