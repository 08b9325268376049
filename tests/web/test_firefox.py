"""The page in a stock Firefox: a study from its start to its end, and a log that is proven."""

from pathlib import Path

import pytest

from minihuman.admin.verify.log import find_log_differences
from minihuman.log.read.session_reader import read_log
from minihuman.worlds.adapters.world import World
from tests.machine import needs
from tests.web.firefox import firefox_at
from tests.web.protocols import FIRST_PERSON, GRID, study
from tests.web.serving import serving

pytestmark = [pytest.mark.program, needs("firefox")]
STEPS = 8


@pytest.mark.nightly
@pytest.mark.parametrize("world", [GRID, FIRST_PERSON], ids=["grid", "first-person"])
def test_a_study_is_played_to_its_end_in_firefox(tmp_path: Path, world) -> None:
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
    log = read_log(path)
    assert [episode.outcome for episode in log.episodes] == ["timeout", "timeout"]
    assert [len(episode.actions) for episode in log.episodes] == [STEPS, STEPS]
    assert log.facts["browser"] == "Firefox"
    assert list(find_log_differences(path, World)) == []
