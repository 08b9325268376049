"""Drawn tasks of rules and goals, reached by key events at a desk and in a browser; the logs are proven."""

from pathlib import Path

import pytest

from minihuman.admin.protocol_file import read_protocol
from minihuman.admin.verify.log import verify_session
from minihuman.display.mission_paragraphs import split_mission
from minihuman.display.windows.blocking_window import TITLE
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.log.read.session_reader import read_log
from tests.counts import PATIENCE_S, count
from tests.machine import needs
from tests.seats.session_typist import type_session
from tests.seats.station import started
from tests.web.browser import Somebody, browsing
from tests.web.serving import serving
from tests.web.site.study_walk import Hands, StudyWalk, list_path_keys
from tests.xserver import Typist

pytestmark = [pytest.mark.program, pytest.mark.nightly(sample=True)]

STUDY = Path(__file__).parents[4] / "protocols" / "rules.toml"
BLOCKS = '"goals", "one-rule", "two-rules", "three-rules"'


def write_study(folder: Path) -> tuple[Path, SessionPlan]:
    """Write the study of 20 tasks, or by day of two whose rules have to be used; return its path and first session."""
    text = STUDY.read_text(encoding="utf-8")
    assert BLOCKS in text
    shortened = text.replace(BLOCKS, '"one-rule", "two-rules"').replace("episodes = 5", "episodes = 1")
    path = folder / "rules.toml"
    path.write_text(count(shortened, text), encoding="utf-8")
    study = read_protocol(path)
    return path, expand_protocol(study, enrol_participant(study, 0))


def check_log(path: Path, plan: SessionPlan) -> list[str]:
    """Check that every goal was reached on the planned path and that the log is proven; return the missions."""
    log = read_log(path)
    assert (log.end_reason, log.clean) == ("complete", True)
    assert len(log.episodes) == count(2, 20)
    assert {episode.outcome for episode in log.episodes} == {"goal"}
    assert [len(episode.actions) for episode in log.episodes] == [len(list_path_keys(one)) for one in plan.episodes]
    assert all(ok for _, ok in verify_session(path))
    return [episode.start.mission for episode in log.episodes]


@needs("xvfb")
def test_drawn_tasks_are_reached_by_keys_at_a_desk(display: str, tmp_path: Path) -> None:
    path, plan = write_study(tmp_path)
    typist = Typist(display)
    data = tmp_path / "data"
    station = started("run", path, "--data", data, "--window", "pygame", "--windowed", display=display)
    typist.focus(TITLE)
    type_session(typist, plan, data)
    printed, complaint = station.communicate(timeout=PATIENCE_S)
    typist.close()
    assert station.returncode == 0, complaint
    check_log(Path(printed.splitlines()[-1]), plan)


class KeyboardHands(Hands):
    """A participant's keys, by the names that a log has, arrows among them."""

    def __init__(self, somebody: Somebody) -> None:
        super().__init__(somebody.page)
        self._somebody = somebody

    def press(self, *keys: str) -> None:
        self._somebody.press(*keys)


READ_MISSION = "[...document.querySelectorAll('.play h1, .play .rules p')].map((part) => part.innerText)"


@needs("chromium")
def test_drawn_tasks_are_reached_by_keys_in_a_browser_that_shows_each_rule(tmp_path: Path) -> None:
    path, plan = write_study(tmp_path)
    shown: set[tuple[str, ...]] = set()
    with serving(path, tmp_path / "data") as served, browsing() as sit_down:
        somebody = sit_down(f"http://127.0.0.1:{served.port}/#t={served.tokens[0]}")
        walk = StudyWalk(KeyboardHands(somebody), plan, lambda: shown.add(tuple(somebody.page.evaluate(READ_MISSION))))
        walk.walk()
        assert somebody.errors == []
    [log_path] = (tmp_path / "data").rglob("*.mcap")
    missions = check_log(log_path, plan)
    assert {tuple(split_mission(mission)) for mission in missions} <= shown
