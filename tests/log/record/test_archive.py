"""A log's archived copy: everything that is in it but the index of its messages."""

from pathlib import Path

import pytest
from click.testing import CliRunner
from mcap.reader import make_reader
from mcap.records import ChunkIndex

from minihuman.admin.verify.log import verify_session
from minihuman.cli.command_line import make_command_line
from minihuman.errors import LogError
from minihuman.log import topics
from minihuman.log.read.reader import read_segment_starts
from minihuman.log.record.finalization import archive_log
from minihuman.log.salvage.records import LogMessage
from minihuman.log.salvage.scan import LogScanner

GOLDEN = Path(__file__).parents[2] / "golden"
LOGS = sorted(GOLDEN.glob("v*/*/sub-*/ses-*/*.mcap"))


def name_of(log: Path) -> str:
    return "/".join(log.relative_to(GOLDEN).parts[:3])


def find_messages(log: Path) -> list[tuple[object, ...]]:
    messages = (record for record in LogScanner(log) if isinstance(record, LogMessage))
    return [(message.channel.topic, *message[1:]) for message in messages]


def read_chunk_indexes(log: Path) -> list[ChunkIndex]:
    with log.open("rb") as file:
        return make_reader(file).get_summary().chunk_indexes


@pytest.mark.parametrize("log", LOGS, ids=name_of)
def test_a_copy_has_every_message_and_segment_and_no_index_of_messages(log, tmp_path):
    copy = archive_log(log, tmp_path)
    assert find_messages(copy) == find_messages(log)
    assert read_segment_starts(copy) == read_segment_starts(log)
    lengths = [{chunk.message_index_length for chunk in read_chunk_indexes(path)} for path in (log, copy)]
    assert 0 not in lengths[0]
    assert lengths[1] == {0}
    assert list(tmp_path.iterdir()) == [copy]


def test_a_copy_of_many_steps_is_a_fifth_smaller(tmp_path):
    log = max(LOGS, key=lambda log: len(find_messages(log)) / log.stat().st_size)
    assert archive_log(log, tmp_path).stat().st_size < 0.8 * log.stat().st_size


@pytest.mark.parametrize(
    "log", [log for log in LOGS if log.parts[-4] in ("plain", "resumed", "recovered", "team")], ids=name_of
)
def test_a_copy_proves_as_the_log_does(log, tmp_path):
    assert list(verify_session(archive_log(log, tmp_path))) == list(verify_session(log))


def test_the_mcap_reader_finds_messages_by_topic(tmp_path):
    log = next(log for log in LOGS if log.parts[-4] == "plain")
    with log.open("rb") as whole, archive_log(log, tmp_path).open("rb") as copied:
        steps = [[its.data for *_, its in make_reader(file).iter_messages(topics.STEP)] for file in (whole, copied)]
    assert steps[0]
    assert steps[0] == steps[1]


def test_a_damaged_log_is_not_copied(tmp_path):
    damaged = tmp_path / "sub-01_ses-01.mcap"
    content = bytearray(LOGS[0].read_bytes())
    content[len(content) // 3] ^= 1
    damaged.write_bytes(content)
    out = tmp_path / "archive"
    out.mkdir()
    with pytest.raises(LogError):
        archive_log(damaged, out)
    assert not list(out.iterdir())


def test_the_command_names_the_copy_and_replaces_none(tmp_path):
    app, log = make_command_line(), LOGS[0]
    command = ["recover", "--archive", str(tmp_path / "archive"), str(log)]
    first = CliRunner().invoke(app, command)
    assert (first.exit_code, first.stdout) == (0, f"{tmp_path / 'archive' / log.name}\n")
    again = CliRunner().invoke(app, command)
    assert isinstance(again.exception, LogError)
    assert "already exists" in str(again.exception)
