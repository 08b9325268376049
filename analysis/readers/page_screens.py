"""Take ten screens of two builds, so that new readers compare the page that participants see before and after a change.

python analysis/readers/page_screens.py FOLDER --before CHECKOUT --seed 20261130

CHECKOUT is another checkout of this repository with an environment in `.venv`. Both builds serve the same protocols;
one browser of one size goes to the same screen of each. `pairs/NN.png` has the two side by side, in an order drawn by
the seed; `key.json` has the answers, and is not shown to readers. `README.md` has their prompt. It needs Chromium and
Playwright, as the tests of the page do.
"""

import argparse
import json
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from PIL import Image
from playwright.sync_api import Browser, Page, sync_playwright

ROOT = Path(__file__).parents[2]
SEED = 20261130
DESKTOP_PX = (1024, 640)
PHONE_PX = (390, 844)
GAP_PX = 24
MOST_KEYS = 400
KEY_WAIT_MS = 150

HEAD = """
[study]
name = "screens"
version = "1"
seed = 4
language = "{language}"
{consent}
closing = "Thank you for taking part."
[keys]
pool = {pool}
keyboard_check = false
[web]
require_keyboard = false
completion_codes = {{ complete = "C1A2B3" }}
[[groups]]
name = "all"
parts = {parts}
"""
CONSENT = '''consent = """
You will walk through four rooms on the screen and look for a green square, by pressing keys. We record which keys you \
press and when. We do not record your name: your data are kept under a code.

Taking part is voluntary: you may stop at any time, without giving a reason, by pressing Escape."""'''
PAGE = '''
[[pages]]
name = "how"
title = "How it works"
text = """
You see four rooms from above. The red triangle is you.

Find the green square in as few steps as you can. Each episode begins somewhere else."""
example = { world = "minihuman/MiniGrid-FourRooms-v0", marks = { agent = "this is you", "green goal" = "find this" } }
'''
ROOMS = """
[[blocks]]
name = "rooms"
world = "minihuman/MiniGrid-FourRooms-v0"
episodes = 1
actions = ["left", "right", "forward"]
max_steps = 40
key_map = "fixed"
fixed_keys = { left = "left", right = "right", up = "forward" }
show_keys = true
mission = "Find the green square"
"""
TEXT_QUESTION = """
[[questions]]
name = "ask"
title = "About the task"
items = [{ name = "why", kind = "text", ask = "How did you look for the square?" }]
"""
LIKERT = """
[[questions]]
name = "ask"
title = "About the task"
items = [{ name = "hard", kind = "likert", ask = "How hard was it to find the square?", points = 7, \
low = "not at all", high = "very hard" }]
"""
QUESTIONNAIRE = """
[[questions]]
name = "ask"
title = "About you"
items = [
  { name = "games", kind = "choice", ask = "How often do you play computer games?", \
options = ["Never", "A few times a year", "Every month", "Every week", "Every day"] },
  { name = "age", kind = "number", ask = "How old are you?", minimum = 18, maximum = 99 },
]
"""
TEAM = """
[[blocks]]
name = "kitchen"
kind = "team"
world = "minihuman/Team-CrampedRoom-v0"
episodes = 1
actions = ["up", "down", "left", "right", "interact"]
max_steps = 200
pace = "real_time"
step_period_ms = 150
key_map = "fixed"
fixed_keys = { up = "up", down = "down", left = "left", right = "right", space = "interact" }
show_keys = true
view = "full"
[blocks.team]
seats = ["person", "person"]
pairing = "drawn"
lobby_s = 180.0
partner_wait_s = 15.0
partner_disclosure = "debrief"
"""
STROOP = """
[[blocks]]
name = "stroop"
kind = "trials"
world = "minihuman/Stimulus-v0"
options = { responses = ["red", "green", "blue"] }
stimuli.file = "stroop.csv"
episodes = 1
actions = ["red", "green", "blue"]
key_map = "fixed"
fixed_keys = { 1 = "red", 2 = "green", 3 = "blue" }
show_keys = true
noop_action = "none"
response_deadline_ms = 60000
max_steps = 1
ready = "first"
fixation_ms = 500
"""
STIMULI = "text,colour,correct,times\nGREEN,#e8503c,red,1\n"
BROKEN = """
[[blocks]]
name = "broken"
world = "broken_world:Broken-v0"
episodes = 1
actions = ["0", "1"]
max_steps = 300
key_map = "fixed"
fixed_keys = { left = "0", right = "1" }
"""
BROKEN_WORLD = '''
import gymnasium
import numpy as np


class Broken(gymnasium.Env):
    """A world whose step fails."""

    metadata = {"render_modes": ["rgb_array"], "render_fps": 10}
    action_space = gymnasium.spaces.Discrete(2)
    observation_space = gymnasium.spaces.Box(0, 255, (64, 64, 3), np.uint8)

    def __init__(self, render_mode=None):
        self.render_mode = render_mode

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.steps = 0
        return self.render(), {}

    def step(self, action):
        self.steps += 1
        if self.steps == 150:  # more than the steps that are tried before a session
            raise KeyError("door_3")
        return self.render(), 0.0, False, False, {}

    def render(self):
        return np.full((64, 64, 3), 90, np.uint8)


gymnasium.register("Broken-v0", Broken)
'''


