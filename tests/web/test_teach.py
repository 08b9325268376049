"""A person teaches in a real browser: takes over, hands back, rates, compares; and the log is proven."""

import re
import time
from pathlib import Path

import pytest

from minihuman.admin.verify.log import find_log_differences
from minihuman.experiment.machine.events import Noted
from minihuman.log.model.teaching_events import TeachingRecord
from minihuman.log.read.session_reader import read_log
from minihuman.worlds.adapters.world import World
from tests.counts import PATIENCE_S, count
from tests.machine import needs
from tests.web.browser import Somebody, browsing
from tests.web.serving import line, serving

pytestmark = [pytest.mark.program, needs("chromium")]
STUDY = Path(__file__).parents[2] / "protocols" / "teach-fourrooms.toml"


def shortened(folder: Path) -> Path:
    """The study with an agent that plays from the start, and few and short episodes."""
    text = STUDY.read_text()
    for what, instead in {
        r'policy = ""': 'policy = "optimal:0.3"',
        r'learner = "hg-dagger:updates=300"\n': "",
        r"step_ms = [67]00": "step_ms = 400",
        r"episodes = \d+": "episodes = 2",
        r"max_steps = \d+": "max_steps = 10",
        r"pairs = 8\nsteps = 12": "pairs = 2\nsteps = 4",
    }.items():
        text, found = re.subn(what, instead, text)
        assert found, what
    path = folder / "teach.toml"
    path.write_text(text)
    return path


def take_part(somebody: Somebody) -> None:
    """Take over from the second step on and hand back; rate now and then; prefer the left."""
    until_s, done = time.monotonic() + PATIENCE_S, ("", -1)
    corrected: set[str] = set()
    while not somebody.state["finished"]:
        assert time.monotonic() < until_s, somebody.screen()
        state, words = somebody.state, somebody.screen()
        if somebody.page.locator(".keyboard").count():
            somebody.press("left", "right", "up")
        elif "Show what" in words:
            somebody.press("left", "space")  # once: over a long line a second pair would begin to show again
            somebody.until("s.kind !== 'play' && !document.querySelector('#screen').innerText.includes('Show what')")
        elif state["kind"] == "play" and state["playing"]:
            if (words, state["step"]) != done:
                done = words, state["step"]
                if "good" in words:
                    somebody.press(*("j" if state["step"] == 2 else "f") * (state["step"] % 2 == 0))
                elif state["step"] == 2 and "You play" not in words:
                    for key in ("left", "space") * 4:  # changes its mind more quickly than the line and the agent are
                        somebody.press(key)
                        somebody.page.wait_for_timeout(130)
                elif state["step"] >= 2:
                    somebody.press("space" if "You play" in words else "left")
        elif state["kind"] == "film":
            somebody.press(*(["enter"] if words in corrected else ["period", "period", "space"]))
            corrected.add(words)
            somebody.page.wait_for_timeout(700)
        elif state["kind"] == "pair":
            somebody.press("f")
        elif state["kind"] in ("page", "text"):
            somebody.press("enter")
        somebody.page.wait_for_timeout(60)


@pytest.mark.nightly
@pytest.mark.parametrize("rtt_ms", [300, 0][: count(1, 2)])
def test_a_person_teaches_in_the_browser_and_the_log_verifies(tmp_path: Path, rtt_ms: int) -> None:
    with (
        serving(shortened(tmp_path), tmp_path) as served,
        line(served.port, rtt_ms=rtt_ms) as wire,
        browsing() as sit_down,
    ):
        somebody = sit_down(f"http://127.0.0.1:{wire.port}/#t={served.tokens[0]}")
        take_part(somebody)
        assert somebody.errors == []
    [path] = tmp_path.rglob("*.mcap")
    log = read_log(path)
    assert log.end_reason == "complete"
    assert list(find_log_differences(path, World)) == []
    assert [note.text for note in log.notes if isinstance(note, Noted) and note.kind == "page"] == []
    teaching = [episode.taught for episode in log.episodes[:2]]
    assert all(isinstance(taught, TeachingRecord) and taught.by_person.any() for taught in teaching)
    assert any("hand_back" in [change.reason for change in taught.controls] for taught in teaching if taught)
    assert all(episode.taught and episode.taught.ratings for episode in log.episodes[2:])
    assert log.corrections
    assert {its.episode for its in log.corrections} <= {0, 1}
    assert [compared.preference.answer for compared in log.comparisons] == ["left", "left"]
