"""Judge a built site, and exit with 1 at what is serious: check_site.py SITE [--lighthouse FILE].

Axe-core judges pages in light and dark, wide and narrow, the pages to play and to draw a level among them. With
``--lighthouse`` Lighthouse scores three pages, too, and its scores are written to a file; it needs Node. The README,
laid out about as GitHub does, is no wider than its window and reaches "More" within two screens.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import markdown
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Page, sync_playwright

PAGES = (
    "index",
    "first-study",
    "tutorial-first",
    "tutorial-desk",
    "protocols",
    "session",
    "commands",
    "play",
    "play/index",
    "play/editor",
)
SCORED = ("index", "tutorial-desk", "commands")  # home, a tutorial, a reference page
WIDTHS_PX = (1200, 390)
README = Path(__file__).parents[1] / "README.md"
README_SCREENS_PX = ((1280, 900), (390, 844))
README_STYLE = """
body { margin: 0; font: 16px/1.5 sans-serif } article { max-width: 838px; margin: auto; padding: 32px }
@media (max-width: 767px) { article { padding: 16px } }
h1, h2 { margin: 24px 0 16px; padding-bottom: .3em; line-height: 1.25 } p, ul, pre, table { margin: 0 0 16px }
img { max-width: 100% } pre { padding: 16px; overflow: auto; font-size: 85%; line-height: 1.45 }
code { font-size: 85%; padding: .2em .4em } pre code { font-size: 100%; padding: 0 }
table { display: block; width: max-content; max-width: 100%; overflow: auto; border-collapse: collapse }
th, td { border: 1px solid; padding: 6px 13px }
"""
LIGHTHOUSE = "lighthouse@12.8.2"
LOWEST_SCORE = 95


class _Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *_: object) -> None:
        """Say nothing."""


@contextmanager
def serving(site: Path) -> Iterator[str]:
    """Serve the site on this machine, as modules and frames want it; its address."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(_Quiet, directory=str(site)))
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()


def judge(page: Page, where: str) -> list[str]:
    """What is serious or critical on a page, and whether it is wider than its window."""
    found = []
    for violation in Axe().run(page).response["violations"]:
        if violation["impact"] in ("serious", "critical"):
            html = violation["nodes"][0]["html"]
            found.append(f"{where}: {violation['id']} ({len(violation['nodes'])}), first {html[:150]}")
    if page.evaluate("document.documentElement.scrollWidth > window.innerWidth"):
        found.append(f"{where}: wider than the window")
    return found


def judge_pages(address: str) -> list[str]:
    """What is serious on any page, in light and dark, wide and narrow."""
    found = []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=_find_chromium(), args=["--no-sandbox"])
        for scheme in ("light", "dark"):
            for width in WIDTHS_PX:
                context = browser.new_context(color_scheme=scheme, viewport={"width": width, "height": 900})
                for name in PAGES:
                    page = context.new_page()
                    errors: list[str] = []
                    page.on("pageerror", lambda error, errors=errors: errors.append(str(error)))
                    page.goto(f"{address}/{name}.html")
                    page.wait_for_timeout(1500 if name.startswith("play") else 300)
                    where = f"{name}, {scheme}, {width} px"
                    found += judge(page, where) + [f"{where}: {error}" for error in errors]
                    page.close()
                context.close()
        browser.close()
    return found


def judge_readme() -> list[str]:
    """Where the README is wider than its window, or "More" begins after two screens."""
    found = []
    body = markdown.markdown(README.read_text(encoding="utf-8"), extensions=["tables", "fenced_code"])
    head = f'<meta charset=utf-8><meta name=viewport content="width=device-width"><style>{README_STYLE}</style>'
    with tempfile.NamedTemporaryFile("w", suffix=".html", dir=README.parent) as file, sync_playwright() as playwright:
        file.write(f"<!doctype html>{head}<article>{body}</article>")
        file.flush()
        browser = playwright.chromium.launch(executable_path=_find_chromium(), args=["--no-sandbox"])
        for width, height in README_SCREENS_PX:
            page = browser.new_page(viewport={"width": width, "height": height})
            page.goto(Path(file.name).as_uri())
            more = page.locator("h2", has_text="More").bounding_box()
            assert more is not None
            print(f"README, {width} x {height} px: {more['y'] / height:.2f} screens before More")
            if more["y"] > 2 * height:
                found.append(f"README, {width} px: More begins after {more['y'] / height:.2f} screens, over 2")
            if page.evaluate("document.documentElement.scrollWidth > window.innerWidth"):
                found.append(f"README, {width} px: wider than the window")
        browser.close()
    return found


def score_pages(address: str) -> dict[str, dict[str, int]]:
    """Lighthouse's scores of three pages, 0 to 100, by category."""
    scores = {}
    for name in SCORED:
        with tempfile.NamedTemporaryFile(suffix=".json") as file:
            words = ["npx", "--yes", LIGHTHOUSE, f"{address}/{name}.html", "--quiet", "--output=json"]
            words += [f"--output-path={file.name}", "--only-categories=accessibility,best-practices"]
            words += ["--chrome-flags=--headless=new --no-sandbox"]
            subprocess.run(words, check=True)
            report = json.loads(Path(file.name).read_text(encoding="utf-8"))
        scores[name] = {key: round(100 * one["score"]) for key, one in report["categories"].items()}
        scores[name]["version"] = report["lighthouseVersion"]
    return scores


def main() -> None:
    """Print every violation and every low score."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("site", type=Path)
    parser.add_argument("--lighthouse", type=Path, metavar="FILE", help="write Lighthouse's scores to this file")
    asked = parser.parse_args()
    with serving(asked.site.resolve()) as address:
        found = judge_pages(address) + judge_readme()
        if asked.lighthouse:
            scores = score_pages(address)
            asked.lighthouse.write_text(json.dumps(scores, indent=1) + "\n", encoding="utf-8")
            for name, by_category in scores.items():
                print(name, by_category)
                low = [key for key, one in by_category.items() if isinstance(one, int) and one < LOWEST_SCORE]
                found += [f"{name}: {key} is {by_category[key]}, under {LOWEST_SCORE}" for key in low]
    print("\n".join(found) or f"{len(PAGES)} pages, light and dark, {WIDTHS_PX} px: no serious violation")
    sys.exit(bool(found))


def _find_chromium() -> str | None:
    """Debian's Chromium where it is; None takes Playwright's own."""
    path = Path("/usr/bin/chromium")
    return str(path) if path.exists() else None


if __name__ == "__main__":
    main()
