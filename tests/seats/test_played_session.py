"""The whole product, as a participant meets it: `minihuman run` in a real window, played by real X key events."""

import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from minihuman.lab.protocol_file import read_protocol
from minihuman.lab.verify import verify
from minihuman.log.read.open_log import open_log
from minihuman.study.expand import enrol, expand
from minihuman.windows.blocking import TITLE
from tests.counts import PATIENCE_S
from tests.seats.session_typist import begin, type_session
from tests.xserver import Typist, xvfb

pytestmark = pytest.mark.program

SMALL_SCREEN_PX = (640, 480)  # the window shrinks to it; a first-person picture costs by the pixel
DEMO = Path(__file__).parents[2] / "protocols" / "demo.toml"


@pytest.fixture
def typist_and_display() -> Iterator[tuple[Typist, str]]:
    with xvfb(SMALL_SCREEN_PX) as display:
        typist = Typist(display)
        yield typist, display
        typist.close()


def start(window: str, display: str, data: Path) -> subprocess.Popen[str]:
    command = [
        sys.executable,
        "-m",
        "minihuman",
        "run",
        str(DEMO),
        "--data",
        str(data),
        "--window",
        window,
        "--windowed",
    ]
    environment = {**os.environ, "DISPLAY": display}
    return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.mark.parametrize("window", ["pygame", "pyglet"])
def test_a_whole_demo_session_keeps_every_stroke_and_verifies(
    window: str, typist_and_display: tuple[Typist, str], tmp_path: Path
) -> None:
    typist, display = typist_and_display
    demo = read_protocol(DEMO)
    plan = expand(demo, enrol(demo, 0))
    station = start(window, display, tmp_path)
    typist.focus(TITLE)
    type_session(typist, plan, tmp_path)
    said, complained = station.communicate(timeout=PATIENCE_S)
    assert station.returncode == 0, complained

    log = open_log(Path(said.splitlines()[-1]))
    assert (log.end_reason, log.clean) == ("complete", True)
    assert typist.sent[-1] == ("enter", False)  # the press before it ended the session; nothing follows the end
    assert [(key.key, key.down) for key in log.keys if key.verdict != "repeat"] == typist.sent[:-1]
    assert [episode.outcome for episode in log.episodes] == ["goal"] * 4
    assert [note.text for note in log.notes if getattr(note, "kind", "") == "keyboard_check"]
    for episode in log.episodes:  # the last picture too
        assert sorted({frame.step for frame in episode.frames}) == list(range(len(episode.actions) + 1))
    stamps = [key.t_ns for key in log.keys]
    assert stamps == sorted(stamps)
    assert verify(log).difference == ""
    assert (log.facts["window"], log.facts["window_size_px"]) == (window, "640x480")
    assert log.facts["key_identity"].startswith("position")


def test_closing_the_window_mid_episode_says_abandoned(typist_and_display: tuple[Typist, str], tmp_path: Path) -> None:
    typist, display = typist_and_display
    demo = read_protocol(DEMO)
    plan = expand(demo, enrol(demo, 0))
    station = start("pygame", display, tmp_path)
    typist.focus(TITLE)
    begin(typist, plan, tmp_path)
    typist.tap(*plan.episodes[0].key_map.keys)
    typist.ask_to_close(TITLE)
    said, complained = station.communicate(timeout=PATIENCE_S)
    assert station.returncode == 0, complained
    log = open_log(Path(said.splitlines()[-1]))
    assert (log.end_reason, log.clean) == ("window_closed", True)
    assert [episode.outcome for episode in log.episodes] == ["abandoned"]
    assert len(log.episodes[0].actions) == len(plan.episodes[0].key_map.keys)
