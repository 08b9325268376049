"""The page in a real browser: what somebody does there is in the log, and the log is proven."""

import time
from pathlib import Path
from typing import Any

import pytest

from minihuman.admin.verify.log import find_log_differences
from minihuman.experiment.machine.events import KeyPressed
from minihuman.log.read.session_reader import read_events, read_log
from minihuman.worlds.adapters.world import World
from tests.counts import PATIENCE_S
from tests.machine import needs
from tests.web.browser import browsing
from tests.web.protocols import FIRST_PERSON, GRID, study
from tests.web.serving import line, serving

pytestmark = [pytest.mark.program, needs("chromium")]


@pytest.mark.nightly(by_day=["grid", "sent-ahead"])
@pytest.mark.parametrize(
    ("world", "computed"),
    [(GRID, "page"), (GRID, "server"), (FIRST_PERSON, "server")],
    ids=["grid", "sent-ahead", "first-person"],
)
def test_two_episodes_in_the_browser_are_a_log_that_verifies(tmp_path: Path, world, computed) -> None:
    path = study(tmp_path, world, max_steps=8, block=f'computed = "{computed}"')
    with serving(path, tmp_path) as served, browsing() as sit_down:
        somebody = sit_down(f"http://127.0.0.1:{served.port}/#t={served.tokens[0]}")
        for _ in range(2):
            somebody.to_play()
            for _ in range(8):
                somebody.press("1")
            somebody.until("!s.playing")
        somebody.to_end()
        assert somebody.errors == []
        assert "Thank you" in somebody.screen()
    log = the_log(tmp_path)
    assert [episode.outcome for episode in log.episodes] == ["timeout", "timeout"]
    assert log.plan.participant.id == "sub-01"
    assert list(find_log_differences(log.path, World)) == []


def holds(page: Any, condition: str) -> None:
    """Wait until something holds in a page."""
    until_s = time.monotonic() + PATIENCE_S
    while not page.evaluate(f"globalThis.minihuman !== undefined && ({condition})"):
        assert time.monotonic() < until_s, page.inner_text("#screen")
        page.wait_for_timeout(20)


def the_log(data: Path):
    (path,) = data.rglob("*.mcap")
    return read_log(path)


def test_who_comes_to_the_door_again_is_looked_at_again(tmp_path: Path) -> None:
    """Too small a window, too slow a line: both can be mended by who is told so."""
    path = study(tmp_path, web="min_window_size_px = [900, 500]\nmax_rtt_ms = 250")
    with (
        serving(path, tmp_path) as served,
        line(served.port, rtt_ms=300) as wire,
        browsing(size=(800, 400)) as sit_down,
    ):
        somebody = sit_down(f"http://127.0.0.1:{wire.port}/#t={served.tokens[0]}")
        somebody.until("s.finished")
        assert "at least 900 by 500" in somebody.screen()
        somebody.page.set_viewport_size({"width": 1000, "height": 600})
        somebody.page.reload()
        somebody.until("s.finished")
        assert "too slow" in somebody.screen()
        wire.one_way_s = 0.0
        somebody.page.reload()
        somebody.until("s.welcomed && s.kind !== ''")


def test_tabs_that_are_copied_and_links_that_follow_each_other_mix_nobody_up(tmp_path: Path) -> None:
    """A copy of a tab goes on where it was, and so does the first one after it; another link is another person."""
    with serving(study(tmp_path, max_steps=9), tmp_path, links=2) as served, browsing() as sit_down:
        first = sit_down(f"http://127.0.0.1:{served.port}/#t={served.tokens[0]}")
        first.to_play()
        with first.page.expect_popup() as opened:
            first.page.evaluate("window.open(location.href)")
        copy = opened.value
        holds(copy, "minihuman.state.ready")
        for _ in range(6):
            copy.keyboard.press("Digit1")
        holds(copy, "minihuman.state.confirmed === 6")
        copy.close()
        first.page.reload()
        first.until("s.ready && s.step === 6")
        first.press("1", "1")
        first.until("s.confirmed === 8")
        with first.page.expect_event("load"):
            first.page.evaluate(f"location.hash = 't={served.tokens[1]}'")
        first.until("s.welcomed && s.kind === 'text'")
        assert len(list(tmp_path.glob("tried/sub-*"))) == 2
        assert first.errors == []


LATE_REPORT = """
addEventListener("hashchange", () => {  // as when a flip is reported while the page is being left
  const state = {...kept, next: kept.next + 1};
  sessionStorage.setItem("stream", JSON.stringify(state));
  const what = {t: "shown", submit: state.last, flip: state.last};
  sessionStorage.setItem(`m${kept.next}`, JSON.stringify({t: "n", n: kept.next, at: state.last, what}));
});
var kept = JSON.parse(sessionStorage.getItem("stream"));
"""


