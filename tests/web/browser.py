"""A real browser for tests: Debian's Chromium, driven by Playwright, and a participant in it. Firefox: `firefox`."""

import asyncio
import atexit
import math
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

from tests import processes
from tests.counts import PATIENCE_S
from tests.machine import need

PATIENCE_MS = int(os.environ.get("MINIHUMAN_BROWSER_PATIENCE_S", PATIENCE_S)) * 1_000
_QUIET_S = 20  # that a condition may stay away before standard error has it, and what is on the screen instead
_ARGUMENTS = ("--no-sandbox", "--force-color-profile=srgb", "--disable-background-networking")
_LOOK_FOR = """() => new Promise((resolve) => {
  let looks = 40;
  const look = () => {
    const s = minihuman.state;
    if (CONDITION) resolve(true);
    else if (--looks === 0) resolve(false);
    else setTimeout(look, 10);
  };
  look();
})"""
_PAGE_IS_LEFT = ("Execution context was destroyed", "because of a navigation")  # what an unfinished look ends with
_CODES = {
    "enter": "Enter",
    "escape": "Escape",
    "tab": "Tab",
    "space": "Space",
    "period": "Period",
    "backspace": "Backspace",
    "home": "Home",
    "end": "End",
    "page_up": "PageUp",
    "page_down": "PageDown",
} | {arrow: f"Arrow{arrow.capitalize()}" for arrow in ("left", "right", "up", "down")}


@contextmanager
def browsing(*, size: tuple[int, int] | None = (1366, 768)) -> Iterator[Any]:
    """A browser without a history; yields a maker of participants, each with a profile of their own."""
    view: dict[str, Any] = (
        {"no_viewport": True} if size is None else {"viewport": {"width": size[0], "height": size[1]}}
    )
    contexts = []
    need("chromium")  # before its driver is started

    def sit_down(url: str, **options: Any) -> Somebody:
        contexts.append(_browser().new_context(**view, **options))
        return Somebody(contexts[-1], url)

    with driving():
        try:
            yield sit_down
        finally:
            for context in contexts:
                with suppress(pytest.importorskip("playwright.sync_api").Error):  # else it hides why the test failed
                    context.close()


@contextmanager
def launch_on_display(display: str) -> "Iterator[Callable[[str], Somebody]]":
    """A browser with a window of its own on a display; yields a maker of participants."""
    where = need("chromium")
    with driving() as driver:
        browser = driver.chromium.launch(
            executable_path=where, headless=False, args=list(_ARGUMENTS), env={**os.environ, "DISPLAY": display}
        )

        def sit_down(url: str) -> Somebody:
            person = Somebody(browser.new_context(no_viewport=True), url)
            line = person.page.context.new_cdp_session(person.page)
            line.send("Emulation.setFocusEmulationEnabled", {"enabled": False})  # else no page ever loses the focus
            return person

        try:
            yield sit_down
        finally:
            browser.close()


@contextmanager
def browsing_with_profile(profile: Path) -> "Iterator[tuple[Somebody, Callable[[], None]]]":
    """A browser with a profile that outlives it; yields a participant on an empty page, and what kills the browser."""
    where = need("chromium")
    playwright = pytest.importorskip("playwright.sync_api")
    with driving() as driver:
        context = driver.chromium.launch_persistent_context(
            str(profile), executable_path=where, headless=True, args=list(_ARGUMENTS)
        )

        def kill() -> None:
            for pid in browser_processes(str(profile)):
                with suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)

        try:
            yield Somebody(context, "about:blank"), kill
        finally:
            with suppress(playwright.Error):
                context.close()


_RUNNING: dict[str, Any] = {}  # the driver of this process, its event loop, and the browser that tests share


@contextmanager
def driving() -> Iterator[Any]:
    """Enter the one driver of this process; its browser starts once, because starting costs a second.

    Its event loop counts as running only within the block: tests that come between run loops of their own.
    """
    playwright = pytest.importorskip("playwright.sync_api")
    before = asyncio._get_running_loop()
    if "driver" not in _RUNNING:
        with processes.kept_for_the_run():
            _RUNNING["driver"] = playwright.sync_playwright().start()
        _RUNNING["loop"] = asyncio._get_running_loop()
        atexit.register(close_browser)
    asyncio._set_running_loop(_RUNNING["loop"])
    try:
        yield _RUNNING["driver"]
    finally:
        asyncio._set_running_loop(before)


def _browser() -> Any:
    """Return the browser that tests share; another where a test ended it."""
    browser = _RUNNING.get("browser")
    if browser is None or not browser.is_connected():
        with processes.kept_for_the_run():
            browser = _RUNNING["driver"].chromium.launch(
                executable_path=need("chromium"), headless=True, args=list(_ARGUMENTS)
            )
        _RUNNING["browser"] = browser
    return browser