class Scene(NamedTuple):
    """A screen: the protocol that has it, how a participant gets there, and how it is recognised."""

    name: str
    parts: tuple[str, ...]
    blocks: str
    reach: Callable[[Page], None]
    language: str = "en"
    consent: str = ""
    pool: tuple[str, ...] = ("left", "right", "up")
    is_phone: bool = False

    def write(self, folder: Path) -> Path:
        """Write the protocol and what it reads; return its path."""
        lists = {"parts": json.dumps(list(self.parts)), "pool": json.dumps(list(self.pool))}
        text = HEAD.format(language=self.language, consent=self.consent, **lists) + self.blocks
        path = folder / "screens.toml"
        path.write_text(text, encoding="utf-8")
        (folder / "stroop.csv").write_text(STIMULI, encoding="utf-8")
        (folder / "broken_world.py").write_text(BROKEN_WORLD, encoding="utf-8")
        return path


def go_on_until(condition: str, *, key: str = "Enter", wait_ms: int = KEY_WAIT_MS) -> Callable[[Page], None]:
    """Return what presses a key until a JavaScript condition of the page holds."""

    def reach(page: Page) -> None:
        for _ in range(MOST_KEYS):
            if page.evaluate(f"() => Boolean({condition})"):
                return
            page.keyboard.press(key)
            page.wait_for_timeout(wait_ms)
        raise RuntimeError(f"never {condition}: the page says {page.inner_text('#screen')!r}")

    return reach


def tap_until(condition: str) -> Callable[[Page], None]:
    """Return what taps the screen's button until a JavaScript condition of the page holds."""

    def reach(page: Page) -> None:
        for _ in range(MOST_KEYS):
            if page.evaluate(f"() => Boolean({condition})"):
                return
            button = page.locator("main button, #touch button:visible").first
            if button.count():
                button.tap()
            page.wait_for_timeout(KEY_WAIT_MS)
        raise RuntimeError(f"never {condition}: the page says {page.inner_text('#screen')!r}")

    return reach


def then(*acts: Callable[[Page], None]) -> Callable[[Page], None]:
    """Return what does one act after another."""

    def reach(page: Page) -> None:
        for act in acts:
            act(page)

    return reach


def press(*keys: str) -> Callable[[Page], None]:
    """Return what presses keys one after another."""

    def reach(page: Page) -> None:
        for key in keys:
            page.keyboard.press(key)
            page.wait_for_timeout(2 * KEY_WAIT_MS)

    return reach


def write_text(words: str) -> Callable[[Page], None]:
    """Return what types words into the field that has the focus."""
    return lambda page: page.keyboard.type(words, delay=15)


