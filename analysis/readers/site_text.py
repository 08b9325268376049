"""Write the README and a built site as plain text, with the links that a reader can follow: site_text.py SITE OUT."""

import re
import shutil
import sys
from html.parser import HTMLParser
from pathlib import Path

README = Path(__file__).parents[2] / "README.md"
BLOCKS = frozenset({"p", "div", "li", "tr", "pre", "h1", "h2", "h3", "h4", "h5", "ul", "ol", "table", "section", "nav"})
SILENT = frozenset({"script", "style", "svg", "head"})


class PageText(HTMLParser):
    """The text of a page: a line per block, a bar between a table's cells, and a link as [text](page)."""

    def __init__(self) -> None:
        super().__init__()
        self.parts: list[str] = []
        self._silent = self._verbatim = 0
        self._targets: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Begin a block, a cell, a link or a picture."""
        values = dict(attrs)
        self._silent += tag in SILENT
        self._verbatim += tag == "pre"
        if tag in BLOCKS or tag == "br":
            self.parts.append("\n" + ("#" * int(tag[1]) + " " if tag[0] == "h" and tag[1:].isdigit() else ""))
        if tag in ("td", "th"):
            self.parts.append(" | ")
        if tag == "img":
            self.parts.append(f"(picture: {values.get('alt') or ''})")
        if tag == "a":
            self._targets.append((values.get("href") or "").replace(".html", ".txt"))
            self.parts.append("[")

    def handle_endtag(self, tag: str) -> None:
        """End a block or a link."""
        self._silent -= tag in SILENT
        self._verbatim -= tag == "pre"
        if tag == "a" and self._targets:
            self.parts.append(f"]({self._targets.pop()})")
        if tag in BLOCKS:
            self.parts.append("\n")

    def handle_data(self, data: str) -> None:
        """Keep what is shown."""
        if not self._silent:
            self.parts.append(data if self._verbatim else re.sub(r"\s+", " ", data))


def main() -> None:
    """Write OUT/README.md and OUT/site/*.txt."""
    site, out = Path(sys.argv[1]), Path(sys.argv[2])
    (out / "site").mkdir(parents=True, exist_ok=True)
    shutil.copyfile(README, out / "README.md")
    for page in sorted(site.glob("*.html")):
        text = PageText()
        text.feed(page.read_text(encoding="utf-8"))
        shown = re.sub(r"\[\s*(.*?)\s*\]\(", r"[\1](", "".join(text.parts).replace("¶", ""))
        lines = [line.rstrip() for line in shown.splitlines()]
        kept = [line for line, before in zip(lines, ["", *lines], strict=False) if line.strip() or before.strip()]
        (out / "site" / f"{page.stem}.txt").write_text("\n".join(kept) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
