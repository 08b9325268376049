"""Behind Caddy with TLS, by the Caddyfile of `minihuman deploy`: each page gets to its worker, and clocks are fine."""

import socket
import ssl
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from minihuman.admin.verify.log import find_log_differences
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.web.deployment import Deployment, write_deployment
from minihuman.worlds.adapters.world import World
from tests.counts import PATIENCE_S
from tests.machine import needs
from tests.programs import running
from tests.web.browser import browsing
from tests.web.protocols import study
from tests.web.serving import Serving, free_port, listens

pytestmark = [
    pytest.mark.program,
    needs("caddy", "chromium"),
]
PROTOCOL = Path(__file__).parents[2] / "protocols" / "online.toml"
HERE = """
	admin off
	auto_https disable_redirects
	skip_install_trust
	storage file_system {folder}
"""  # a certificate of its own, and nothing outside the folder


def caddyfile(folder: Path, *, port: int, first: int) -> str:
    """What `minihuman deploy` writes for two workers, with this machine's address."""
    deployment = Deployment("https://study.example.org", workers=2)
    write_deployment(decode_protocol(PROTOCOL.read_bytes()), folder / "deployment", deployment)
    there = (folder / "deployment" / "Caddyfile").read_text()
    for old, new, times in (
        ("127.0.0.1:8000 127.0.0.1:8001", f"127.0.0.1:{first} 127.0.0.1:{first + 1}", 2),  # sockets and pages
        ("\nstudy.example.org {", f"\nhttps://localhost:{port} {{\n\ttls internal", 1),
        ("\n{\n", "\n{" + HERE.format(folder=folder / "certificates"), 1),
    ):
        assert there.count(old) == times, old
        there = there.replace(old, new)
    return there


@contextmanager
def caddy(folder: Path, text: str, port: int) -> Iterator[None]:
    path = folder / "Caddyfile"
    path.write_text(text)
    command = ["caddy", "run", "--config", str(path), "--adapter", "caddyfile"]
    with (folder / "caddy.log").open("w") as log, running(command, stderr=log) as process:
        try:
            until_secure(port)
            yield
        finally:
            process.terminate()


def until_listens(port: int) -> None:
    deadline_s = time.monotonic() + PATIENCE_S
    while not listens(port):
        assert time.monotonic() < deadline_s
        time.sleep(0.1)


def until_secure(port: int) -> None:
    """Until a handshake is done: the port listens before the certificate is made."""
    context = ssl.create_default_context()
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    deadline_s = time.monotonic() + PATIENCE_S
    while True:
        try:
            with socket.create_connection(("localhost", port), timeout=5) as plain:
                context.wrap_socket(plain, server_hostname="localhost").close()
                return
        except OSError:  # which a TLS alert is too
            assert time.monotonic() < deadline_s
            time.sleep(0.1)


@pytest.mark.nightly
def test_people_come_by_tls_to_two_workers_and_each_stays_with_theirs(tmp_path: Path) -> None:
    port = free_port(in_a_row=1)
    address = f"https://localhost:{port}"
    protocol = study(tmp_path, episodes=1, max_steps=4, web="image_size_px = [96, 96]\nopen_access = true")
    served = Serving(protocol, tmp_path, links=2, options=("--workers", "2", "--address", address))
    try:
        until_listens(served.port + 1)
        with caddy(tmp_path, caddyfile(tmp_path, port=port, first=served.port), port), browsing() as sit_down:
            addresses = [*(f"{address}/#t={token}" for token in served.tokens), f"{address}/"]
            people = [sit_down(each, ignore_https_errors=True) for each in addresses]
            for somebody in people:
                somebody.to_play()
                somebody.press(*"1212")
                somebody.until("!s.playing")
                somebody.to_end()
                assert somebody.page.evaluate("crossOriginIsolated"), "clocks have coarse steps"
                assert all(opened.startswith(f"wss://localhost:{port}/socket?seat=") for opened in somebody.sockets)
                assert somebody.errors == []
            again = sit_down(people[-1].page.url, ignore_https_errors=True)
            again.until("s.finished")
            assert again.sockets[-1] == people[-1].sockets[-1], "another tab of the same person goes elsewhere"
    finally:
        served.stop()
    logs = sorted(tmp_path.rglob("*.mcap"))
    assert len(logs) == 3
    assert [complaint for log in logs for complaint in find_log_differences(log, World)] == []
    written = [path.read_bytes() for path in (tmp_path / "tried").rglob("*") if path.is_file()]
    assert not any(b"127.0.0.1" in each or b"Mozilla" in each for each in written)


@pytest.mark.nightly
def test_the_page_comes_from_whichever_worker_is_there(tmp_path: Path) -> None:
    port = free_port(in_a_row=1)
    protocol = study(tmp_path, web="image_size_px = [96, 96]")
    served = Serving(protocol, tmp_path, links=1)  # one worker of two: the port beside it is refused
    try:
        for first in (served.port, served.port - 1):  # the one that is down is the second, then the first
            text = caddyfile(tmp_path, port=port, first=first)
            with caddy(tmp_path, text, port), browsing() as sit_down:
                page = sit_down(f"https://localhost:{port}/", ignore_https_errors=True).page
                loaded = page.evaluate(
                    'Promise.all([...document.querySelectorAll(\'[href^="/static"], [src^="/static"]\')]'
                    ".map((one) => fetch(one.href ?? one.src).then((answer) => answer.status)))"
                )
                assert set(loaded) == {200}
                assert len(loaded) > 5
    finally:
        served.stop()
