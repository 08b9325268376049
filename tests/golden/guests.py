"""A log with a guest in it: the same messages, and between them those of another program, an eye tracker say."""

from collections.abc import Callable
from pathlib import Path

from mcap.records import Attachment, Metadata
from mcap.writer import Writer

from minihuman.log.names import PLAIN_SCHEMA_VERSION, SEGMENT_METADATA
from minihuman.log.salvage.records import LogMessage
from minihuman.log.salvage.scan import LogScanner

Guest = Callable[[int], int | None]  # the number of one more message after ours of this number; None: none there


def again(
    log: Path, target: Path, guest: Guest, *, version: str = str(PLAIN_SCHEMA_VERSION), leave_out: int | None = None
) -> Path:
    """Write a log again with a guest's messages between ours; those that a newer version counts shift ours on."""
    scan = LogScanner(log)
    with target.open("wb") as file:
        writer = Writer(file, chunk_size=4096)
        writer.start(profile="minihuman")
        gaze = writer.register_channel("/ext/gaze", "json", 0)
        channels: dict[tuple[str, int], int] = {}
        shift = 0
        for record in scan:
            match record:
                case LogMessage():
                    schema = scan.schemas[record.channel.schema_id]
                    if (record.channel.topic, schema.id) not in channels:
                        number = writer.register_schema(schema.name, schema.encoding, schema.data)
                        channels[record.channel.topic, schema.id] = writer.register_channel(
                            record.channel.topic, "protobuf", number
                        )
                    shift *= record.sequence != 1
                    sequence = record.sequence + shift if record.sequence else 0  # 0: for viewers, not counted
                    if record.sequence != leave_out:
                        channel = channels[record.channel.topic, schema.id]
                        writer.add_message(channel, record.log_time, record.data, record.publish_time, sequence)
                    if sequence and (its := guest(sequence)) is not None:
                        shift += its == sequence + 1
                        writer.add_message(gaze, record.log_time, b'{"x": 1}', record.log_time, its)
                case Metadata():
                    writer.flush()
                    facts = record.metadata
                    if record.name == SEGMENT_METADATA:
                        facts = facts | {"schema_version": version}
                    writer.add_metadata(record.name, facts)
                case Attachment():
                    writer.add_attachment(
                        record.create_time, record.log_time, record.name, record.media_type, record.data
                    )
        writer.finish()
    return target
