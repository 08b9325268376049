"""Links from these pages to files of the repository lead to the repository, as pages of a site cannot hold them."""

import re
from typing import Any

_SOURCE = "https://github.com/minihuman/minihuman/blob/main/"
_OUT = re.compile(r"\]\(\.\./([^)#\s]+)(#[^)\s]*)?\)")


def on_page_markdown(markdown: str, **_: Any) -> str:
    """Lead a link above the docs' folder to the repository."""
    return _OUT.sub(lambda found: f"]({_SOURCE}{found[1]}{found[2] or ''})", markdown)
