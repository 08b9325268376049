"""Play the built site in a browser with real key events: two worlds, and a level that is drawn first.

Each check takes a page and the address of the folder that holds the gallery, and raises what Playwright raises where
the page does not answer as a player would expect. `check_site.py` runs all of them on a built site.
"""

import re
from collections.abc import Callable
from pathlib import Path

from playwright.sync_api import Browser, Error, FrameLocator, Page, Response, expect

PATIENCE_MS = 30_000
PICTURE = "canvas => canvas.toDataURL()"
DRAWN_LEVEL = """
WWWWWWWWWWWWWWWWWW
WW>>          GgWW
WWWWWWWWWWWWWWWWWW
WW              WW
WW              WW
WW      Kb      WW
WWWWWWWWWWWWWWWWWW
"""


def play_grid_world(page: Page, address: str) -> None:
    """Walk to the goal of a grid world in the frame of the page about playing, as a visitor of the site does."""
    page.goto(f"{address}/../play.html")
    frame = page.frame_locator("iframe")
    frame.locator("body[data-ready]").wait_for(timeout=PATIENCE_MS)
    frame.locator("#world").select_option("MiniGrid-Empty-5x5-v0")
    expect(frame.locator("#mission")).to_have_text("get to the green goal square")
    frame.locator("#whole").click()
    for key in ("ArrowUp", "ArrowUp", "ArrowRight", "ArrowUp"):
        _press(page, frame, key, pictures=("#whole", "#view"))
    page.keyboard.press("ArrowUp")
    expect(frame.locator("#outcome")).to_have_text("Success: reward 0.955 in 5 steps.")


def play_first_person_world(page: Page, address: str) -> None:
    """Walk and turn in a first-person world, then ask for another seed and walk on."""
    page.goto(f"{address}/index.html#MiniWorld-Hallway-v0/3")
    page.locator("body[data-ready]").wait_for(timeout=PATIENCE_MS)
    page.get_by_text("Show the state").click()
    for step, key in enumerate(("ArrowUp", "ArrowUp", "ArrowLeft", "ArrowUp"), 1):
        _press(page, page, key, pictures=("#view",))
        expect(page.locator("#state")).to_contain_text(f"step {step}\n")
    page.get_by_role("button", name="New seed").click()
    expect(page.locator("#state")).to_contain_text("step 0\n")
    _press(page, page, "ArrowUp", pictures=("#view",))
    expect(page.locator("#state")).to_contain_text("step 1\n")


def draw_level(page: Page, address: str) -> None:
    """Draw a level by pointer and by keys, play it, open its link again, and save it."""
    page.goto(f"{address}/editor.html")
    page.locator("body[data-ready]").wait_for(timeout=PATIENCE_MS)
    _choose(page, "agent")
    page.mouse.click(*_find_cell(page, 1, 1))
    _choose(page, "goal")
    page.mouse.click(*_find_cell(page, 7, 1))
    _choose(page, "wall")
    page.mouse.move(*_find_cell(page, 1, 2))
    page.mouse.down()
    page.mouse.move(*_find_cell(page, 7, 2), steps=30)
    page.mouse.up()
    _choose(page, "key")
    _choose(page, "blue")
    page.locator("#whole").focus()
    for key in ("ArrowDown", "ArrowDown", "ArrowDown", "ArrowLeft", "ArrowLeft", "ArrowLeft", "Space"):
        page.keyboard.press(key)
    file = page.locator("#file")
    expect(file).to_contain_text(f"'''{DRAWN_LEVEL}'''")
    drawn = file.inner_text()
    page.get_by_role("button", name="Play").click()
    for _ in range(6):
        page.keyboard.press("ArrowUp")
    expect(page.locator("#outcome")).to_have_text(re.compile(r"^Success: reward 0\.\d+ in 6 steps\.$"))
    page.reload()
    expect(file).to_have_text(drawn)
    with page.expect_download() as download:
        page.get_by_role("button", name="Save").click()
    assert download.value.path().read_text(encoding="utf-8").strip() == drawn.strip(), "the saved file is another level"


def _press(page: Page, within: Page | FrameLocator, key: str, *, pictures: tuple[str, ...]) -> None:
    """Press a key, and expect that each of these pictures changes."""
    canvases = {selector: within.locator(selector) for selector in pictures}
    before = {selector: canvas.evaluate(PICTURE) for selector, canvas in canvases.items()}
    page.keyboard.press(key)
    for selector, canvas in canvases.items():
        assert canvas.evaluate(PICTURE) != before[selector], f"{key} did not change {selector}"


def _choose(page: Page, name: str) -> None:
    page.get_by_role("radio", name=name, exact=True).click()


def _find_cell(page: Page, x: int, y: int) -> tuple[float, float]:
    """Find the middle of a cell of the level, in the window."""
    box = page.locator("#whole").bounding_box()
    assert box is not None, "the level is not shown"
    columns, rows = (int(page.locator(field).input_value()) for field in ("#columns", "#rows"))
    return box["x"] + (x + 0.5) * box["width"] / columns, box["y"] + (y + 0.5) * box["height"] / rows


CHECKS: dict[str, Callable[[Page, str], None]] = {
    "grid": play_grid_world,
    "first-person": play_first_person_world,
    "level": draw_level,
}


def check_play(browser: Browser, address: str, pictures: Path | None = None) -> list[str]:
    """Return what went wrong in any check, what the browser complained of included; save a picture of each end."""
    problems = []
    for name, check in CHECKS.items():
        page = browser.new_page(viewport={"width": 1280, "height": 900})
        complaints = _collect_complaints(page)
        try:
            check(page, f"{address}/play")
        except (AssertionError, Error) as error:
            complaints.append(str(error))
        if pictures is not None:
            pictures.mkdir(parents=True, exist_ok=True)
            page.screenshot(path=pictures / f"{name}.png", full_page=True)
        problems += [f"play, {name}: {complaint}" for complaint in complaints]
        page.close()
    return problems


def _collect_complaints(page: Page) -> list[str]:
    """Return a list that fills with the errors of scripts and the requests that fail."""
    complaints: list[str] = []

    def judge_response(response: Response) -> None:
        if response.status >= 400:
            complaints.append(f"{response.url}: {response.status}")

    page.on("pageerror", lambda error: complaints.append(str(error)))
    page.on("requestfailed", lambda request: complaints.append(f"{request.url}: {request.failure}"))
    page.on("response", judge_response)
    return complaints
