"""A gallery's section of play.md, which its script writes between two comments."""

import re
from collections.abc import Iterable
from pathlib import Path


def replace_section(page: Path, name: str, lines: Iterable[str]) -> None:
    """Replace what a page has between the comments of this name.

    Raises:
        ValueError: if the page does not have the two comments, once each.
    """
    pattern = re.compile(rf"(<!-- {name} -->\n).*?(<!-- end of {name} -->)", re.DOTALL)
    text = "\n".join(lines) + "\n"
    replaced, count = pattern.subn(lambda comments: comments[1] + text + comments[2], page.read_text(encoding="utf-8"))
    if count != 1:
        raise ValueError(f"{page} has the section {name!r} {count} times; write its two comments into it once")
    page.write_text(replaced, encoding="utf-8")
