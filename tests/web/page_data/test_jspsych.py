"""The jsPsych 8 plugin in Chromium, played by real key events; its data come home. jsPsych itself comes from npm."""

import functools
import json
import runpy
import subprocess
import threading
from collections.abc import Iterator
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import quote

import gymnasium
import pytest

import minihuman
from tests.counts import PATIENCE_S, count
from tests.machine import needs
from tests.web.browser import Somebody, browsing

pytestmark = [pytest.mark.program, pytest.mark.nightly, needs("chromium")]
ROOT = Path(__file__).parents[3]
JSPSYCH = "jspsych@8.3.0"
PLAYED = ["MiniGrid-FourRooms-v0", "MiniGrid-DoorKey-8x8-v0", "BabyAI-GoToLocal-v0"]
EPISODES = count(3, 500)
ACTIONS = ("left", "right", "forward", "pickup", "drop", "toggle")
PAGE = """<!doctype html><meta charset="utf-8"><title>study</title>
<link rel="stylesheet" href="node_modules/jspsych/css/jspsych.css"><body></body>
<script src="node_modules/jspsych/dist/index.browser.min.js"></script>
<script type="module">
import Episode from "./minihuman/jspsych.js";
const { initJsPsych } = jsPsychModule;
const jsPsych = window.jsPsych = initJsPsych({ on_finish: () => { window.data = jsPsych.data.get().json(); } });
const settings = JSON.parse(decodeURIComponent(location.hash.slice(1)));
const timeline = settings.trials.map((trial) => ({ type: Episode, feedback_duration: 0, ...trial }));
window.running = settings.simulate ? jsPsych.simulate(timeline, settings.simulate) : jsPsych.run(timeline);
</script>"""


class _Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Of a static server with a page, jsPsych and the package."""
    folder = tmp_path_factory.mktemp("study")
    subprocess.run(["npm", "install", "--no-audit", "--no-fund", JSPSYCH], cwd=folder, check=True, timeout=PATIENCE_S)
    runpy.run_path(str(ROOT / "js/build.py"))["build_package"](folder / "minihuman", with_types=False)
    (folder / "index.html").write_text(PAGE)
    server = ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(_Quiet, directory=str(folder)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_address[1]}/"
    server.shutdown()
    server.server_close()


def _open(somebody: Somebody, address: str, **settings: Any) -> None:
    somebody.page.goto("about:blank")
    somebody.page.goto(f"{address}index.html#{quote(json.dumps(settings))}")


def _finished(somebody: Somebody) -> list[dict[str, Any]]:
    somebody.page.wait_for_function("window.data !== undefined", timeout=PATIENCE_S * 1000)
    trials: list[dict[str, Any]] = json.loads(somebody.page.evaluate("window.data"))
    return trials


def test_episodes_played_by_real_keys_come_home_without_a_difference(address: str, tmp_path: Path) -> None:
    trials = [
        {"world": PLAYED[n % 3], "seed": n // 3 % 100, "actions": ACTIONS, "keys": list("sdfjkl"), "view": "full"}
        for n in range(EPISODES)
    ]
    with browsing() as sit_down:
        somebody = sit_down("about:blank")
        _open(somebody, address, trials=trials)
        for number, trial in enumerate(trials):
            env = gymnasium.make(f"minihuman/{trial['world']}").unwrapped
            env.reset(seed=trial["seed"])
            path = [env.action_names[action] for action in env.shortest_path()]
            somebody.page.wait_for_function(
                f"jsPsych.getProgress().current_trial_global === {number} && document.querySelector('canvas')",
                timeout=PATIENCE_S * 1000,
            )
            keys = somebody.page.evaluate("document.querySelector('canvas').dataset.keys")
            key_of = {action: key for key, action in json.loads(keys).items()}
            for action in path:
                somebody.page.keyboard.press(key_of[action])
        (tmp_path / "p1.json").write_text(json.dumps(_finished(somebody)))
        assert somebody.errors == []
    (imported,) = minihuman.import_page_data(tmp_path / "p1.json", study=tmp_path / "online")
    assert imported.error is None
    assert imported.episodes == EPISODES
    log = minihuman.open_study(tmp_path / "online")["sub-01"]
    assert {episode.outcome for episode in log.episodes} == {"goal"}
    assert all(line.ok for line in minihuman.verify(tmp_path / "online"))


@pytest.mark.parametrize("mode", ["data-only", "visual"])
def test_simulated_trials_are_episodes_that_verify(address: str, tmp_path: Path, mode: str) -> None:
    trials = [{"world": PLAYED[0], "seed": 3, "max_steps": 20}, {"world": PLAYED[2], "seed": 4, "max_steps": 20}]
    with browsing() as sit_down:
        somebody = sit_down("about:blank")
        _open(somebody, address, trials=[*trials, trials[0] | {"key_map": "carry"}], simulate=mode)
        found = _finished(somebody)
        assert somebody.errors == []
    (tmp_path / "p1.json").write_text(json.dumps(found))
    assert [line.ok for line in minihuman.verify(tmp_path / "p1.json")] == [True, True]
    assert found[2]["key_map"] == found[1]["key_map"]