@pytest.mark.program
def test_what_a_page_reports_while_it_is_left_does_not_keep_the_next_participant_out(tmp_path: Path) -> None:
    with serving(study(tmp_path, max_steps=9), tmp_path, links=2) as served, browsing() as sit_down:
        somebody = sit_down(f"http://127.0.0.1:{served.port}/#t={served.tokens[0]}")
        somebody.to_play()
        somebody.press("1", "2")
        somebody.until("s.unsafe === 0 && s.step === 2")
        somebody.page.evaluate(LATE_REPORT)
        with somebody.page.expect_event("load"):
            somebody.page.evaluate(f"location.hash = 't={served.tokens[1]}'")
        somebody.until("s.welcomed && s.kind === 'text'")
        assert len(list(tmp_path.glob("tried/sub-*"))) == 2
        assert somebody.errors == []


@pytest.mark.nightly
def test_keys_that_come_before_the_welcome_of_a_page_that_was_loaded_again_have_their_names(tmp_path: Path) -> None:
    holding = """
        const send = WebSocket.prototype.send, held = [];
        globalThis.isHeld = sessionStorage.getItem("stream") !== null;
        WebSocket.prototype.send = function (...what) {
            if (globalThis.isHeld) held.push([this, what]); else send.apply(this, what);
        };
        globalThis.letGo = () => {
            globalThis.isHeld = false;
            for (const [socket, what] of held) send.apply(socket, what);
        };
    """
    with serving(study(tmp_path, episodes=1, max_steps=8), tmp_path) as served, browsing() as sit_down:
        somebody = sit_down(f"http://127.0.0.1:{served.port}/#t={served.tokens[0]}")
        somebody.to_play()
        somebody.press("1")
        somebody.until("s.unsafe === 0")
        somebody.page.add_init_script(holding)
        somebody.page.reload()
        holds(somebody.page, "minihuman.state.now > 0 && globalThis.isHeld")
        somebody.press("3", "2", "1")
        assert not somebody.state["welcomed"]
        somebody.page.evaluate("letGo()")
        somebody.until("s.welcomed && s.unsafe === 0")
        somebody.press(*"1111111")  # what was pressed while the window was not in front made no step
        somebody.until("!s.playing")
        somebody.to_end()
        assert somebody.errors == []
    events = [event for event in read_events(the_log(tmp_path).path) if isinstance(event, KeyPressed)]
    pressed = [event for event in events if event.down and event.verdict != "repeat"]
    assert not [event.key for event in pressed if event.key.startswith("code_")]
    assert [event.key for event in pressed if event.key in "123"] == [*"1321", *"1111111"]


def test_who_makes_the_window_larger_is_looked_at_again_without_a_reload(tmp_path: Path) -> None:
    path = study(tmp_path, web="min_window_size_px = [900, 500]")
    with serving(path, tmp_path) as served, browsing(size=(800, 400)) as sit_down:
        somebody = sit_down(f"http://127.0.0.1:{served.port}/#t={served.tokens[0]}")
        somebody.until("s.finished")
        assert "900 by 500" in somebody.screen()
        with somebody.page.expect_navigation():
            somebody.page.set_viewport_size({"width": 1000, "height": 600})
        holds(somebody.page, "minihuman.state.welcomed")


def test_who_is_turned_away_with_a_code_has_a_link_back(tmp_path: Path) -> None:
    back = "https://recruiting.example/done?cc={code}"
    web = f'allowed_browsers = ["firefox"]\nredirect = "{back}"\ncodes = {{ screened_out = "S3" }}'
    with serving(study(tmp_path, web=web), tmp_path) as served, browsing() as sit_down:
        somebody = sit_down(f"http://127.0.0.1:{served.port}/#t={served.tokens[0]}")
        somebody.until("s.finished")
        assert somebody.page.get_attribute("#screen a", "href") == back.replace("{code}", "S3")


EXAMPLE = """
[[pages]]
name = "how"
text = "Find the green square."
example = { world = "minihuman/MiniGrid-Empty-5x5-v0", marks = { agent = "this is you", "green goal" = "go to this" } }
"""
BOXES = """() => {
  const box = (one) => { const { left, top, right, bottom } = one.getBoundingClientRect();
    return [left, top, right, bottom]; };
  const all = (what) => [...document.querySelectorAll(`.example ${what}`)].map(box);
  return { picture: all('canvas')[0], points: all('.point'), labels: all('.label') };
}"""
NAMED = {"agent": (1, 1), "goal": (3, 3)}  # the cells, of five by five


