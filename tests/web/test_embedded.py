"""A study inside another site's page: shown where the protocol lists the site's host, and nowhere else."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from minihuman.log.read.session_reader import read_log
from tests.machine import needs
from tests.web.browser import browsing
from tests.web.protocols import asking
from tests.web.serving import serving

pytestmark = [needs("chromium"), pytest.mark.program]


@contextmanager
def site(address: list[str]) -> Iterator[int]:
    """Serve a page on localhost with a frame of an address; yields the port."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("content-type", "text/html")
            self.end_headers()
            self.wfile.write(f'<iframe src="{address[0]}" width="900" height="600"></iframe>'.encode())

        def log_message(self, *_: object) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        yield server.server_port
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


def test_a_study_is_answered_in_the_frame_of_a_listed_host_and_its_log_says_so(tmp_path: Path) -> None:
    address: list[str] = []
    with site(address) as port, browsing() as sit_down:
        protocol = asking(tmp_path, "choice", web=f'embed_in = ["localhost:{port}"]')
        protocol.write_text(protocol.read_text().replace('ask = "choice?"', 'ask = "choice?"\noptions = ["a", "b"]'))
        with serving(protocol, tmp_path) as served:
            address.append(f"http://127.0.0.1:{served.port}/#t={served.tokens[0]}")
            page = sit_down(f"http://localhost:{port}/").page
            frame = page.frame_locator("iframe")
            frame.locator("[data-target='option:1']").click()
            frame.locator("[data-target='go_on']").click()
            frame.get_by_text("Thank you for taking part.").wait_for()
            frame.locator("[data-target='go_on']").click()
            frame.locator("[role=status].body").wait_for()
    [log] = tmp_path.rglob("*.mcap")
    facts = read_log(log).facts
    assert (facts["framed"], facts["isolated"]) == ("yes", "no")
    assert float(facts["timer_step_ms"]) > 0.005  # of an isolated page


def test_a_study_that_lists_no_host_is_in_no_frame(tmp_path: Path) -> None:
    address: list[str] = []
    with site(address) as port, browsing() as sit_down, serving(asking(tmp_path, "number"), tmp_path) as served:
        address.append(f"http://127.0.0.1:{served.port}/#t={served.tokens[0]}")
        page = sit_down("about:blank").page
        with page.expect_console_message(lambda message: "frame-ancestors" in message.text):
            page.goto(f"http://localhost:{port}/")
