"""Judge a built site, and exit with 1 at what is serious: check_site.py SITE [--pictures FOLDER] [--lighthouse FILE].

Two worlds are played, and a level is drawn and played, by real key events (`check_play.py`); ``--pictures`` keeps a
picture of each. Axe-core judges pages in light and dark, wide and narrow, the pages to play and to draw a level among
them. With ``--lighthouse`` Lighthouse scores three pages, too, and its scores are written to a file; it needs Node. The
README, laid out about as GitHub does, is no wider than its window and reaches "More" within two screens.
"""

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from html.parser import HTMLParser
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from itertools import product
from pathlib import Path
from urllib.parse import unquote, urlsplit

import markdown
from axe_playwright_python.sync_playwright import Axe
from check_play import check_play
from playwright.sync_api import Browser, Page, sync_playwright

PAGES = (
    "index",
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
    """Serve the site on this machine, since a browser loads modules from no file; yield its address."""
    with ThreadingHTTPServer(("127.0.0.1", 0), partial(_Quiet, directory=str(site))) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


@contextmanager
def browsing() -> Iterator[Browser]:
    """Start the Chromium of this machine, or else Playwright's own."""
    path = shutil.which("chromium") or shutil.which("google-chrome")
    with sync_playwright() as playwright:
        arguments = ["--no-sandbox", "--disable-gpu", "--disable-background-networking"]
        browser = playwright.chromium.launch(executable_path=path, args=arguments)
        yield browser
        browser.close()


def judge(page: Page, place: str) -> list[str]:
    """Return what is serious or critical on a page, and whether it is wider than its window."""
    problems = []
    for violation in Axe().run(page).response["violations"]:
        if violation["impact"] in ("serious", "critical"):
            html = violation["nodes"][0]["html"]
            problems.append(f"{place}: {violation['id']} ({len(violation['nodes'])}), first {html[:150]}")
    if page.evaluate("document.documentElement.scrollWidth > window.innerWidth"):
        problems.append(f"{place}: wider than the window")
    return problems


class _Links(HTMLParser):
    """The addresses that a page refers to, and the names that can be referred to in it."""

    def __init__(self) -> None:
        super().__init__()
        self.addresses: list[str] = []
        self.anchors: set[str] = {""}

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Take in an element."""
        attributes = dict(attrs)
        self.anchors.add(attributes.get("id") or "")
        for name in ("href", "src"):
            if address := attributes.get(name):
                self.addresses.append(address)


def find_dead_links(site: Path) -> list[str]:
    """Return each link of a page to a file or a heading that the site does not have; other sites are not asked."""
    pages: dict[Path, _Links] = {}
    for path in site.rglob("*.html"):
        if path.name != "404.html":  # a server shows it at any depth, so its links begin at the server's root
            pages[path] = _Links()
            pages[path].feed(path.read_text(encoding="utf-8"))
    return [
        f"{path.relative_to(site)}: {address} leads nowhere"
        for path, links in pages.items()
        for address in links.addresses
        if not _has_target(path, address, pages)
    ]


def _has_target(page: Path, address: str, pages: dict[Path, _Links]) -> bool:
    parts = urlsplit(address)
    if parts.scheme or parts.netloc:
        return True
    target = (page.parent / unquote(parts.path)).resolve() if parts.path else page
    if target.is_dir():
        target /= "index.html"
    if target not in pages or target.parent.name == "play":  # a world or a level stands behind the # of these
        return target.exists()
    return unquote(parts.fragment) in pages[target].anchors


def judge_pages(browser: Browser, address: str) -> list[str]:
    """Return what is serious on any page, in light and dark, wide and narrow."""
    problems = []
    for scheme, width_px in product(("light", "dark"), WIDTHS_PX):
        context = browser.new_context(color_scheme=scheme, viewport={"width": width_px, "height": 900})
        for name in PAGES:
            page = context.new_page()
            errors: list[str] = []
            page.on("pageerror", lambda error, errors=errors: errors.append(str(error)))
            page.goto(f"{address}/{name}.html")
            if name.startswith("play/"):
                page.locator("body[data-ready]").wait_for()
            else:
                page.wait_for_timeout(300)  # the theme says nowhere that its scripts are done
            place = f"{name}, {scheme}, {width_px} px"
            problems += judge(page, place) + [f"{place}: {error}" for error in errors]
            page.close()
        context.close()
    return problems


def judge_filter(browser: Browser, address: str) -> list[str]:
    """Return whether the field above the galleries fails to leave the worlds whose text has the words."""
    page = browser.new_page()
    page.goto(f"{address}/play.html")
    worlds = page.locator(".gallery-cells td:visible")
    every = worlds.count()
    page.get_by_label("Filter the worlds").fill("doorkey 6x6")
    names = worlds.all_inner_texts()
    page.close()
    if every < 150 or [name.split()[0] for name in names] != ["MiniGrid-DoorKey-6x6-v0"]:
        return [f"play: of {every} worlds the filter leaves {names}"]
    return []


def judge_readme(browser: Browser) -> list[str]:
    """Return where the README is wider than its window, or "More" begins after two screens."""
    problems = []
    body = markdown.markdown(README.read_text(encoding="utf-8"), extensions=["tables", "fenced_code"])
    head = f'<meta charset=utf-8><meta name=viewport content="width=device-width"><style>{README_STYLE}</style>'
    with tempfile.NamedTemporaryFile("w", suffix=".html", dir=README.parent) as file:
        file.write(f"<!doctype html>{head}<article>{body}</article>")
        file.flush()
        for width_px, height_px in README_SCREENS_PX:
            page = browser.new_page(viewport={"width": width_px, "height": height_px})
            page.goto(Path(file.name).as_uri())
            more = page.locator("h2", has_text="More").bounding_box()
            assert more is not None
            screens = more["y"] / height_px
            print(f"README, {width_px} x {height_px} px: {screens:.2f} screens before More")
            if screens > 2:
                problems.append(f"README, {width_px} px: More begins after {screens:.2f} screens, over 2")
            if page.evaluate("document.documentElement.scrollWidth > window.innerWidth"):
                problems.append(f"README, {width_px} px: wider than the window")
            page.close()
    return problems


def score_page(address: str, *options: str, categories: str = "accessibility,best-practices") -> dict[str, int | str]:
    """Return the scores of a page, 0 to 100, by category, and the version; options are further ones of Lighthouse."""
    with tempfile.NamedTemporaryFile(suffix=".json") as file:
        command = ["npx", "--yes", LIGHTHOUSE, address, "--quiet", "--output=json", f"--output-path={file.name}"]
        command += [f"--only-categories={categories}", "--chrome-flags=--headless=new --no-sandbox", *options]
        subprocess.run(command, check=True)
        report = json.loads(Path(file.name).read_text(encoding="utf-8"))
    for audit in report["audits"].values():
        if audit["score"] == 0 and audit["scoreDisplayMode"] == "binary":
            print(f"{address}: {audit['title']}", file=sys.stderr)
    scores = {key: round(100 * category["score"]) for key, category in report["categories"].items()}
    return {**scores, "version": report["lighthouseVersion"]}


def score_pages(address: str) -> dict[str, dict[str, int | str]]:
    """Return Lighthouse's scores of three pages."""
    return {name: score_page(f"{address}/{name}.html") for name in SCORED}


def find_low_scores(scores: Mapping[str, Mapping[str, int | str]]) -> list[str]:
    """Return each score that is under the lowest that passes."""
    return [
        f"{name}: {category} is {score}, under {LOWEST_SCORE}"
        for name, by_category in scores.items()
        for category, score in by_category.items()
        if isinstance(score, int) and score < LOWEST_SCORE
    ]


def main() -> None:
    """Print every problem and every low score."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("site", type=Path)
    parser.add_argument("--pictures", type=Path, metavar="FOLDER", help="save a picture of each world that was played")
    parser.add_argument("--lighthouse", type=Path, metavar="FILE", help="write Lighthouse's scores to this file")
    arguments = parser.parse_args()
    site = arguments.site.resolve()
    problems = find_dead_links(site)
    with serving(site) as address:
        with browsing() as browser:
            problems += check_play(browser, address, arguments.pictures)
            problems += judge_pages(browser, address)
            problems += judge_filter(browser, address) + judge_readme(browser)
        if arguments.lighthouse:
            scores = score_pages(address)
            arguments.lighthouse.write_text(json.dumps(scores, indent=1) + "\n", encoding="utf-8")
            for name, by_category in scores.items():
                print(name, by_category)
            problems += find_low_scores(scores)
    passed = f"two worlds and a level played; {len(PAGES)} pages, light and dark, {WIDTHS_PX} px: no serious violation"
    print("\n".join(problems) or passed)
    sys.exit(bool(problems))


if __name__ == "__main__":
    main()
