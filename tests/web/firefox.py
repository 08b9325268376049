"""A stock Firefox, driven by WebDriver BiDi over its own socket: no driver beside it, no patched build."""

import base64
import itertools
import json
import os
import re
import subprocess
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from websockets.sync.client import ClientConnection, connect

from tests.counts import PATIENCE_S
from tests.machine import need
from tests.programs import running

_KEYS = {"enter": "\ue007", "left": "\ue012", "up": "\ue013", "right": "\ue014"}
_QUIET = """
user_pref("app.update.enabled", false);
user_pref("browser.shell.checkDefaultBrowser", false);
user_pref("datareporting.policy.dataSubmissionEnabled", false);
user_pref("network.captive-portal-service.enabled", false);
user_pref("network.connectivity-service.enabled", false);
user_pref("services.settings.server", "data:,");
user_pref("remote.active-protocols", 1);
user_pref("browser.aboutwelcome.enabled", false);
user_pref("datareporting.policy.firstRunURL", "");
user_pref("toolkit.telemetry.reportingpolicy.firstRun", false);
"""
# Those that a driven Firefox sets for itself would have every window believe that it has the focus.
_FOCUS = """
user_pref("remote.prefs.recommended", false);
user_pref("focusmanager.testmode", false);
"""
_FINGERS = """
user_pref("dom.w3c_touch_events.enabled", 1);
user_pref("ui.primaryPointerCapabilities", 1);
user_pref("ui.allPointerCapabilities", 1);
"""  # a coarse pointer that cannot hover, and no other


@contextmanager
def firefox_at(
    url: str,
    profile: Path,
    *,
    phone_px: tuple[int, int] | None = None,
    environment: Mapping[str, str] | None = None,
    display: str | None = None,
) -> Iterator["Page"]:
    """Firefox with an empty profile, at a page.

    Args:
        url: the page's address.
        profile: a folder that does not exist yet.
        display: where it has a window; None: it has none.
        phone_px: a view of this size with two pixels per CSS pixel, and touch as the only pointer.
        environment: its environment variables instead of this process's.
    """
    profile.mkdir()
    preferences = _QUIET + _FINGERS * (phone_px is not None) + _FOCUS * (display is not None)
    (profile / "user.js").write_text(preferences)
    command = [need("firefox"), "--no-remote", "--profile", str(profile), "--remote-debugging-port", "0"]
    env = {
        **(environment or os.environ),
        "HOME": str(profile),
        "MOZ_HEADLESS_WIDTH": "1366",
        "MOZ_HEADLESS_HEIGHT": "768",
    }
    if display is None:
        command.append("--headless")
    else:
        env |= {"DISPLAY": display, "GDK_BACKEND": "x11"}
    with running(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, env=env) as process:
        try:
            assert process.stderr is not None
            said = (re.search(r"BiDi listening on (\S+)", line) for line in process.stderr)
            address = next(found[1] for found in said if found)
            with connect(f"{address}/session", max_size=None, compression=None, open_timeout=PATIENCE_S) as socket:
                page = Page(socket)
                if phone_px is not None:
                    page.resize(*phone_px)
                page.open(url)
                yield page
        finally:
            process.terminate()
            process.wait(PATIENCE_S)


class Page:
    """The one page of a Firefox.

    Args:
        socket: to its BiDi.
    """

    def __init__(self, socket: ClientConnection) -> None:
        self._socket = socket
        self._numbers = itertools.count(1)
        self._ask("session.new", capabilities={})
        self._context = self._ask("browsingContext.getTree")["contexts"][0]["context"]

    def open(self, url: str) -> None:
        """Go to an address."""
        self._ask("browsingContext.navigate", context=self._context, url=url, wait="complete")

    def press(self, *keys: str) -> None:
        """Press keys and let them go."""
        strokes = [{"type": kind, "value": _KEYS.get(key, key)} for key in keys for kind in ("keyDown", "keyUp")]
        source = {"type": "key", "id": "keyboard", "actions": strokes}
        self._ask("input.performActions", context=self._context, actions=[source])

    def resize(self, width: int, height: int) -> None:
        """Give the page a phone's view, with two pixels per CSS pixel."""
        view = {"width": width, "height": height}
        self._ask("browsingContext.setViewport", context=self._context, viewport=view, devicePixelRatio=2)

    def tap(self, selector: str) -> None:
        """Touch the middle of an element with a finger and lift it."""
        box = self.find(f"document.querySelector({selector!r}).getBoundingClientRect()")
        at = {"x": round(box["x"] + box["width"] / 2), "y": round(box["y"] + box["height"] / 2)}
        actions = [
            {"type": "pointerMove", **at},
            {"type": "pointerDown", "button": 0},
            {"type": "pointerUp", "button": 0},
        ]
        finger = {"type": "pointer", "id": "finger", "parameters": {"pointerType": "touch"}, "actions": actions}
        self._ask("input.performActions", context=self._context, actions=[finger])

    def screenshot(self, path: Path) -> None:
        """Write what is shown as a PNG."""
        shot = self._ask("browsingContext.captureScreenshot", context=self._context)
        path.write_bytes(base64.b64decode(shot["data"]))

    def find(self, expression: str) -> Any:
        """What an expression, or the promise that it is, comes to in the page."""
        asked = f"Promise.resolve({expression}).then((value) => JSON.stringify(value ?? null))"
        found = self._ask("script.evaluate", expression=asked, target={"context": self._context}, awaitPromise=True)
        assert found["type"] == "success", found
        return json.loads(found["result"]["value"])

    def run(self, script: str) -> None:
        """Run a script in the page."""
        self._ask("script.evaluate", expression=script, target={"context": self._context}, awaitPromise=False)

    def until(self, condition: str) -> None:
        """Wait until a condition of ``s``, the page's state, holds."""
        until_s = time.monotonic() + PATIENCE_S
        while not self.find(f"(() => {{ const s = minihuman.state; return Boolean({condition}); }})()"):
            assert time.monotonic() < until_s, f"never {condition}: {self.find('minihuman.state')}"
            time.sleep(0.02)

    def _ask(self, method: str, **params: object) -> Any:
        number = next(self._numbers)
        self._socket.send(json.dumps({"id": number, "method": method, "params": params}))
        while True:
            told = json.loads(self._socket.recv(timeout=PATIENCE_S))
            if told.get("id") == number:
                assert told["type"] == "success", told
                return told["result"]
