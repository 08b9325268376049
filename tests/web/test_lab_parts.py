"""A lab's question and activity in a real browser, with no edit of the page: clicked, drawn, logged and verified."""

import json
from pathlib import Path

import pytest

from minihuman.admin.verify.log import find_log_differences
from minihuman.experiment.machine.events import Answered
from minihuman.log.read.session_reader import read_log
from minihuman.worlds.adapters.world import World
from tests.lab_package import PARTS, STUDY, example, install_lab as install_lab
from tests.machine import needs
from tests.web.browser import browsing
from tests.web.serving import serving

pytestmark = [pytest.mark.program, needs("chromium")]


def test_a_labs_parts_are_done_in_the_browser(install_lab, tmp_path: Path) -> None:
    install_lab("a-lab", example("question") + example("activity"), **PARTS)
    (tmp_path / "lab.toml").write_text(STUDY)
    with serving(tmp_path / "lab.toml", tmp_path) as served, browsing() as sit_down:
        somebody = sit_down(f"http://127.0.0.1:{served.port}/#t={served.tokens[0]}")
        somebody.until("s.welcomed && s.kind === 'page'")
        for _ in range(3):
            somebody.until_seen()
            somebody.press("space")
        somebody.until("s.kind === 'question'")
        assert somebody.page.locator(".shape").count() == 25
        somebody.page.locator('[data-target="cell:3:1"]').click()
        somebody.until_seen("document.querySelector('.shape.chosen[data-target=\"cell:3:1\"]')")
        somebody.press("enter")
        somebody.until("s.finished")
        assert somebody.errors == []
    (path,) = tmp_path.rglob("*.mcap")
    answers = [event for event in read_log(path).part_events if isinstance(event, Answered)]
    assert [json.loads(answer.value) for answer in answers] == [4, 4]
    assert list(find_log_differences(path, World)) == []
