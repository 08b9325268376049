"""Several workers: each has its seats, and one that dies is started again and takes them up; a person has one seat."""

import asyncio
import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from minihuman.admin.verify.log import find_log_differences
from minihuman.experiment.machine.events import KeyPressed
from minihuman.log.read.session_reader import read_events, read_log
from minihuman.worlds.adapters.world import World
from tests.counts import PATIENCE_S, count
from tests.machine import needs
from tests.web.browser import Somebody, browsing
from tests.web.processes import below, runs, until
from tests.web.protocols import study
from tests.web.serving import Serving, listens
from tests.web.typed_page import TypedPage

pytestmark = pytest.mark.program
STEPS = 8


@contextmanager
def two_workers(protocol: Path, data: Path, *, links: int) -> Iterator[Serving]:
    served = Serving(protocol, data, links=links, options=("--workers", "2"))
    try:
        until(lambda: listens(served.port + 1))
        yield served
    finally:
        served.stop()


def worker_at(parent: int, port: int) -> int | None:
    """The process of a worker; None where it does not run."""
    for child in below(parent):
        if str(port).encode() in Path(f"/proc/{child}/cmdline").read_bytes().split(b"\0"):
            return child
    return None


def plays(somebody: Somebody) -> None:
    somebody.to_play()
    somebody.press(*"123" * 4)
    somebody.until("!s.playing")


@needs("chromium")
def test_a_worker_that_is_killed_is_started_again_and_takes_its_people_up(tmp_path: Path) -> None:
    protocol = study(tmp_path, max_steps=STEPS)
    with two_workers(protocol, tmp_path, links=2) as served, browsing() as sit_down:
        ports = served.port, served.port + 1
        first = sit_down(f"http://127.0.0.1:{ports[0]}/#t={served.tokens[0]}")
        plays(first)  # and has the first slot
        second = sit_down(f"http://127.0.0.1:{ports[1]}/#t={served.tokens[1]}")
        second.to_play()
        second.press("1", "2")
        killed = worker_at(served.pid, ports[1])
        assert killed is not None
        os.kill(killed, signal.SIGKILL)
        second.press("1", "2", "3")
        first.press("enter")
        plays(first)
        second.until("s.welcomed && s.unsafe === 0 && s.confirmed === 5")
        assert worker_at(served.pid, ports[1]) not in (None, killed)
        second.press("1", "1", "1")
        second.until("!s.playing")
        plays(second)
        for somebody in (first, second):
            somebody.to_end()
            assert somebody.errors == []
    paths = sorted(tmp_path.rglob("*.mcap"))
    assert [path.name for path in paths] == ["sub-01_ses-01.mcap", "sub-02_ses-01.mcap"]
    for path in paths:
        log = read_log(path)
        assert len(log.segments) == 1
        assert [len(episode.actions) for episode in log.episodes] == [STEPS, STEPS]
        assert list(find_log_differences(path, World)) == []
    assert pressed(paths[1])[:5] == ["1", "2", "1", "2", "3"]


@pytest.mark.parametrize(
    "told", [signal.SIGTERM, signal.SIGINT][: count(1, 2)], ids=["terminate", "Ctrl-C"][: count(1, 2)]
)
def test_told_to_end_it_takes_its_workers_and_its_watch_with_it_and_logs_are_whole(
    tmp_path: Path, told: signal.Signals
) -> None:
    protocol = study(tmp_path, max_steps=STEPS)
    served = Serving(protocol, tmp_path, links=2, options=("--workers", "2", "--watch"))
    try:
        until(lambda: listens(served.port + 1))
        until(lambda: len(below(served.pid)) == 2)
        others = below(served.pid)
        pages = [
            TypedPage(f"127.0.0.1:{port}", token, keys_per_s=10, most_presses=3)
            for port, token in zip((served.port, served.port + 1), served.tokens, strict=True)
        ]
        for page in pages:
            asyncio.run(asyncio.wait_for(page.take_part(), PATIENCE_S))
        assert served.told(told) == 0
        until(lambda: not any(map(runs, others)))
    finally:
        served.kill()
    parts = sorted(tmp_path.rglob("*.mcap.part"))
    assert len(parts) == 2, "both sessions are left to be gone on with"
    for part, page in zip(parts, pages, strict=True):
        assert list(find_log_differences(part, World)) == []
        assert len([key for key in pressed(part) if key in "123"]) == page.counts.presses


def pressed(path: Path) -> list[str]:
    events = (event for event in read_events(path) if isinstance(event, KeyPressed) and event.down)
    return [event.key for event in events if event.key in "123"]


@pytest.mark.nightly
@needs("chromium")
def test_whoever_comes_without_a_link_is_sent_to_the_same_worker_in_every_tab(tmp_path: Path) -> None:
    protocol = study(tmp_path, web="image_size_px = [96, 96]\nopen_access = true")
    served = Serving(protocol, tmp_path, links=0)
    try:
        with browsing() as sit_down:
            first = sit_down(f"http://127.0.0.1:{served.port}/")
            first.until("s.kind !== ''")
            other_tab = sit_down(first.page.url)
            other_tab.until("s.kind !== ''")
            stranger = sit_down(f"http://127.0.0.1:{served.port}/")
            stranger.until("s.kind !== ''")
            assert "#t=" in first.page.url
            assert first.sockets[-1] == other_tab.sockets[-1]
            assert stranger.sockets[-1] != first.sockets[-1]
    finally:
        served.kill()
