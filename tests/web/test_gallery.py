"""The live gallery in Chromium, from a static server: its pictures are those of Python, and axe finds nothing."""

import functools
import runpy
import sys
import threading
from collections.abc import Iterator
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from importlib import import_module
from pathlib import Path

import gymnasium
import numpy as np
import pytest

import minihuman  # noqa: F401  # registers the worlds
from minihuman.worlds.catalogue import WORLDS
from tests.counts import PATIENCE_S, count
from tests.machine import needs
from tests.web.browser import Somebody, browsing
from tests.web.test_accessible import serious
from tests.web.test_computed import picture_of

pytestmark = [pytest.mark.program, needs("chromium")]
FOREIGN = ("MiniGrid-GoToObj-Transfer-v0", "Level-v0", "Rules-v0")  # Python rules; drawn in the editor; no module
WRITTEN = [entry for entry in WORLDS if entry.name not in FOREIGN]
PLAYED = WRITTEN[:: count(9, 1)]  # 25 of the 217
ROOT = Path(__file__).parents[2]
SEED, KEYS = 1, ["ArrowUp", "ArrowRight", "ArrowUp", "ArrowLeft", "ArrowUp"]
ACTIONS = {
    "ArrowUp": ("forward", "move_forward"),
    "ArrowRight": ("right", "turn_right"),
    "ArrowLeft": ("left", "turn_left"),
}


class _Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Of a static server of a gallery of two seeds a world."""
    folder = tmp_path_factory.mktemp("play")
    sys.path.insert(0, str(ROOT / "docs"))
    try:
        assert import_module("gallery_live").write_gallery(folder, 2, [entry.name for entry in PLAYED]) == len(PLAYED)
    finally:
        sys.path.pop(0)
    server = ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(_Quiet, directory=str(folder)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_address[1]}/"
    server.shutdown()


def test_a_level_is_drawn_played_opened_by_its_link_and_saved(address: str) -> None:
    draw_level = runpy.run_path(str(ROOT / "docs/check_play.py"))["draw_level"]
    with browsing() as sit_down:
        somebody = sit_down("about:blank")
        draw_level(somebody.page, address.rstrip("/"))
        assert somebody.errors == []


def test_the_arrow_keys_play_after_a_click_on_a_button_and_leave_text_fields_alone(address: str) -> None:
    with browsing() as sit_down:
        somebody = sit_down("about:blank")
        _choose(somebody, address, next(entry.name for entry in PLAYED if "MiniGrid" in entry.id))
        somebody.page.get_by_text("Show the state").click()
        somebody.page.get_by_role("button", name="New seed").click()
        somebody.page.keyboard.press("ArrowLeft")
        somebody.page.wait_for_function("document.querySelector('#state').innerText.startsWith('step 1')")
        somebody.page.goto(f"{address}editor.html")
        somebody.page.locator("body[data-ready]").wait_for()
        somebody.page.get_by_role("button", name="Play").click()
        somebody.page.locator("#words").press("End")
        somebody.page.locator("#words").press_sequentially(" p d")
        assert somebody.page.locator("#words").input_value().endswith(" p d")
        assert somebody.errors == []


def _choose(somebody: Somebody, address: str, name: str) -> None:
    somebody.page.goto("about:blank")
    somebody.page.goto(f"{address}index.html#{name}/{SEED}")
    somebody.page.wait_for_selector("body[data-ready]", timeout=PATIENCE_S * 1000)


@pytest.mark.nightly(sample=True)
def test_every_world_plays_from_static_files_as_in_python(address: str) -> None:
    assert len(WRITTEN) == 217
    with browsing() as sit_down:
        somebody = sit_down("about:blank")
        for entry in PLAYED:
            first_person = "MiniWorld" in entry.id
            env = gymnasium.make(entry.id, **({"trig": 1} if first_person else {})).unwrapped
            env.reset(seed=SEED)
            _choose(somebody, address, entry.name)
            over = False
            for key in KEYS:
                somebody.page.keyboard.press(key)
                action = next((one for one in ACTIONS[key] if one in env.action_names), None)
                if action is not None and not over:
                    *_, terminated, truncated, _ = env.step(env.action_names.index(action))
                    over = terminated or truncated
            if first_person:
                right = env.picture(size_px=(640, 480))
            else:
                side = env.image_shape[0]
                right = env.picture(view="partial", size_px=(32 * side, 32 * side))
            assert np.array_equal(picture_of(somebody, "#view"), right), entry.id
        assert somebody.errors == []


@pytest.mark.nightly(by_day=["MiniGrid-Empty-5x5-v0-phone", "MiniWorld-MazeS2-v0-desk"])
@pytest.mark.parametrize("size", [(1366, 768), (390, 844)], ids=["desk", "phone"])
@pytest.mark.parametrize(
    "name", [next(entry.name for entry in PLAYED if kind in entry.name) for kind in ("MiniGrid", "MiniWorld")]
)
def test_the_gallery_has_no_serious_finding_and_fits(address: str, name: str, size: tuple[int, int]) -> None:
    with browsing(size=size) as sit_down:
        somebody = sit_down("about:blank")
        _choose(somebody, address, name)
        assert serious(somebody.page) == []
        assert not somebody.page.evaluate("document.documentElement.scrollWidth > innerWidth")
        somebody.page.get_by_role("button", name="forward").click()
        somebody.page.get_by_text("Show the state").click()
        somebody.page.wait_for_function("document.querySelector('#state').innerText.startsWith('step 1')")
        somebody.page.get_by_role("button", name="New seed").click()
        following = 0 if "MiniWorld" in name else SEED + 1  # two seeds of a first-person world are packed
        somebody.page.wait_for_function(f"location.hash.endsWith('/{following}')")
        assert somebody.errors == []