IN_PLAY = "minihuman.state.playing && minihuman.state.known && minihuman.state.step >= 0"
IS_OVER = "minihuman.state.finished"
IS_SCALE = "document.querySelector('.points')"
IN_LOBBY = "document.body.innerText.includes('Waiting for the others')"
ARROWS = ("left", "right", "up", "down")
SCENES = (
    Scene("consent", ("rooms",), ROOMS, go_on_until("minihuman.state.kind === 'page'"), consent=CONSENT),
    Scene("instructions", ("how",), PAGE, go_on_until("document.querySelector('.example')")),
    Scene(
        "text question",
        ("ask",),
        TEXT_QUESTION,
        then(
            go_on_until("document.querySelector('.entry')"),
            write_text("I walked along the walls until I saw a gap, then I looked into the next room."),
        ),
    ),
    Scene(
        "questionnaire", ("ask",), QUESTIONNAIRE, then(go_on_until("document.querySelector('.options')"), press("3"))
    ),
    Scene("episode", ("rooms",), ROOMS, then(go_on_until(IN_PLAY), press("ArrowLeft", "ArrowUp"))),
    Scene("phone", ("rooms",), ROOMS.replace("Find the green square", ""), tap_until(IN_PLAY), "ar", is_phone=True),
    Scene("waiting for a partner", ("kitchen",), TEAM, go_on_until(IN_LOBBY), pool=(*ARROWS, "space")),
    Scene("trial", ("stroop",), STROOP, go_on_until(IN_PLAY), pool=("1", "2", "3")),
    Scene("end", ("ask",), LIKERT, then(go_on_until(IS_SCALE), press("5"), go_on_until(IS_OVER))),
    Scene("error", ("broken",), BROKEN, then(go_on_until(IN_PLAY), go_on_until(IS_OVER, key="ArrowLeft", wait_ms=40))),
)


@contextmanager
def serve(python: Path, checkout: Path, protocol: Path) -> Iterator[str]:
    """Serve a protocol by a build, as long as this lasts; yield a participant's link."""
    command = [str(python), "-m", "minihuman", "serve", str(protocol), "--port", "0", "--trust"]
    environment = {**os.environ, "PYTHONPATH": str(checkout)}
    options = ["--data", str(protocol.parent / "data"), "--links", "1"]
    with subprocess.Popen(
        command + options, cwd=protocol.parent, env=environment, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        try:
            yield next(match[0] for line in process.stdout if (match := re.search(r"http://\S+#t=\S+", line)))
        finally:
            process.kill()


def take_picture(browser: Browser, address: str, scene: Scene, path: Path) -> None:
    """Go to a scene of a served study, and take its picture."""
    width, height = PHONE_PX if scene.is_phone else DESKTOP_PX
    options: dict[str, Any] = {"has_touch": True, "is_mobile": True} if scene.is_phone else {}
    context = browser.new_context(viewport={"width": width, "height": height}, **options)
    page = context.new_page()
    page.goto(address)
    page.locator("main :first-child").first.wait_for()
    page.wait_for_timeout(4 * KEY_WAIT_MS)
    scene.reach(page)
    page.wait_for_timeout(4 * KEY_WAIT_MS)
    page.screenshot(path=path)
    context.close()


def join_pictures(left: Path, right: Path, path: Path) -> None:
    """Write two pictures side by side, at their size."""
    with Image.open(left) as first, Image.open(right) as second:
        pair = Image.new("RGB", (first.width + GAP_PX + second.width, max(first.height, second.height)), "white")
        pair.paste(first.convert("RGB"), (0, 0))
        pair.paste(second.convert("RGB"), (first.width + GAP_PX, 0))
    pair.save(path)


def make_pairs(folder: Path, before: Path, seed: int) -> None:
    """Take every scene of both builds; write the pairs and the key."""
    builds = {"before": (before / ".venv/bin/python", before), "after": (Path(sys.executable), ROOT)}
    rng = random.Random(seed)
    for name in ("before", "after", "pairs"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    key = {}
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        for number, scene in enumerate(rng.sample(SCENES, len(SCENES)), 1):
            pictures = {name: folder / name / f"{number:02}.png" for name in builds}
            for name, (python, checkout) in builds.items():
                with tempfile.TemporaryDirectory() as work, serve(python, checkout, scene.write(Path(work))) as address:
                    take_picture(browser, address, scene, pictures[name])
            order = rng.sample(list(builds), 2)
            join_pictures(*(pictures[name] for name in order), folder / "pairs" / f"{number:02}.png")
            key[f"{number:02}"] = {"screen": scene.name, "left": order[0], "right": order[1]}
        browser.close()
    (folder / "key.json").write_text(json.dumps(key, indent=1) + "\n", encoding="utf-8")


def main() -> None:
    """Take the pictures into a folder."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--before", type=Path, required=True, help="The checkout of the other build, with a .venv.")
    parser.add_argument("--seed", type=int, default=SEED)
    arguments = parser.parse_args()
    make_pairs(arguments.folder, arguments.before.resolve(), arguments.seed)


if __name__ == "__main__":
    main()
