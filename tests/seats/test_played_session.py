"""The whole product, as a participant meets it: `minihuman run` in a real window, played by real X key events."""

from pathlib import Path

import pytest

from minihuman.admin.protocol_file import read_protocol
from minihuman.admin.verify.episodes import verify_episodes
from minihuman.display.windows.blocking_window import TITLE
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.log.read.session_reader import read_log
from tests.counts import PATIENCE_S
from tests.seats.session_typist import begin, type_session
from tests.seats.station import DEMO, demo_started
from tests.xserver import Typist

pytestmark = pytest.mark.program


@pytest.mark.nightly(by_day=["pygame"])
@pytest.mark.parametrize("window", ["pygame", "pyglet"])
def test_a_whole_demo_session_keeps_every_stroke_and_verifies(
    window: str, typist_and_display: tuple[Typist, str], tmp_path: Path
) -> None:
    typist, display = typist_and_display
    demo = read_protocol(DEMO)
    plan = expand_protocol(demo, enrol_participant(demo, 0))
    station = demo_started(window, display, tmp_path)
    typist.focus(TITLE)
    type_session(typist, plan, tmp_path)
    said, complained = station.communicate(timeout=PATIENCE_S)
    assert station.returncode == 0, complained

    log = read_log(Path(said.splitlines()[-1]))
    assert (log.end_reason, log.clean) == ("complete", True)
    assert typist.sent[-1] == ("enter", False)  # the press before it ended the session; nothing follows the end
    assert [(key.key, key.down) for key in log.keys if key.verdict != "repeat"] == typist.sent[:-1]
    assert [episode.outcome for episode in log.episodes] == ["goal"] * 4
    assert [note.text for note in log.notes if getattr(note, "kind", "") == "keyboard_check"]
    for episode in log.episodes:  # the last picture too
        assert sorted({frame.step for frame in episode.frames}) == list(range(len(episode.actions) + 1))
    stamps = [key.t_ns for key in log.keys]
    assert stamps == sorted(stamps)
    assert verify_episodes(log).difference == ""
    assert (log.facts["window"], log.facts["window_size_px"]) == (window, "640x480")
    assert log.facts["key_identity"].startswith("position")


def test_closing_the_window_mid_episode_says_abandoned(typist_and_display: tuple[Typist, str], tmp_path: Path) -> None:
    typist, display = typist_and_display
    demo = read_protocol(DEMO)
    plan = expand_protocol(demo, enrol_participant(demo, 0))
    station = demo_started("pygame", display, tmp_path)
    typist.focus(TITLE)
    begin(typist, plan, tmp_path)
    typist.tap(*plan.episodes[0].key_map.keys)
    typist.ask_to_close(TITLE)
    said, complained = station.communicate(timeout=PATIENCE_S)
    assert station.returncode == 0, complained
    log = read_log(Path(said.splitlines()[-1]))
    assert (log.end_reason, log.clean) == ("window_closed", True)
    assert [episode.outcome for episode in log.episodes] == ["abandoned"]
    assert len(log.episodes[0].actions) == len(plan.episodes[0].key_map.keys)
