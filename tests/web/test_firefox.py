"""The page in a stock Firefox: a study from its start to its end, and a log that is proven."""

from pathlib import Path

import pytest

from minihuman.lab.prove import prove
from minihuman.log.read.open_log import open_log
from minihuman.worlds.adapt.world import World
from tests.web.firefox import firefox, firefox_at
from tests.web.protocols import FIRST_PERSON, GRID, study
from tests.web.serving import serving

pytestmark = pytest.mark.program
STEPS = 8


@pytest.mark.parametrize("world", [GRID, FIRST_PERSON], ids=["grid", "first-person"])
def test_a_study_is_played_to_its_end_in_firefox(tmp_path: Path, world) -> None:
    firefox()
    with (
        serving(study(tmp_path, world, max_steps=STEPS), tmp_path) as served,
        firefox_at(f"http://127.0.0.1:{served.port}/#t={served.tokens[0]}", tmp_path / "profile") as page,
    ):
        page.until("s.welcomed && s.kind !== ''")
        while not page.find("minihuman.state.finished"):
            caps = page.find("[...document.querySelectorAll('.keyboard .cap span')].map((cap) => cap.innerText)")
            playing = page.find("minihuman.state.playing && !minihuman.state.ended")
            page.press(*caps or ["1" if playing else "enter"])
        assert "Thank you" in page.find("document.querySelector('#screen').innerText")
    (path,) = tmp_path.rglob("*.mcap")
    log = open_log(path)
    assert [episode.outcome for episode in log.episodes] == ["timeout", "timeout"]
    assert [len(episode.actions) for episode in log.episodes] == [STEPS, STEPS]
    assert log.facts["browser"] == "Firefox"
    assert list(prove(path, World)) == []
