"""Finished logs are good MCAP to others: rerun's checker finds nothing, its reader shows text, images and steps."""

import subprocess
import sys
from pathlib import Path

import pytest
from mcap.reader import make_reader

from minihuman.experiment.machine.events import SessionEnded
from minihuman.log.topics import TOPICS
from tests.counts import PATIENCE_S
from tests.log.played import record
from tests.log.samples import STARTED_NS, session_events, session_plan


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session of two segments."""
    data = tmp_path_factory.mktemp("data")
    first, second = session_plan(record=True), session_plan(segment=2, record=True)
    events = session_events(first)
    record(data, first, [*events[:120], SessionEnded(events[119].t_ns + 1, "quit", "", 1)])
    return record(data, second, session_events(second), started_ns=STARTED_NS + 3_600_000_000_000)


@pytest.mark.program
def test_reruns_checker_finds_nothing(log: Path) -> None:
    checked = subprocess.run(
        [sys.executable, "-m", "rerun", "mcap", "check", "--full", log],
        capture_output=True,
        text=True,
        timeout=PATIENCE_S,
    )
    assert checked.returncode == 0, checked.stdout + checked.stderr
    rows = [line.split() for line in checked.stdout.splitlines() if "/" in line and str(log) not in line]
    with log.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    topics = {channel.topic for channel in summary.channels.values()}
    assert {row[3]: row[0] for row in rows} == dict.fromkeys(topics, "ok"), checked.stdout
    assert topics < {topic.name for topic in TOPICS}
    assert len(topics) > 12


def test_reruns_reader_sees_text_images_poses_and_steps(log: Path) -> None:
    from rerun.chunk import McapReader

    rows: dict[tuple[str, str], int] = {}
    for chunk in McapReader(str(log)).stream():
        for column in chunk.to_record_batch().schema.names:
            rows[chunk.entity_path, column] = rows.get((chunk.entity_path, column), 0) + chunk.num_rows
    steps = rows["/step", "minihuman.v1.Step:message"]
    assert steps > 60
    assert rows["/log", "TextLog:text"] > 10
    assert rows["/map/image", "EncodedImage:blob"] == 5
    assert rows["/obs", "minihuman.v1.Observation:message"] == rows["/obs/image", "EncodedImage:blob"] > steps
    assert rows["/pose", "InstancePoses3D:translations"] == 5
    assert rows["/session/plan", "minihuman.v1.SessionPlan:message"] == 2
