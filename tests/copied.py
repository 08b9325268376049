"""A recorded session as another participant's: the same messages in a log of its own, quickly made."""

from pathlib import Path

from mcap.records import Attachment, Metadata
from mcap.writer import Writer

from minihuman.admin.session_index import summarize_session
from minihuman.log import integrity, names, topics
from minihuman.log.proto import minihuman_v1_pb2 as v1
from minihuman.log.salvage.records import LogMessage
from minihuman.log.salvage.scan import LogScanner


def as_another(log: Path, participant: str, study_dir: Path, *, with_end: bool = False) -> Path:
    """Write the session of a finished log as that participant's, in its place below a study's folder.

    ``with_end`` adds to its end what earlier versions did not say there.
    """
    said = _end_of(log) if with_end else {}
    session = int(log.stem.rpartition("-")[2])
    to = study_dir / participant / f"ses-{session:02d}" / f"{participant}_ses-{session:02d}.mcap"
    to.parent.mkdir(parents=True)
    scan = LogScanner(log)
    with to.open("wb") as file:
        writer = Writer(file, enable_data_crcs=True)
        writer.start(profile=names.PROFILE)
        channels: dict[int, int] = {}
        for record in scan:
            match record:
                case LogMessage(channel=channel):
                    if channel.id not in channels:
                        schema = scan.schemas[channel.schema_id]
                        number = writer.register_schema(schema.name, schema.encoding, schema.data)
                        channels[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, number)
                    data = record.data
                    if channel.topic == topics.PLAN:
                        plan = v1.SessionPlan.FromString(data)
                        plan.participant.id = participant
                        data = plan.SerializeToString(deterministic=True)
                    writer.add_message(
                        channels[channel.id], record.log_time, data, record.publish_time, record.sequence
                    )
                case Metadata(name=name, metadata=facts):
                    writer.flush()
                    own = {"participant": participant} if "participant" in facts else {}
                    writer.add_metadata(name, facts | own | (said if name == names.END_METADATA else {}))
                case Attachment() if record.name != integrity.SEGMENT_HEAD_NAME:  # a copy of what is another here
                    writer.add_attachment(
                        record.create_time, record.log_time, record.name, record.media_type, record.data
                    )
        writer.finish()
    return to


def _end_of(log: Path) -> dict[str, str]:
    found = summarize_session([log])
    return {
        "planned": str(found.episodes_planned),
        "completed": str(found.episodes_completed),
        "lasted_ns": str(round(found.duration_s * 1e9)),
    }
