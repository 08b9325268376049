"""Judge a built site by axe-core in light and dark, and exit with 1 at what is serious: check_site.py SITE."""

import sys
from pathlib import Path

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import sync_playwright

PAGES = ("index", "first-study", "protocols", "session")
WIDTHS_PX = (1200, 390)


def main() -> None:
    """Print every violation that is serious or critical, and every picture without a text."""
    found = []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=_find_chromium(), args=["--no-sandbox"])
        for scheme in ("light", "dark"):
            for width in WIDTHS_PX:
                context = browser.new_context(color_scheme=scheme, viewport={"width": width, "height": 900})
                for name in PAGES:
                    page = context.new_page()
                    page.goto((Path(sys.argv[1]).resolve() / f"{name}.html").as_uri())
                    page.wait_for_timeout(300)
                    where = f"{name}, {scheme}, {width} px"
                    for violation in Axe().run(page).response["violations"]:
                        if violation["impact"] in ("serious", "critical"):
                            html = violation["nodes"][0]["html"]
                            found.append(f"{where}: {violation['id']} ({len(violation['nodes'])}), first {html[:150]}")
                    if page.evaluate("document.documentElement.scrollWidth > window.innerWidth"):
                        found.append(f"{where}: wider than the window")
                    page.close()
                context.close()
        browser.close()
    print("\n".join(found) or f"{len(PAGES)} pages, light and dark, {WIDTHS_PX} px: no serious violation")
    sys.exit(bool(found))


def _find_chromium() -> str | None:
    """Debian's Chromium where it is; None takes Playwright's own."""
    path = Path("/usr/bin/chromium")
    return str(path) if path.exists() else None


if __name__ == "__main__":
    main()
