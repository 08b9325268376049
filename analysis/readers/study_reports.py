"""Write the reports of six simulated studies, one per kind of design, as pictures and text for new readers.

python analysis/readers/study_reports.py FOLDER

The protocols are in `designs`. For each study the folder gets the report itself (`NAME/report`), its screens as a
browser shows them before anything is unfolded (`NAME/screen-N.png`), its printed A4 pages (`NAME/page-N.png`) and the
words of all of it (`NAME/report.txt`). It needs Chromium, Playwright and pdftoppm (`apt-get install poppler-utils`).
"""

import argparse
import csv
import random
import shutil
import subprocess
from pathlib import Path
from typing import NamedTuple

from playwright.sync_api import Browser, sync_playwright

import minihuman

DESIGNS = Path(__file__).with_name("designs")
SCREEN = {"width": 1280, "height": 1000}
DOTS_PER_INCH = 110  # of a printed page's picture


class Study(NamedTuple):
    """A protocol's name, and how many simulated participants take part."""

    name: str
    participants: int


STUDIES = (
    Study("mixed", 24),
    Study("factorial", 30),
    Study("latin", 18),
    Study("days", 24),
    Study("stroop", 24),
    Study("team", 24),
)


def run_study(study: Study, data: Path) -> Path:
    """Simulate a study's sessions; return its folder."""
    for _ in minihuman.simulate(DESIGNS / f"{study.name}.toml", participants=study.participants, data=data, seed=1):
        pass
    folder = data / study.name
    if study.name == "stroop":
        write_ages(folder)
    return folder


def write_ages(folder: Path) -> None:
    """Write a table of participants with ages in years and sexes."""
    generator = random.Random(7)
    codes = dict.fromkeys(session.participant for session in minihuman.open_study(folder).sessions)
    with (folder / "participants.csv").open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(["participant", "age", "sex"])
        for code in codes:
            rows.writerow([code, generator.randint(19, 64), generator.choice("fm")])


def take_pictures(browser: Browser, report: Path, folder: Path) -> None:
    """Take pictures of a report's screens and printed pages, and copy its words."""
    page = browser.new_page(viewport=SCREEN)
    page.goto(report.resolve().as_uri())
    height = page.evaluate("document.documentElement.scrollHeight")
    for number, top in enumerate(range(0, height, SCREEN["height"]), 1):
        clip = {"x": 0, "y": top, "width": SCREEN["width"], "height": min(SCREEN["height"], height - top)}
        page.screenshot(path=folder / f"screen-{number}.png", clip=clip, full_page=True)
    page.pdf(path=folder / "report.pdf", format="A4", prefer_css_page_size=True, print_background=True)
    page.evaluate("document.querySelectorAll('details').forEach((part) => { part.open = true; })")
    (folder / "report.txt").write_text(page.inner_text("body") + "\n", encoding="utf-8")
    page.close()
    pages = ["pdftoppm", "-png", "-r", str(DOTS_PER_INCH), folder / "report.pdf", folder / "page"]
    subprocess.run(pages, check=True)


def main() -> None:
    """Write the reports of all studies, or of those that are named."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", nargs="*", choices=[study.name for study in STUDIES], help="studies to write")
    options = parser.parse_args()
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        chosen = [study for study in STUDIES if not options.only or study.name in options.only]
        for study in chosen:
            folder = options.folder / study.name
            for old in [*folder.glob("*.png"), *folder.glob("report.*")]:
                old.unlink()
            sessions = options.folder / "sessions" / study.name
            if not sessions.exists():
                run_study(study, sessions.parent)
            minihuman.report(sessions, folder / "report")
            take_pictures(browser, folder / "report" / "report.html", folder)
            print(f"{study.name}: {len([*folder.glob('screen-*')])} screens, {len([*folder.glob('page-*')])} pages")


if __name__ == "__main__":
    main()
