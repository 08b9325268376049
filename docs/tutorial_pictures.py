"""Make the pictures of the tutorials: run their commands, and photograph what Chromium shows.

python docs/tutorial_pictures.py FOLDER
"""

import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from PIL import Image
from playwright.sync_api import Page, sync_playwright

DOCS = Path(__file__).parent
CHROMIUM = Path("/usr/bin/chromium")
MINIHUMAN = (sys.executable, "-m", "minihuman")
PROTOCOL = "three-rooms.toml"
WINDOW_PX = {"width": 900, "height": 660}


def run(work: Path, *words: str) -> None:
    """Run a command of minihuman."""
    subprocess.run([*MINIHUMAN, *words], cwd=work, check=True, stdout=subprocess.DEVNULL)


@contextmanager
def serving(work: Path, *words: str) -> Iterator[str]:
    """Run a command that serves a page, as long as this lasts; its first address."""
    with subprocess.Popen([*MINIHUMAN, *words], cwd=work, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            yield next(found[0] for line in process.stdout if (found := re.search(r"http://\S+", line)))
        finally:
            process.terminate()


def photograph(page: Page, path: Path, *, height_px: int = 660) -> None:
    """Write what the page shows, in as few colours as it has."""
    page.wait_for_timeout(500)
    page.screenshot(path=path, clip={"x": 0, "y": 0, "width": WINDOW_PX["width"], "height": height_px})
    Image.open(path).convert("RGB").quantize(128).save(path, optimize=True)


def write_screens(work: Path, folder: Path) -> None:
    """The contact sheet of every screen."""
    run(work, "check", PROTOCOL, "--pictures", "screens")
    with Image.open(work / "screens/contact-sheet.png") as sheet:
        sheet.thumbnail((1200, 1200))
        sheet.convert("RGB").quantize(128).save(folder / "tutorial-screens.png", optimize=True)


def photograph_desk(page: Page, work: Path, folder: Path) -> None:
    """The start page, on the study, after its protocol was checked there."""
    with serving(work, "desk", ".", "--data", "trial", "--no-browser") as address:
        page.goto(address)
        page.get_by_role("link", name="three-rooms", exact=True).click()
        page.get_by_role("button", name="Check the protocol").click()
        page.get_by_text("done", exact=True).wait_for()
        page.get_by_role("link", name="three-rooms", exact=True).click()
        photograph(page, folder / "tutorial-desk.png", height_px=1000)


def photograph_session(page: Page, work: Path, folder: Path) -> None:
    """The consent, and the first room of a participant who goes on as the page says."""
    with serving(work, "serve", PROTOCOL, "--links", "1", "--port", "0", "--data", "served") as address:
        page.set_viewport_size(WINDOW_PX)
        page.goto(address)
        page.get_by_text("Consent").first.wait_for()
        photograph(page, folder / "tutorial-consent.png")
        while not page.evaluate("minihuman.state.playing"):
            caps = page.locator(".keyboard li .cap span").all_inner_texts()
            for key in [f"Digit{cap}" for cap in caps] or ["Enter"]:
                page.keyboard.press(key)
            page.wait_for_timeout(100)
        photograph(page, folder / "tutorial-browser.png")


def main(folder: Path) -> None:
    """Make them all."""
    with tempfile.TemporaryDirectory() as name, sync_playwright() as driver:
        work = Path(name)
        text = (DOCS / "tutorial-desk.md").read_text(encoding="utf-8")
        toml = re.findall(r"```toml\n(.*?)```", text, re.DOTALL)[0]
        (work / PROTOCOL).write_text(toml, encoding="utf-8")
        run(work, "simulate", PROTOCOL, "--participants", "6", "--data", "trial")
        run(work, "report", "trial/three-rooms", "--out", "report")
        write_screens(work, folder)
        browser = driver.chromium.launch(
            executable_path=str(CHROMIUM) if CHROMIUM.exists() else None, args=["--no-sandbox"]
        )
        page = browser.new_page(viewport={**WINDOW_PX, "height": 1000})
        page.goto((work / "report/report.html").as_uri())
        photograph(page, folder / "tutorial-report.png", height_px=1000)
        photograph(page, folder / "readme-report.png", height_px=800)
        photograph_desk(page, work, folder)
        photograph_session(page, work, folder)
        browser.close()


if __name__ == "__main__":
    main(Path(sys.argv[1]))
