"""The files of the page: which are asked for at once, and which are sent compressed."""

import gzip
import re
from pathlib import Path

import pytest
from starlette.applications import Starlette
from starlette.testclient import TestClient

from minihuman.web.server.page_routes import PAGE_FOLDER, accepts_gzip, build_page_routes

_IMPORT = re.compile(r'^(?:import .*|\} )from "\./(?P<name>[^"]+)";', re.MULTILINE)


def list_modules_needed(name: str, found: set[str]) -> set[str]:
    """Return a module and all that it needs before it can run."""
    if name not in found:
        found.add(name)
        text = Path(PAGE_FOLDER, name).read_text(encoding="utf-8")
        for imported in _IMPORT.finditer(text):
            list_modules_needed(imported["name"], found)
    return found


def test_every_module_that_the_page_needs_is_asked_for_at_once() -> None:
    page = Path(PAGE_FOLDER, "page.html").read_text(encoding="utf-8")
    asked_for = re.findall(r'(?:modulepreload" href|module" src)="/static/([^"]+)"', page)
    assert sorted(asked_for) == sorted(list_modules_needed("page.js", set()))


@pytest.mark.parametrize(
    ("accept_encoding", "accepts"),
    [
        ("gzip, deflate, br, zstd", True),
        ("deflate, GZIP;q=0.5", True),
        ("*", True),
        ("*;q=0, gzip", True),
        ("br;q=1.0, gzip;q=0.8, *;q=0.1", True),
        ("", False),
        ("identity", False),
        ("br", False),
        ("gzip;q=0", False),
        ("gzip; q=0.000", False),
        ("gzip;q=0, *", False),
        (",;,=", False),
        ("gzip," * 2_000, True),
    ],
)
def test_only_a_browser_that_accepts_gzip_gets_it(accept_encoding: str, accepts: bool) -> None:
    assert accepts_gzip(accept_encoding) is accepts


def test_compressed_or_not_a_file_is_the_same() -> None:
    client = TestClient(Starlette(routes=build_page_routes()))
    for address, file in (("/", "page.html"), ("/static/episode.js", "episode.js"), ("/static/page.css", "page.css")):
        content = Path(PAGE_FOLDER, file).read_bytes()
        plain = client.get(address, headers={"accept-encoding": "identity"})
        assert (plain.content, plain.headers.get("content-encoding")) == (content, None)
        packed = client.get(address, headers={"accept-encoding": "gzip"})
        assert (packed.content, packed.headers["content-encoding"]) == (content, "gzip")
        assert int(packed.headers["content-length"]) == len(gzip.compress(content, mtime=0)) < len(content) / 1.5
        assert plain.headers["vary"] == packed.headers["vary"] == "accept-encoding"
        assert packed.headers["content-type"] == plain.headers["content-type"]
