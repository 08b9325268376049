"""What a segment starts with, a second time: a log whose plan was damaged is read from this copy.

It is an attachment, packed: the segment's metadata, the channels that are known by then, and the message with the plan.
"""

from collections.abc import Iterable, Sequence

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import Channel, Message, Metadata, Schema

from minihuman.log.read.chunk import Records, cut
from minihuman.log.read.frames import metadata_of, unpacked

NAME = "session_plan.zst"
MEDIA_TYPE = "application/zstd"
_LEVEL = 9  # 2 ms for a thousand episodes; 19 makes it a tenth smaller in 110 ms, for which a server would stand still


class SegmentHead:
    """A segment's start, read from its copy."""

    def __init__(self, records: Records) -> None:
        self.records = records
        self.metadata = [metadata_of(content) for opcode, content in records.others if opcode == Opcode.METADATA]

    @classmethod
    def of(cls, data: bytes) -> "SegmentHead":
        """Read the copy.

        Raises:
            ValueError: if it is none.
        """
        return cls(cut(unpacked(data), []))


def packed(
    metadata: Iterable[Metadata], schemas: Sequence[Schema], channels: Sequence[Channel], plan: Message
) -> bytes:
    """Make the copy."""
    builder = RecordBuilder()
    for record in (*metadata, *schemas, *channels, plan):
        record.write(builder)
    return zstandard.compress(bytes(builder.end()), _LEVEL)
