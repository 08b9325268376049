"""Which logs are replayed: a sample says that it is one, and a record spares what has not changed."""

import shutil
from pathlib import Path

import numpy as np
import pytest

import minihuman
from minihuman.errors import MinihumanError
from minihuman.log.codec import decode_event, encode_event
from minihuman.log.read.event_batches import decode_sure_events
from minihuman.log.read.session_rows import FREQUENT_TOPICS
from minihuman.log.salvage.records import ChunkMessages, ChunkRecords, LogMessage
from minihuman.log.salvage.scan import LogScanner
from tests.counts import count
from tests.promises.sessions import play, study
from tests.promises.tampering import rewritten


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("data")
    for _ in range(3):
        play(folder, study(episodes=1, steps=8), sync=lambda _fd: None)
    return folder / "promised"


def test_whatever_a_sampled_proof_says_of_a_log_says_that_it_is_of_a_sample(data: Path) -> None:
    lines = [*minihuman.verify(data, sample="50%", sample_seed=4)]
    of_logs = [line for line in lines if line.log.suffix == ".mcap"]
    assert len({line.log for line in of_logs}) == 2
    assert all("a sample of 2 of 3 sessions, 50 %, seed 4" in line.text for line in of_logs)
    assert "the other 1 were not verified" in "\n".join(line.text for line in lines)
    assert lines == [*minihuman.verify(data, sample=0.5, sample_seed=4)]


@pytest.mark.parametrize("share", ["0", "101%", "a few", "nan"])
def test_a_sample_that_is_no_share_is_refused(data: Path, share: str) -> None:
    with pytest.raises(MinihumanError, match=r"such as 5% or 0\.05"):
        list(minihuman.verify(data, sample=share))


def test_a_record_spares_logs_that_are_unchanged_and_a_cut_off_run_goes_on(data: Path, tmp_path: Path) -> None:
    copy = Path(shutil.copytree(data, tmp_path / "promised"))
    first, second, third = sorted(copy.rglob("*.mcap"))
    record = tmp_path / "verified.jsonl"
    lines = [*minihuman.verify(copy, record=record)]
    assert not any("unchanged since" in line.text for line in lines)
    whole = record.read_bytes().splitlines(keepends=True)
    assert len(whole) == 3
    record.write_bytes(whole[0] + whole[1][:40])  # killed while it wrote
    again = {line.log: line.text for line in minihuman.verify(copy, record=record)}
    assert [path for path, text in again.items() if "unchanged since" in text] == [first]
    rewritten(second, tmp_path / "changed.mcap", lambda records: records.pop(-3), chained=False)
    shutil.move(tmp_path / "changed.mcap", second)
    for _ in range(2):  # what differs is never spared
        last = [*minihuman.verify(copy, record=record)]
        assert {line.log for line in last if "unchanged since" in line.text} == {first, third}
        assert {line.log for line in last if line.log.suffix == ".mcap" and not line.ok} == {second}


def test_a_file_that_is_no_record_is_not_written_to(data: Path, tmp_path: Path) -> None:
    notes = tmp_path / "notes.txt"
    notes.write_text("these are my notes\n", encoding="utf-8")
    with pytest.raises(MinihumanError, match="name another file with --record"):
        list(minihuman.verify(data, record=notes))
    assert notes.read_text(encoding="utf-8") == "these are my notes\n"


def test_what_is_sure_of_many_messages_is_what_is_read_and_written_of_each(data: Path) -> None:
    """Of changed bytes too: whatever is said to be sure is the event that is read, and its bytes are written again."""
    log = next(data.rglob("*.mcap"))
    chunks = [record for record in LogScanner(log).records() if isinstance(record, ChunkMessages)]
    messages = [message for chunk in chunks for message in chunk if message.channel.topic in FREQUENT_TOPICS]
    whole = _decode(messages)
    assert all(event is not None for event in whole)
    rng = np.random.default_rng(3)
    for _ in range(count(150, 5_000)):
        place = int(rng.integers(len(messages)))
        changed = [*messages]
        changed[place] = messages[place]._replace(data=_change(messages[place].data, rng))
        for message, event in zip(changed, _decode(changed), strict=True):
            if event is not None:
                assert event == decode_event(message.channel.topic, message.data)
                topic, encoded = encode_event(event)
                written = encoded.SerializeToString(deterministic=True)
                assert (topic, written) == (message.channel.topic, message.data)


def _decode(messages: list[LogMessage]) -> list[object]:
    """Decode messages as a chunk of their own, with times of which none is wrong."""
    started_ns = 1_790_000_000_123_456_789
    heads = np.zeros(
        len(messages), [("channel", "<u2"), ("length", "<u8"), ("log_time", "<u8"), ("publish_time", "<u8")]
    )
    data = b"".join(bytes(31) + message.data for message in messages)
    sizes = np.array([31 + len(message.data) for message in messages])
    heads["length"] = sizes - 9
    for name in ("log_time", "publish_time"):
        heads[name] = [getattr(message, name) for message in messages]
    heads["channel"] = [message.channel.id for message in messages]
    channels = {message.channel.id: message.channel for message in messages}
    records = ChunkRecords(data, np.cumsum(sizes) - sizes, heads, [])
    return [*decode_sure_events([ChunkMessages(records, channels)], str(started_ns))]


def _change(data: bytes, rng: np.random.Generator) -> bytes:
    """Change, remove or repeat a few bytes of a message."""
    at = int(rng.integers(len(data)))
    match int(rng.integers(4)):
        case 0:
            return data[:at] + bytes([int(rng.integers(256))]) + data[at + 1 :]
        case 1:
            return data[:at] + data[at + int(rng.integers(1, 4)) :]
        case 2:  # a number in more bytes than it needs
            return data[:at] + bytes([data[at] | 0x80, 0]) + data[at + 1 :]
    return data + data[at:]