def close_browser() -> None:
    """End the browser and its driver, if a test used them."""
    if "driver" not in _RUNNING:
        return
    asyncio._set_running_loop(_RUNNING["loop"])
    if "browser" in _RUNNING:
        _RUNNING["browser"].close()
    _RUNNING["driver"].stop()
    asyncio._set_running_loop(None)
    _RUNNING.clear()


def browser_processes(profile: str = "") -> list[int]:
    """The processes of the browsers that this process started, or of the one with a profile."""
    parents: dict[int, int] = {}
    commands: dict[int, str] = {}
    for folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            pid = int(folder.name)
            parents[pid] = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
            commands[pid] = (folder / "cmdline").read_text()

    def is_own(pid: int) -> bool:
        return pid == os.getpid() or (pid in parents and is_own(parents[pid]))

    return [
        pid
        for pid, command in commands.items()
        if "chrom" in command.split("\0")[0] and profile in command and is_own(pid)
    ]


_IN_PLAY = "s.playing && s.known && s.step >= 0 && !s.ended"


def _is_in_play(state: dict[str, Any]) -> bool:
    return state["playing"] and state["known"] and state["step"] >= 0 and not state["ended"]


class Somebody:
    """A person in front of a page."""

    def __init__(self, context: Any, url: str) -> None:
        self.page = context.new_page()
        self.errors: list[str] = []
        self.sockets: list[str] = []  # the addresses of those it opened
        self.page.on("websocket", lambda socket: self.sockets.append(socket.url))
        self.page.on("pageerror", lambda error: self.errors.append(str(error)))
        self.page.set_default_timeout(PATIENCE_MS)
        # what the page hears, whatever becomes of it: kept over reloads
        self.page.add_init_script(
            "addEventListener('keydown', (e) => { if (!e.repeat) sessionStorage.setItem('heard', "
            "(sessionStorage.getItem('heard') ?? '') + e.code + ' '); }, true);"
        )
        self.page.goto(url)

    @property
    def state(self) -> dict[str, Any]:
        return self.page.evaluate("minihuman.state")

    def until(self, condition: str, *, patience_s: float = PATIENCE_MS / 1000) -> None:
        """Wait until a condition of ``s``, the page's state, holds.

        It presses nothing: `to_play` goes on to the next episode, and `to_end` to the session's end. After 20 s,
        standard error has what it waits for and what is on the screen instead (``pytest -s``, or the failure's report);
        ``MINIHUMAN_BROWSER_PATIENCE_S=30`` has every wait fail after 30 s.
        """
        until_s = time.monotonic() + patience_s
        report_s = time.monotonic() + _QUIET_S
        while not self._holds(condition):
            if time.monotonic() > report_s:
                print(f"still waiting for {condition}; on the screen:\n{self.screen()}", file=sys.stderr)
                report_s = math.inf
            assert time.monotonic() < until_s, f"never {condition}: {self.state}\n{self.screen()}\n{self.errors}"

    def _holds(self, condition: str) -> bool:
        """Tell whether it holds within the time that the page looks itself: being asked costs twenty times as much."""
        try:
            return bool(self.page.evaluate(_LOOK_FOR.replace("CONDITION", condition)))
        except pytest.importorskip("playwright.sync_api").Error as error:
            if not any(words in str(error) for words in _PAGE_IS_LEFT):
                raise
            return False

    def until_seen(self, condition: str = "true") -> None:
        """Wait until it holds and is on the display: a key before that answers nothing, by rule."""
        self.until(condition)
        self.page.evaluate("new Promise((seen) => requestAnimationFrame(() => requestAnimationFrame(seen)))")

    def press(self, *keys: str) -> None:
        for key in keys:
            self.page.keyboard.press(_CODES.get(key) or (f"Digit{key}" if key.isdigit() else f"Key{key.upper()}"))

    def screen(self) -> str:
        """What is on the screen, in words."""
        return self.page.inner_text("#screen")

    def to_play(self) -> None:
        """Go on with Enter through what is to be read, until an episode is played."""
        self.until("s.welcomed && s.kind !== ''")
        until_s = time.monotonic() + PATIENCE_MS / 1000
        while True:
            self.until(f"({_IN_PLAY}) || !s.playing")  # an episode that begins, or has just ended, asks for nothing
            if _is_in_play(self.state):
                return
            assert time.monotonic() < until_s, self.screen()
            if self.page.locator(".keyboard").count():
                self.press(*(cap for cap in self.page.locator(".keyboard li .cap span").all_inner_texts()))
            else:
                self.press("enter")
            self.page.wait_for_timeout(60)

    def sit_through(self) -> None:
        """Go on with Enter, but press nothing in trials and other play, until nothing follows."""
        while not self.state["finished"]:
            if self.state["kind"] not in ("trial", "blank", "play"):
                self.press("enter")
            self.page.wait_for_timeout(200)

    def to_end(self) -> None:
        """Go on with Enter until nothing follows."""
        until_s = time.monotonic() + PATIENCE_MS / 1000
        while not self.state["finished"]:
            assert time.monotonic() < until_s, self.screen()
            self.press("enter")
            self.page.wait_for_timeout(100)
