"""A laboratory adds an activity, a question kind, an exporter and a column: one folder, no edit elsewhere."""

import os
import shutil
import sys
from pathlib import Path

import msgspec
import numpy as np
import pytest
from starlette.applications import Starlette
from starlette.testclient import TestClient

import minihuman
from minihuman.admin.protocol_file import read_protocol
from minihuman.dataset.activity_tables import list_activity_tables
from minihuman.dataset.table_catalogue import TABLES
from minihuman.display.drawing.screen import compose_screen
from minihuman.experiment.machine.activity import find_kind
from minihuman.experiment.machine.screens import TextLocale
from minihuman.log.codec import find_topic, list_activity_topics
from minihuman.log.read.session_reader import read_log
from minihuman.testing import check_activity, check_exporter, check_question
from minihuman.web.screen_values import convert_screen
from minihuman.web.server.page_routes import build_page_routes

pytestmark = pytest.mark.program  # a study is simulated

FOLDER = Path(__file__).parent / "dummy_lab"
ENTRY_POINTS = """
[minihuman.activities]
tapping = dummy_lab.activity:TAPPING
[minihuman.questions]
mood = dummy_lab.mood:MOOD
[minihuman.exporters]
lengths = dummy_lab.lengths:export_lengths
[minihuman.columns]
hesitation_ms = dummy_lab.columns:HESITATION
"""
STUDY = """
[study]
name = "dummy"
version = "1"
seed = 3
closing = ""
[keys]
keyboard_check = false
[[groups]]
name = "all"
parts = ["warm-up", "feelings", "played"]
[[activities]]
name = "warm-up"
kind = "tapping"
settings = { taps = 4 }
[[questions]]
name = "feelings"
[[questions.items]]
name = "feeling"
kind = "mood"
ask = "How do you feel now?"
[[blocks]]
name = "played"
world = "minihuman/MiniGrid-Empty-5x5-v0"
actions = ["left", "right", "forward"]
episodes = 2
max_steps = 9
"""


@pytest.fixture(scope="module")
def lab(tmp_path_factory):
    """The folder that the laboratory's package is installed in, in a process that met its names before it was there."""
    assert list_activity_topics(["tapping"]) == ()
    assert find_topic("/dummy_lab/tap") is None
    place = tmp_path_factory.mktemp("installed")
    shutil.copytree(FOLDER, place / "dummy_lab", ignore=shutil.ignore_patterns("__pycache__"))
    info = place / "dummy_lab-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: dummy-lab\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(ENTRY_POINTS)
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(place)
        patch.setenv("PYTHONPATH", str(place), prepend=os.pathsep)  # of the processes that read the logs
        yield place
    for name in [name for name in sys.modules if name.partition(".")[0] == "dummy_lab"]:
        del sys.modules[name]


@pytest.fixture(scope="module")
def study(lab, tmp_path_factory):
    folder = tmp_path_factory.mktemp("study")
    protocol = folder / "dummy.toml"
    protocol.write_text(STUDY)
    list(minihuman.simulate(protocol, participants=2, data=folder, player="random", seed=1))
    return folder / "dummy"


def test_the_kinds_keep_their_contracts(lab):
    check_activity("tapping", taps=3)
    check_question("mood")
    check_exporter("lengths")


def test_its_events_are_in_the_log_which_proves(study):
    logs = sorted(study.rglob("*.mcap"))
    taps = [event.tap for log in logs for event in read_log(log).part_events if type(event).__name__ == "Tapped"]
    assert taps == [1, 2, 3, 4] * 2
    findings = list(minihuman.verify(study))
    assert len(findings) == 2
    assert all(finding.ok for finding in findings)


def test_its_events_and_answers_are_rows_of_tables(study):
    tables = minihuman.open_study(study)
    taps = tables.table("taps")
    assert list(taps["tap"]) == [1, 2, 3, 4] * 2
    assert list(taps["part"]) == [1] * 8
    assert set(tables.table("answers")["answer"]) <= {"sad", "glad"}
    assert "taps" in {table.name for table in list_activity_tables()}


def test_its_column_is_in_the_table_of_episodes_and_explained(study):
    episodes = minihuman.open_study(study).table("episodes")
    assert (episodes["hesitation_ms"] > 0).all()
    assert TABLES["episodes"][-1].meaning.startswith("From the reset to the first step")


def test_its_tables_and_its_exporter_write_files(study, tmp_path):
    minihuman.export("csv", study, tmp_path / "csv")
    assert "taps.csv" in {path.name for path in (tmp_path / "csv").rglob("*.csv")}
    minihuman.export("lengths", study, tmp_path / "lengths")
    assert (tmp_path / "lengths" / "lengths.txt").read_text().split()


def test_its_section_is_in_the_report(study, tmp_path):
    minihuman.report(study, tmp_path / "report")
    page = (tmp_path / "report" / "report.html").read_text()
    assert '<h2 id="tapping">Tapping</h2>' in page
    assert "Taps of the space bar." in page


def test_its_screen_is_drawn_at_the_desk_and_described_to_the_page(lab):
    screen = find_kind("tapping").screens[0](TextLocale(), taps=2)
    before = find_kind("tapping").screens[0](TextLocale(), taps=0)
    assert not np.array_equal(compose_screen(screen, (320, 240)), compose_screen(before, (320, 240)))
    values = convert_screen(screen, lambda _: 0)
    assert msgspec.json.decode(msgspec.json.encode(values)) == values
    assert (values["kind"], values["view"], values["taps"]) == ("activity", "taps", 2)


def test_the_page_finds_its_module(lab):
    values = convert_screen(find_kind("tapping").screens[0](TextLocale(), taps=2), lambda _: 0)
    with TestClient(Starlette(routes=build_page_routes())) as client:
        answer = client.get(values["module"])
    assert answer.headers["content-type"].startswith("text/javascript")
    assert answer.text == (FOLDER / "page.js").read_text()


def test_a_protocol_may_name_them(lab, tmp_path):
    path = tmp_path / "dummy.toml"
    path.write_text(STUDY)
    assert read_protocol(path).activities[0].kind == "tapping"


def test_nothing_of_the_package_knows_them():
    package = Path(minihuman.__file__).parent
    sources = [path for path in package.rglob("*") if path.suffix in (".py", ".js", ".toml")]
    assert [path for path in sources if "dummy_lab" in path.read_text(encoding="utf-8")] == []
