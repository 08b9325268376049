"""Questionnaires answered by real X key and mouse events: what was given is in the log, the table and the report."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from minihuman.admin.protocol_file import read_protocol
from minihuman.admin.verify.episodes import verify_episodes
from minihuman.display.windows.blocking_window import TITLE
from minihuman.experiment.machine.events import Answered
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.log.read.session_reader import read_log
from tests.counts import PATIENCE_S
from tests.machine import needs
from tests.seats.answering_typist import Participant
from tests.seats.station import started
from tests.xserver import Typist, xvfb

pytestmark = [pytest.mark.program, needs("xvfb")]

SIZE_PX = (800, 600)
FORMS = """
[study]
name = "forms"
version = "1"
seed = 2
language = "de"
[[groups]]
name = "alle"
parts = ["person", "last"]
[[questions]]
name = "person"
form = "demographics"
[[questions]]
name = "last"
form = "nasa-tlx"
"""


def done(*words: str | Path, within_s: float) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "minihuman", *map(str, words)]
    return subprocess.run(command, env={**os.environ, "DISPLAY": ""}, capture_output=True, text=True, timeout=within_s)


@pytest.mark.nightly(by_day=["pygame"])
@pytest.mark.parametrize("window", ["pygame", "pyglet"])
def test_forms_answered_by_key_and_mouse_equal_log_table_and_report(window: str, tmp_path: Path) -> None:
    file = tmp_path / "forms.toml"
    file.write_text(FORMS)
    study = read_protocol(file)
    plan = expand_protocol(study, enrol_participant(study, 0))
    with xvfb(SIZE_PX) as display:
        typist = Typist(display)
        station = started("run", file, "--data", tmp_path, "--window", window, "--windowed", display=display)
        typist.focus(TITLE)
        live = tmp_path / "forms/sub-01/ses-01/sub-01_ses-01.mcap.part"
        somebody = Participant(typist, plan, live, SIZE_PX)
        somebody.take_part()
        said, complained = station.communicate(timeout=PATIENCE_S)
        typist.close()
    assert station.returncode == 0, complained

    log = read_log(Path(said.splitlines()[-1]))
    assert (log.end_reason, verify_episodes(log).difference) == ("complete", "")
    answered = [event for event in log.part_events if isinstance(event, Answered)]
    assert len(somebody.given) == 11
    assert [(event.part_name, event.item, event.value) for event in answered] == somebody.given
    assert all(0 < event.shown_ns <= event.first_ns <= event.t_ns for event in answered)

    exported = done("export", "parquet", tmp_path / "forms", tmp_path / "out", within_s=120)
    assert exported.returncode == 0, exported.stderr
    rows = pq.read_table(tmp_path / "out/answers.parquet").to_pylist()
    told = [(row["questions"], row["item"], row["number"] or row["answer"]) for row in rows]
    assert told == [(part, item, json.loads(value)) for part, item, value in somebody.given]

    reported = done("report", tmp_path / "forms", "--out", tmp_path / "report", within_s=300)
    assert reported.returncode == 0, reported.stderr
    page = next((tmp_path / "report").rglob("report.html")).read_text()
    for row in rows:
        assert row["item"] in page
