"""Decodes the events of many messages of one topic at once, and returns for which messages it is sure.

Sure means: the event is the one that `decode_event` returns, and `encode_event` gives the message's bytes again. It
follows from the structure of the bytes, so that nothing is encoded. Other messages are left to these two functions.
"""

from collections import defaultdict
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minihuman.experiment.machine.events import Event
from minihuman.log import topics
from minihuman.log.codec import find_message_codec
from minihuman.log.read.protobuf_columns import BEYOND, MessageColumns
from minihuman.log.read.session_rows import FREQUENT_TOPICS
from minihuman.log.salvage.records import ChunkMessages

_CAUSE_FIELDS = {topics.STEP: "key_t_ns", topics.FRAME: "submit_ns"}  # the times that `event_cause_ns` returns
_Batch = tuple[NDArray[Any], ...]  # places among the messages, where they begin and end, log and publish times
_FAR_NS = 1 << 61  # later times (73 years) are not sure


def decode_sure_events(chunks: Sequence[ChunkMessages], started_ns: str) -> list[Event | None]:
    """Decode the steps, keys and pictures of a segment.

    Args:
        chunks: the messages of the segment.
        started_ns: the wall-clock time of the segment's time 0, in nanoseconds, from its metadata.

    Returns:
        For each of the messages its event; None for other topics, and for messages that may not have the bytes and
        the times with which their events are written.
    """
    events: list[Event | None] = [None] * sum(map(len, chunks))
    if not started_ns.isdecimal() or int(started_ns) >= _FAR_NS:
        return events
    batches: defaultdict[str, list[_Batch]] = defaultdict(list)
    n_messages = 0  # in the chunks so far
    n_bytes = 0
    for chunk in chunks:
        for messages in chunk.by_topic(among=FREQUENT_TOPICS):
            positions = (messages.places + n_messages, messages.begins + n_bytes, messages.ends + n_bytes)
            batches[messages.topic].append((*positions, *chunk.times_at(messages.places)))
        n_messages += len(chunk)
        n_bytes += len(chunk.data)
    payloads = b"".join((*(chunk.data for chunk in chunks), BEYOND))
    for topic, arrays in batches.items():
        batch = tuple(map(np.concatenate, zip(*arrays, strict=True)))
        try:
            decoded, is_sure = _decode_topic(topic, batch, payloads, int(started_ns))
        except (ValueError, IndexError):  # single messages are then decoded one by one
            continue
        places, *_ = batch
        for place, event, sure in zip(places.tolist(), decoded, is_sure.tolist(), strict=True):
            if sure:
                events[place] = event
    return events


def _decode_topic(topic: str, batch: _Batch, payloads: bytes, started_ns: int) -> tuple[list[Event], NDArray[np.bool_]]:
    """Return the events of n messages on one topic, and bool[n], whether each is sure, as the module explains.

    Args:
        topic: a frequent topic.
        batch: the positions and times of the messages.
        payloads: the bytes of all chunks.
        started_ns: the wall-clock time of the segment's time 0, in nanoseconds.

    Raises:
        ValueError: if the bytes are not such messages.
    """
    _, begins, ends, log_times, publish_times = batch
    codec = find_message_codec(topic)
    assert codec is not None, f"events on {topic} are not encoded field by field"
    columns = MessageColumns(FREQUENT_TOPICS[topic].DESCRIPTOR, payloads, begins, ends, canonical=True)
    decoded, is_sure = codec.decode_columns(columns)
    times_ns = columns["t_ns"].values
    if topic == topics.KEY:
        causes_ns = times_ns - columns["waited_ns"].values
    else:
        causes_ns = columns[_CAUSE_FIELDS[topic]].values
    for own_ns, stated_ns in ((times_ns, log_times), (causes_ns, publish_times)):
        is_sure &= (own_ns >= 0) & (own_ns < _FAR_NS) & (stated_ns == (own_ns + started_ns).astype(np.uint64))
    return decoded, is_sure
