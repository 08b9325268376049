"""A browser behind a network that lets no web socket through plays a whole session over HTTP."""

import os
from pathlib import Path
from typing import Literal
from urllib.request import urlopen

import pytest

from minihuman.admin.verify.log import find_log_differences
from minihuman.experiment.machine.events import KeyPressed, Noted, Stepped
from minihuman.log.read.session_reader import read_events, read_log
from minihuman.worlds.adapters.world import World
from tests.counts import count
from tests.machine import needs
from tests.web.browser import Somebody, browsing
from tests.web.interrupted import interrupt
from tests.web.protocols import study
from tests.web.serving import UPGRADE_DELAY_S, buffering_proxy, line, serving

pytestmark = [needs("chromium"), pytest.mark.program]
N_KEYS = 6
N_SESSIONS = count(1, 10)  # of each network
_NO_POSTS = """const send = fetch;
const refuse = () => Promise.reject(new TypeError("blocked"));
globalThis.fetch = (to, ...rest) => (String(to).startsWith("/socket") ? refuse() : send(to, ...rest));
"""
PICTURES = os.environ.get("MINIHUMAN_TEST_PICTURES", "")
CODES = {"Digit1": "1", "Digit2": "2", "Digit3": "3", "Enter": "enter"}


@pytest.mark.nightly(by_day=["closed"])
@pytest.mark.parametrize("upgrades", ["closed", "swallowed"])
def test_a_whole_session_is_played_on_key_where_sockets_are_blocked(
    tmp_path: Path, upgrades: Literal["closed", "swallowed"]
) -> None:
    with (
        serving(study(tmp_path, episodes=2, max_steps=N_KEYS), tmp_path) as served,
        line(served.port) as wire,
        browsing() as sit_down,
    ):
        wire.upgrades = upgrades
        somebody = sit_down(f"http://127.0.0.1:{wire.port}/#t={served.tokens[0]}")
        for _ in range(2):
            play_episode(somebody)
        somebody.to_end()
        assert somebody.errors == []
    [log] = tmp_path.rglob("*.mcap")
    check_whole(log)


def play_episode(somebody: Somebody) -> None:
    """Press each key of an episode."""
    somebody.to_play()
    for number in range(N_KEYS):
        somebody.press("123"[number % 3])
        somebody.page.wait_for_timeout(100)
    somebody.until("!s.playing")


def check_whole(log: Path) -> None:
    """Check that a log of two episodes began over HTTP, and has each press once and nothing to complain of."""
    events = list(read_events(log))
    assert read_log(log).facts["transport"] == "http"
    pressed = [event.key for event in events if isinstance(event, KeyPressed) and event.down and event.key in "123"]
    assert pressed == [*"123123"] * 2
    assert sum(isinstance(event, Stepped) for event in events) == 2 * N_KEYS
    assert [event.text for event in events if isinstance(event, Noted) and event.kind == "page"] == []
    assert list(find_log_differences(log, World)) == []


@pytest.mark.nightly
@pytest.mark.parametrize("network", ["delayed", "buffering"])
def test_sessions_are_whole_where_sockets_are_half_a_minute_late_or_a_proxy_buffers(
    tmp_path: Path, network: Literal["delayed", "buffering"]
) -> None:
    protocol = study(tmp_path, episodes=2, max_steps=N_KEYS)
    with (
        serving(protocol, tmp_path, links=N_SESSIONS) as served,
        line(served.port) as wire,
        buffering_proxy(served.port) as proxy_port,
        browsing() as sit_down,
    ):
        wire.upgrades = "delayed"
        port = wire.port if network == "delayed" else proxy_port
        people = [sit_down(f"http://127.0.0.1:{port}/#t={token}") for token in served.tokens]
        for somebody in people:
            play_episode(somebody)
        if network == "delayed":  # the sockets have come by then, if the pages still wait for them
            people[-1].page.wait_for_timeout(UPGRADE_DELAY_S * 1_000)
        for somebody in people:
            play_episode(somebody)
            somebody.to_end()
            assert somebody.errors == []
    logs = sorted(tmp_path.rglob("*.mcap"))
    assert len(logs) == N_SESSIONS
    for log in logs:
        check_whole(log)
    print(f"{network}: {len(logs)} sessions complete over HTTP, 0 presses lost or doubled")


@pytest.mark.nightly
@pytest.mark.parametrize("upgrades", ["closed", "swallowed"])
def test_cuts_kills_and_reloads_lose_nothing_over_http(
    tmp_path: Path, upgrades: Literal["closed", "swallowed"]
) -> None:
    kinds = ("cut", "kill", "reload")
    found = interrupt(tmp_path, times=count(3, 60), seed=5, kinds=kinds, upgrades=upgrades)
    assert found.logged == [CODES[code] for code in found.heard]
    assert found.steps == found.accepted
    assert found.complaints == []


def read_count(port: int, name: str) -> int:
    """Return one of the server's counts."""
    text = urlopen(f"http://127.0.0.1:{port}/metrics").read().decode()
    return int(next(row.split()[1] for row in text.splitlines() if row.startswith(f"minihuman_{name} ")))


@pytest.mark.nightly(by_day=["ar"])
@pytest.mark.parametrize(
    ("locale", "begins", "direction"),
    [("ar-EG", "لا يمكن", "rtl"), ("fr-CA", "L\N{RIGHT SINGLE QUOTATION MARK}étude", "ltr")],
    ids=["ar", "fr"],
)
def test_a_visit_that_nothing_gets_through_for_says_so_within_ten_seconds_and_begins_when_something_does(
    tmp_path: Path, locale: str, begins: str, direction: str
) -> None:
    with (
        serving(study(tmp_path, episodes=1), tmp_path) as served,
        line(served.port) as wire,
        browsing() as sit_down,
    ):
        wire.upgrades = "closed"
        somebody = sit_down("about:blank", locale=locale)
        page = somebody.page
        page.add_init_script(_NO_POSTS)
        page.goto(f"http://127.0.0.1:{wire.port}/#t={served.tokens[0]}")
        page.wait_for_selector("#unwelcomed")
        assert page.evaluate("performance.now()") < 10_000
        text = page.inner_text("#unwelcomed")
        assert text.startswith(begins)
        assert "N-1006-H" in text
        assert page.evaluate("document.documentElement.dir") == direction
        page.wait_for_timeout(100)
        assert read_count(served.port, "unwelcomed_pages_total") == 1
        if PICTURES:
            page.screenshot(path=f"{PICTURES}/unwelcomed-{locale}.png")
        wire.upgrades = "passed"
        somebody.until("s.welcomed")
        page.wait_for_selector("#unwelcomed", state="detached")
        assert somebody.errors == []
