"""Decodes the events of many messages of one topic at once, and says of which messages it is sure.

Sure means: the event is the one that `decode_event` returns, and `encode_event` gives the message's bytes again. It
follows from how the bytes are built, so that nothing is encoded. Whatever is not sure is left to these two functions.
"""

import numpy as np
from numpy.typing import NDArray

from minihuman.experiment.machine.events import Event
from minihuman.log import topics
from minihuman.log.codec import find_message_codec
from minihuman.log.read.protobuf_columns import BEYOND, MessageColumns
from minihuman.log.read.session_rows import FREQUENT_TOPICS
from minihuman.log.salvage.records import ChunkMessages, TopicMessages

_CAUSE_FIELDS = {topics.STEP: "key_t_ns", topics.FRAME: "submit_ns"}  # the times of which `event_cause_ns` tells
_FEWEST = 16  # messages; fewer are decoded sooner one by one
_FAR_NS = 1 << 61  # times beyond, 73 years, are compared as Python's numbers


def decode_sure_events(chunk: ChunkMessages, started_ns: int) -> list[Event | None]:
    """Decode a chunk's steps, keys and pictures.

    Args:
        chunk: the messages of a segment.
        started_ns: the wall-clock time of the segment's time 0, in nanoseconds.

    Returns:
        For each of the chunk's messages its event; None for other topics, and for messages of which it is not sure that
        they have the bytes and the times that their events are written with.
    """
    events: list[Event | None] = [None] * len(chunk)
    data = b""
    for messages in chunk.by_topic(among=FREQUENT_TOPICS):
        if len(messages.places) < _FEWEST or not 0 <= started_ns < _FAR_NS:
            continue
        data = data or chunk.data + BEYOND
        try:
            decoded, is_sure = _decode_topic(messages, chunk, data, started_ns)
        except (ValueError, IndexError):  # it is told one by one what is no such message
            continue
        for place, event, sure in zip(messages.places.tolist(), decoded, is_sure.tolist(), strict=True):
            if sure:
                events[place] = event
    return events


def _decode_topic(
    messages: TopicMessages, chunk: ChunkMessages, data: bytes, started_ns: int
) -> tuple[list[Event], NDArray[np.bool_]]:
    """Return the events of a chunk's messages on one topic, and bool[n], of which messages it is sure.

    Raises:
        ValueError: if the bytes are not such messages.
    """
    codec = find_message_codec(messages.topic)
    assert codec is not None, f"events on {messages.topic} are not encoded field by field"
    kind = FREQUENT_TOPICS[messages.topic].DESCRIPTOR
    columns = MessageColumns(kind, data, messages.begins, messages.ends, canonical=True)
    decoded, is_sure = codec.decode_columns(columns)
    times_ns = columns["t_ns"].values
    if messages.topic == topics.KEY:
        causes_ns = times_ns - columns["waited_ns"].values
    else:
        causes_ns = columns[_CAUSE_FIELDS[messages.topic]].values
    log_times, publish_times = chunk.times_at(messages.places)
    for own_ns, stated_ns in ((times_ns, log_times), (causes_ns, publish_times)):
        is_sure &= (own_ns >= 0) & (own_ns < _FAR_NS) & (stated_ns == (own_ns + started_ns).astype(np.uint64))
    return decoded, is_sure
