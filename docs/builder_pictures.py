"""Take the pictures of the builder for docs/made-by-hand.md.

    python docs/builder_pictures.py docs/images

It needs Chromium and Playwright, as the tests of the page do.
"""

import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from playwright.sync_api import Page, sync_playwright

from minihuman.builder.messages import NewStudyRequest
from minihuman.builder.new_study import make_study

ROOT = Path(__file__).resolve().parents[1]
SIZE = {"width": 1440, "height": 900}
PATIENCE_MS = 180_000


@contextmanager
def serve_desk(folder: Path) -> Iterator[str]:
    """Serve the desk of a folder; yields the address of the builder."""
    command = [sys.executable, "-m", "minihuman", "desk", ".", "--data=sessions", "--no-browser"]
    with subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, text=True) as desk:
        try:
            assert desk.stdout is not None
            address = re.search(r"http://\S+", desk.stdout.readline())
            assert address is not None
            yield f"{address[0]}builder/"
        finally:
            desk.terminate()


def take_pictures(page: Page, address: str, out: Path) -> None:
    """Take each view that the page of the docs shows."""
    page.goto(address)
    page.get_by_role("heading", name="Begin with").wait_for()
    page.wait_for_load_state("networkidle")
    page.screenshot(path=out / "builder-studies.png")
    page.goto(f"{address}#/study/online.toml/parts/practice")
    page.get_by_label("Instructions", exact=True).wait_for()
    page.get_by_text("sees it", exact=False).wait_for()
    page.wait_for_load_state("networkidle")
    page.locator(".screen").hover()
    page.frame_locator("iframe").get_by_role("button", name="Go on").click()
    page.frame_locator("iframe").get_by_text("Ready?").wait_for()
    page.wait_for_timeout(500)
    page.keyboard.press("Enter")
    page.wait_for_timeout(1_000)
    page.screenshot(path=out / "builder-parts.png")


def take_editor_pictures(page: Page, address: str, out: Path) -> None:
    """Take the editors of a level and of a trial's time course, without the preview beside them."""
    page.goto(f"{address}#/study/level.toml/parts/play")
    cells = page.locator(".cells-grid")
    cells.wait_for()
    walls = [(0.61, y, "wall") for y in (0.22, 0.36, 0.5, 0.79)]
    for x, y, kind in ((0.5, 0.35, "key"), (0.61, 0.64, "locked door"), *walls):
        page.get_by_role("button", name=kind, exact=True).click()
        box = cells.bounding_box()
        assert box is not None
        page.mouse.click(box["x"] + x * box["width"], box["y"] + y * box["height"])
        page.get_by_role("status").filter(has_text=re.compile("^Saved")).wait_for()
    page.wait_for_load_state("networkidle")
    page.locator("section.level").screenshot(path=out / "builder-level.png")
    page.goto(f"{address}#/study/stop%2Fstop.toml/parts/stop-signal")
    page.locator(".track").first.wait_for()
    page.locator("section.timeline").screenshot(path=out / "builder-trial.png")


def take_data_picture(page: Page, address: str, out: Path) -> None:
    """Take the view of recorded sessions."""
    page.goto(f"{address}#/study/online.toml/data")
    page.get_by_role("button", name="Details of sub-02").click()
    page.get_by_role("region", name="Replay of sub-02, session 1").get_by_label("Episode").select_option("7")
    page.get_by_label("Step", exact=True).fill("60")
    page.locator(".seen").wait_for()
    page.get_by_label("Reason", exact=True).fill("the phone rang")
    page.wait_for_load_state("networkidle")
    page.screenshot(path=out / "builder-data.png")


def main(out: Path) -> None:
    """Take the pictures into a folder."""
    with tempfile.TemporaryDirectory() as temporary, sync_playwright() as playwright:
        folder = Path(temporary) / "studies"
        folder.mkdir()
        for name in ("online.toml", "two-days.toml", "demo.toml"):
            shutil.copy(ROOT / "protocols" / name, folder)
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        with serve_desk(folder) as address:
            page = browser.new_page(viewport=SIZE)
            page.set_default_timeout(PATIENCE_MS)
            take_pictures(page, address, out)
            make_study(NewStudyRequest("stop", template="trials/stop-signal"), folder, None)
            level = make_study(NewStudyRequest("level", template="one-world"), folder, None)
            level.write_text(level.read_text().replace("minihuman/MiniGrid-FourRooms-v0", "minihuman/Level-v0"))
            take_editor_pictures(page, address, out)
            simulate = [sys.executable, "-m", "minihuman", "simulate", "online.toml", "--participants=4"]
            subprocess.run([*simulate, "--data=sessions"], cwd=folder, check=True, stdout=subprocess.DEVNULL)
            take_data_picture(page, address, out)
        browser.close()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
