"""Nothing that a person did is lost or doubled, whatever is cut or killed. The night does it a hundred times."""

import time
from pathlib import Path

import pytest

from minihuman.admin.verify.log import find_log_differences
from minihuman.experiment.machine.events import Noted, Stepped
from minihuman.experiment.replay import BROWSER_NOTE
from minihuman.log.read.session_reader import read_events
from minihuman.worlds.adapters.world import World
from tests.counts import count
from tests.machine import needs
from tests.web.browser import PATIENCE_MS, browsing, browsing_with_profile
from tests.web.interrupted import interrupt
from tests.web.protocols import FIRST_PERSON, GRID, study
from tests.web.serving import line, serving

pytestmark = needs("chromium")

CODES = {"Digit1": "1", "Digit2": "2", "Digit3": "3", "Enter": "enter"}

HIGHEST = """() => {
  globalThis.highest = 0;
  setInterval(() => { highest = Math.max(highest, minihuman.state.step); }, 1);
}"""  # step that was shown


@pytest.mark.nightly(by_day=["0-page"])
@pytest.mark.program
@pytest.mark.parametrize("computed", ["page", "server"])
@pytest.mark.parametrize("seed", range(count(1, 10)))
def test_cut_killed_and_loaded_again_each_press_is_logged_once_and_the_log_is_proven(
    tmp_path: Path, seed: int, computed: str
) -> None:
    found = interrupt(tmp_path, times=count(4, 10), seed=seed, computed=computed)
    assert found.logged == [CODES[code] for code in found.heard]
    assert found.steps == found.accepted
    assert found.complaints == []
    assert found.notes == []
    assert found.segments == 1


@pytest.mark.nightly
@pytest.mark.program
@pytest.mark.parametrize(
    ("kind", "full", "world"),
    [("cut", 200, FIRST_PERSON), ("kill", 50, GRID), ("reload", 50, GRID), ("sleep", 20, GRID)],
)
def test_interrupted_in_one_way_over_and_over_no_press_is_lost(
    tmp_path: Path, kind: str, full: int, world: tuple[str, tuple[str, ...]]
) -> None:
    """The line is cut, the server killed, the page loaded again, the laptop closed; keys are pressed all the while."""
    times = count(3, full)
    found = interrupt(tmp_path, times=times, seed=27, world=world, kinds=(kind,))
    print(f"{found.happened}: {len(found.heard)} presses, {found.steps} steps")
    assert found.happened == {kind: times}
    assert found.logged == [CODES[code] for code in found.heard]
    assert found.steps == found.accepted > 5 * times
    assert found.complaints == []
    assert found.notes == []


TELLS_COMMITTED = """
const put = IDBObjectStore.prototype.put;
IDBObjectStore.prototype.put = function (text, key) {
  const { what } = JSON.parse(text);
  if (what?.t === "key" && what.down) this.transaction.addEventListener("complete", () => committed(what.key));
  return put.call(this, text, key);
};
"""


@pytest.mark.nightly(by_day=["between keys"])
@pytest.mark.program
@pytest.mark.parametrize("waits_ms", [500, 0], ids=["at rest", "between keys"])
def test_a_browser_that_is_killed_loses_no_press_that_it_had_committed(tmp_path: Path, waits_ms: int) -> None:
    """The tab's own storage goes with the browser; what IndexedDB has is taken up when the link is opened again."""
    lost, committed = [], list[str]()
    for number in range(count(1, 20)):
        folder = tmp_path / str(number)
        folder.mkdir()
        with serving(study(folder, max_steps=60), folder) as served, line(served.port) as wire:
            link = f"http://127.0.0.1:{wire.port}/#t={served.tokens[0]}"
            with browsing_with_profile(folder / "profile") as (somebody, kill):
                committed.clear()
                somebody.page.expose_function("committed", lambda key: committed.append(key))
                somebody.page.add_init_script(TELLS_COMMITTED)
                somebody.page.goto(link)
                somebody.to_play()
                somebody.press("1", "2")
                somebody.until("s.unsafe === 0 && s.step === 2")
                wire.cut()
                somebody.press(*"1231231231")
                somebody.page.wait_for_timeout(waits_ms)
                until_s = time.monotonic() + PATIENCE_MS / 1000
                while waits_ms and sum(key in "123" for key in committed) < 12:  # at rest: all is committed
                    assert time.monotonic() < until_s, committed
                    somebody.page.wait_for_timeout(10)
                known = sum(key in "123" for key in committed)
                kill()
            wire.mend()
            with browsing_with_profile(folder / "profile") as (somebody, _):
                somebody.page.goto(link)
                somebody.until("s.welcomed && s.playing && s.unsafe === 0 && s.confirmed === s.step")
                lost.append(12 - somebody.state["step"])
                assert somebody.errors == []
            served.stop()
        [part] = folder.rglob("*.mcap.part")
        events = list(read_events(part))
        steps = [event for event in events if isinstance(event, Stepped)]
        assert [step.step for step in steps] == list(range(1, 13 - lost[-1]))
        assert known > 0
        assert lost[-1] <= 12 - known, "one that the page knew to be committed was lost"
        assert [event.text for event in events if isinstance(event, Noted) and event.kind == BROWSER_NOTE] == []
        assert list(find_log_differences(part, World)) == []
    print(
        f"presses lost by killed browsers: {sum(lost)} of {10 * len(lost)} that no server had; most at once {max(lost)}"
    )
    assert waits_ms == 0 or not any(lost), lost


@pytest.mark.program
def test_presses_on_the_disk_of_a_server_that_was_killed_before_it_could_say_so_are_shown_once(tmp_path: Path) -> None:
    with (
        serving(study(tmp_path, max_steps=12), tmp_path) as served,
        line(served.port) as wire,
        browsing() as sit_down,
    ):
        somebody = sit_down(f"http://127.0.0.1:{wire.port}/#t={served.tokens[0]}")
        somebody.to_play()
        somebody.press("1", "2")
        somebody.until("s.unsafe === 0 && s.step === 2")
        wire.deaf = True
        somebody.press("1", "2", "3", "1")
        [part] = tmp_path.rglob("*.mcap.part")
        until_s = time.monotonic() + PATIENCE_MS / 1000
        while sum(isinstance(event, Stepped) for event in read_events(part)) < 6:
            assert time.monotonic() < until_s
            time.sleep(0.1)
        somebody.page.evaluate(HIGHEST)
        served.kill()
        wire.cut()
        wire.deaf = False
        served.again()
        wire.mend()
        somebody.until("s.welcomed && s.unsafe === 0 && s.confirmed === 6 && s.step === 6")
        somebody.page.wait_for_timeout(500)
        assert somebody.page.evaluate("highest") == 6, "it was shown further than they went"
        somebody.press("2")
        somebody.until("s.unsafe === 0 && s.confirmed === 7")
        assert somebody.errors == []
        served.stop()
    events = list(read_events(part))
    assert [event.text for event in events if isinstance(event, Noted) and event.kind == BROWSER_NOTE] == []
    assert sum(isinstance(event, Stepped) for event in events) == 7