@pytest.mark.nightly(by_day=["768-lines"])
@pytest.mark.parametrize("size", [(1366, 768), (3840, 2160), (390, 844)], ids=["768-lines", "4K", "phone"])
def test_the_marks_of_an_example_point_at_what_they_name_and_cover_none_of_it(
    tmp_path: Path, size: tuple[int, int]
) -> None:
    path = study(tmp_path, more=EXAMPLE)
    path.write_text(path.read_text().replace('blocks = ["tried"]', 'parts = ["how", "tried"]'))
    with serving(path, tmp_path) as served, browsing(size=size) as sit_down:
        somebody = sit_down(f"http://127.0.0.1:{served.port}/#t={served.tokens[0]}")
        somebody.page.locator(".example .label").nth(1).wait_for()
        boxes = somebody.page.evaluate(BOXES)
    left, top, right, bottom = boxes["picture"]
    cell = (right - left) / 5
    cells = [(left + x * cell, top + y * cell, left + (x + 1) * cell, top + (y + 1) * cell) for x, y in NAMED.values()]
    for (x0, y0, x1, y1), (cell_x0, cell_y0, cell_x1, cell_y1) in zip(boxes["points"], cells, strict=True):
        assert (x0 + x1) / 2 == pytest.approx((cell_x0 + cell_x1) / 2, abs=2)
        assert (y0 + y1) / 2 == pytest.approx((cell_y0 + cell_y1) / 2, abs=2)
        assert x1 - x0 < cell / 3, "the point covers what it marks"
        assert left <= x0 < x1 <= right
        assert top <= y0 < y1 <= bottom
    for label, own in zip(boxes["labels"], cells, strict=True):
        assert label[0] >= 0
        assert label[2] <= size[0], "the words are cut off"
        assert (label[1] + label[3]) / 2 == pytest.approx((own[1] + own[3]) / 2, abs=2)
        covered = [
            one for one in cells if label[0] < one[2] and one[0] < label[2] and label[1] < one[3] and one[1] < label[3]
        ]
        assert covered == []


def test_where_a_browser_blocks_site_data_the_study_is_played_all_the_same(tmp_path: Path) -> None:
    with serving(study(tmp_path, max_steps=9), tmp_path) as served, browsing() as sit_down:
        somebody = sit_down("about:blank")
        somebody.page.add_init_script(
            "for (const name of ['sessionStorage', 'indexedDB']) Object.defineProperty(window, name, "
            "{ get() { throw new DOMException('blocked', 'SecurityError'); } });"
        )
        somebody.page.goto(f"http://127.0.0.1:{served.port}/#t={served.tokens[0]}")
        somebody.until("s.welcomed && s.kind === 'text'")
        assert somebody.errors == []
        somebody.to_play()
        somebody.press("1", "2")
        somebody.until("s.confirmed === 2 && s.unsafe === 0")
        assert set(somebody.errors) == {"blocked"}  # of what counts the keys here


@pytest.mark.nightly
@pytest.mark.parametrize("was_welcomed", [False, True])
def test_another_link_in_a_tab_that_waits_for_its_welcome_lets_the_next_participant_in(
    tmp_path: Path, was_welcomed: bool
) -> None:
    """The tab's first link is left while its welcome is on the way, for the first time or again."""
    with (
        serving(study(tmp_path, max_steps=9), tmp_path, links=2) as served,
        line(served.port, rtt_ms=0) as wire,
        browsing() as sit_down,
    ):
        address = f"http://127.0.0.1:{wire.port}/#t="
        somebody = sit_down(address + (served.tokens[0] if was_welcomed else "none"))
        if was_welcomed:
            somebody.to_play()
            somebody.press("1", "2")
            somebody.until("s.unsafe === 0 && s.step === 2")
        wire.one_way_s = 1.0  # a socket opens two seconds after the page is there, and is welcomed two later
        if was_welcomed:
            somebody.page.reload(wait_until="commit")
        else:
            with somebody.page.expect_event("load"):
                somebody.page.evaluate(f"location.hash = 't={served.tokens[0]}'")
        holds(somebody.page, "true")
        assert not somebody.state["welcomed"], "the welcome was not delayed"
        with somebody.page.expect_event("load"):
            somebody.page.evaluate(f"location.hash = 't={served.tokens[1]}'")
        wire.one_way_s = 0.0
        somebody.until("s.welcomed && s.kind === 'text'")
        assert len(list(tmp_path.glob("tried/sub-*"))) >= 1 + was_welcomed
        with somebody.page.expect_event("load"):
            somebody.page.evaluate(f"location.hash = 't={served.tokens[0]}'")
        somebody.until("s.welcomed && " + ("s.step === 2" if was_welcomed else "s.kind === 'text'"))
        assert len(list(tmp_path.glob("tried/sub-*"))) == 2
        assert somebody.errors == []
