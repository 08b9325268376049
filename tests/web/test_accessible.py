"""Every page under axe-core: nothing that a person with a screen reader or weak eyes would stumble over."""

from importlib.resources import files
from pathlib import Path
from threading import Thread
from typing import Any

import pytest

from minihuman.admin.recruitment import Recruitment
from minihuman.admin.verify.log import find_log_differences
from minihuman.runtime.watch.dashboard import DashboardServer
from minihuman.worlds.adapters.world import World
from tests.machine import needs
from tests.web.browser import browsing
from tests.web.every_screen import CODE, KINDS, every_screen, go_through
from tests.web.serving import serving

pytestmark = [pytest.mark.program, needs("chromium")]
ZOOMED_PX = (683, 384)  # what a window of 1366 x 768 has at 200 %


AXE_RUN = "axe.run(document, { resultTypes: ['violations'] })"


def axe_script() -> str:
    """axe-core itself."""
    return files("axe_playwright_python").joinpath("axe.min.js").read_text()


def serious(page: Any) -> list[str]:
    """What axe-core finds on the page as it is, of the two worst kinds."""
    if not page.evaluate("'axe' in globalThis"):
        page.evaluate(axe_script())
    return list_serious(page.evaluate(AXE_RUN))


def list_serious(found: dict[str, Any]) -> list[str]:
    """Of all findings, those of the two worst kinds."""
    return [
        f"{one['id']}: {one['nodes'][0]['html']}"
        for one in found["violations"]
        if one["impact"] in ("serious", "critical")
    ]


def test_no_screen_of_a_study_has_a_serious_finding_and_none_is_cut_off_at_200_percent(tmp_path: Path) -> None:
    found: dict[str, list[str]] = {}
    too_wide: list[str] = []

    def look(page: Any, looks: str) -> None:
        found[looks] = serious(page)
        if page.evaluate("document.documentElement.scrollWidth > innerWidth"):
            too_wide.append(looks)

    with serving(every_screen(tmp_path), tmp_path) as served, browsing(size=ZOOMED_PX) as sit_down:
        address = f"http://127.0.0.1:{served.port}/#t="
        somebody = sit_down(address + served.tokens[0])
        looked = go_through(somebody, look)
        assert CODE in somebody.screen()
        stranger = sit_down(address + "unknown").page
        stranger.get_by_text("This link is not valid").wait_for()
        assert serious(stranger) == []
    assert [kind for kind in KINDS if not any(kind in looks for looks in looked)] == []
    assert {looks: each for looks, each in found.items() if each} == {}
    assert too_wide == []
    assert somebody.errors == []
    [log] = tmp_path.rglob("*.mcap")
    assert list(find_log_differences(log, World)) == []


def test_the_experimenters_page_has_no_serious_finding(tmp_path: Path) -> None:
    Recruitment(tmp_path).issue(2)
    server = DashboardServer(tmp_path)
    thread = Thread(target=server.serve, daemon=True)
    thread.start()
    with browsing() as sit_down:
        page = sit_down(server.url).page
        page.get_by_text("No session is running now").wait_for()
        assert serious(page) == []
        page.get_by_role("button", name="Close recruitment").click()
        page.get_by_role("button", name="Open recruitment").wait_for()
        assert not Recruitment(tmp_path).standing().recruiting
        assert serious(page) == []
    server.stop()
    thread.join()
