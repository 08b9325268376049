"""Take pictures of the builder for new readers, who say what they would click, in an order drawn by a seed.

python analysis/readers/builder_steps.py FOLDER --seed 20261129

It writes `step-NN.png` and `questions.txt`, of which a reader gets all and nothing else, and `key.json` with what is
right: the name of the control and its place in the picture. A reader answers "NN: what I would click" for each step;
the first guess counts. It needs Chromium and Playwright, as the tests of the page do.
"""

import argparse
import json
import random
import runpy
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from playwright.sync_api import Locator, Page, sync_playwright

ROOT = Path(__file__).parents[2]
SIZE = {"width": 1440, "height": 1000}
SEED = 20261129
QUESTION = "You see the page in step-{number:02}.png. {goal} What would you click first? Name one thing that you see."


class Step(NamedTuple):
    """What a reader wants, on which view, and the control that is right."""

    view: str
    goal: str
    right: Callable[[Page], Locator]


def button(name: str) -> Callable[[Page], Locator]:
    """Return what finds a button by its name."""
    return lambda page: page.get_by_role("button", name=name, exact=True)


def link(name: str) -> Callable[[Page], Locator]:
    """Return what finds a link by its name."""
    return lambda page: page.get_by_role("link", name=name, exact=True)


def label(name: str) -> Callable[[Page], Locator]:
    """Return what finds a field by its label."""
    return lambda page: page.get_by_label(name, exact=True)


STEPS = (
    Step("home", "You want to begin with a study of two groups.", button("Copy two groups")),
    Step(
        "home",
        "A colleague has sent you a folder with a study. You want to have it here.",
        label("Import a colleague's folder"),
    ),
    Step("home", "You look for studies in which people play together.", button("team")),
    Step("parts", "After the last world, participants shall answer questions.", button("Add a part to everyone")),
    Step(
        "parts", "Half of the participants shall see the keys on the screen, the others not.", button("+ Add a group")
    ),
    Step("parts", "Participants shall come back a week later.", button("+ Add a day")),
    Step("parts", "You want to play your study yourself, as a participant would.", link("Try the study")),
    Step(
        "parts",
        "You want to know what the report will look like, before anybody has taken part.",
        button("Simulate 20 people"),
    ),
    Step("parts", "You need the study in French, too.", link("Texts")),
    Step("parts", "The data protection officer asks for a page about what you record.", link("Settings")),
    Step("part", "There shall be eight rounds instead of five.", label("Episodes *")),
    Step("part", "You want to see how the part looks on a telephone.", button("Phone")),
    Step(
        "part",
        "Participants shall walk in a room of your own design.",
        lambda page: page.get_by_role("button").filter(has_text="MiniGrid-FourRooms"),
    ),
    Step("part", "What you changed last was a mistake.", button("Undo")),
    Step("level", "There shall be a key in the room.", button("key")),
    Step(
        "trial",
        "The mask shall stay 100 ms longer.",
        lambda page: page.get_by_label("Length of mask"),
    ),
    Step("trial", "Behind the last stimulus, a tone shall be heard.", button("Add a sound")),
    Step("data", "You want to see what the first participant did.", button("Details of sub-01, session 1")),
    Step("session", "You want to see the participant walk.", button("Play")),
    Step(
        "session",
        "The participant writes that they want their data deleted.",
        lambda page: page.get_by_label("Withdraw:", exact=False),
    ),
    Step(
        "session",
        "A telephone rang during this session; it shall not count.",
        lambda page: page.get_by_label("Reason", exact=True),
    ),
    Step("data", "You need the data as a table for another program.", button("Export")),
)


def open_view(page: Page, address: str, view: str) -> None:
    """Show a view of the builder, and wait until it is whole."""
    places = {
        "home": "",
        "parts": "#/study/plan.toml",
        "part": "#/study/plan.toml/parts/play",
        "level": "#/study/level.toml/parts/play",
        "trial": "#/study/priming%2Fpriming.toml/parts/priming",
        "data": "#/study/rooms.toml/data",
        "session": "#/study/rooms.toml/data",
    }
    awaited = {
        "home": "section.gallery img",
        "parts": ".overview",
        "part": ".part-form .field",
        "level": ".cells-grid",
        "trial": ".track",
        "data": ".listing",
        "session": ".listing",
    }
    page.goto("about:blank")
    page.goto(address + places[view])
    page.locator(awaited[view]).first.wait_for()
    if view == "session":
        page.get_by_role("button", name="Details of sub-01, session 1").click()
        page.locator(".seen").wait_for()
    page.wait_for_load_state("networkidle")


def take_steps(page: Page, address: str, out: Path, seed: int) -> None:
    """Take the pictures in a random order, and write the questions and the key."""
    steps = random.Random(seed).sample(STEPS, len(STEPS))
    questions = []
    key = {}
    for number, step in enumerate(steps, 1):
        open_view(page, address, step.view)
        right = step.right(page).first
        right.scroll_into_view_if_needed()
        page.screenshot(path=out / f"step-{number:02}.png")
        questions.append(QUESTION.format(number=number, goal=step.goal))
        control = right.get_attribute("aria-label") or right.inner_text().strip()
        key[f"{number:02}"] = {"view": step.view, "goal": step.goal, "control": control, "box_px": right.bounding_box()}
    (out / "questions.txt").write_text("\n".join(questions) + "\n", encoding="utf-8")
    (out / "key.json").write_text(json.dumps(key, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def make_studies(folder: Path) -> None:
    """Make the studies that the pictures show."""
    from minihuman.builder.messages import NewStudyRequest
    from minihuman.builder.new_study import make_study

    for name, template in (
        ("plan", "one-world"),
        ("rooms", "one-world"),
        ("level", "one-world"),
        ("priming", "trials/priming"),
    ):
        make_study(NewStudyRequest(name, template=template), folder, None)
    drawn = (folder / "level.toml").read_text(encoding="utf-8")
    drawn = drawn.replace('world = "minihuman/MiniGrid-FourRooms-v0"', 'world = "minihuman/Level-v0"')
    (folder / "level.toml").write_text(drawn, encoding="utf-8")
    command = [sys.executable, "-m", "minihuman", "simulate", "rooms.toml", "--participants=2", "--data=sessions"]
    subprocess.run(command, cwd=folder, check=True, stdout=subprocess.DEVNULL)


def main() -> None:
    """Take the pictures into a folder."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=SEED)
    arguments = parser.parse_args()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    serve_desk = runpy.run_path(str(ROOT / "docs" / "builder_pictures.py"))["serve_desk"]
    with tempfile.TemporaryDirectory() as temporary, sync_playwright() as playwright:
        folder = Path(temporary) / "studies"
        folder.mkdir()
        make_studies(folder)
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        with serve_desk(folder) as address:
            take_steps(browser.new_page(viewport=SIZE), address, arguments.folder, arguments.seed)
        browser.close()


if __name__ == "__main__":
    main()
