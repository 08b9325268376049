"""A plain file server for a site, which also takes what a page posts, and a person who goes through a site."""

import functools
import json
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

PROTOCOL = """
[study]
name = "thin"
version = "1"
seed = 3
participants = 4
closing = "That was all."

[keys]
pool = ["d", "f", "j", "k"]
keyboard_check = {keyboard_check}

[[pages]]
name = "consent"
title = "Consent"
asks_consent = true
text = "You will look for the green square."

[[groups]]
name = "one"
parts = ["consent", "rooms", "thoughts"]

[[blocks]]
name = "rooms"
world = "minihuman/{world}"
episodes = 2
actions = [{actions}]
max_steps = 30
feedback = "{{outcome}} after {{steps}} steps.\\nReward: {{reward:.2f}}"
{block}

[[questions]]
name = "thoughts"
title = "Your thoughts"

[[questions.items]]
name = "hard"
kind = "likert"
ask = "How hard was it?"
low = "easy"
high = "hard"

[[questions.items]]
name = "seen"
kind = "choice"
ask = "What did you see?"
options = ["a square", "a ball"]
"""


READ_ARCHIVE = """import("./static/archive.js").then(async ({ Archive }) => {
  const { makePart } = await import("./static/collectors.js");
  return makePart(await Archive.open("thin"), 0);
})"""


def write_protocol(folder: Path, *, world: str = "MiniGrid-Empty-5x5-v0", block: str = "", check: bool = False) -> Path:
    """Write a study with a consent, two episodes and two questions."""
    actions = '"turn_left", "turn_right", "move_forward"' if "MiniWorld" in world else '"left", "right", "forward"'
    path = folder / "thin.toml"
    path.write_text(
        PROTOCOL.format(world=world, actions=actions, block=block, keyboard_check=str(check).lower()), encoding="utf-8"
    )
    return path


@dataclass
class StaticHost:
    """A file server of a site; what is posted to it is kept."""

    address: str
    posted: list[dict[str, Any]] = field(default_factory=list)

    def write_posted(self, folder: Path) -> Path:
        """Write each posted part as a file."""
        folder.mkdir()
        for number, part in enumerate(self.posted):
            (folder / f"part-{number:03d}.json").write_text(json.dumps(part))
        return folder


@contextmanager
def hosting(folder: Path) -> Iterator[StaticHost]:
    """Serve a folder's files."""
    host = StaticHost("")

    class Handler(SimpleHTTPRequestHandler):
        def log_message(self, *_: object) -> None:
            pass

        def do_POST(self) -> None:
            host.posted.append(json.loads(self.rfile.read(int(self.headers["content-length"]))))
            self.send_response(204)
            self.end_headers()

    with listening(functools.partial(Handler, directory=str(folder))) as host.address:
        yield host


@contextmanager
def listening(handler: Callable[..., BaseHTTPRequestHandler]) -> Iterator[str]:
    """Serve on a free port of this machine; yields the address."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield f"http://127.0.0.1:{server.server_address[1]}/"
    finally:
        server.shutdown()
        server.server_close()


class Visitor:
    """A person who goes through a site."""

    def __init__(self, person: Any, script: dict[str, Any]) -> None:
        self.person = person
        self._keys = {
            int(number): {action: key for key, action in episode["rules"]["actions"].items()}
            for number, episode in script["episodes"].items()
        }

    def until_words(self, words: str) -> None:
        """Wait until words are on the screen and may be answered."""
        self.person.until_seen(f"s.welcomed && document.querySelector('#screen').innerText.includes({words!r})")

    def press(self, key: str) -> None:
        """Press a key by its name in a browser."""
        self.person.page.keyboard.press(key)

    def begin_episode(self, number: int) -> None:
        """Go on to an episode, and wait for its first picture."""
        self.press("Enter")
        self.person.until_seen(f"s.playing && s.step === 0 && !s.ended && s.kind === 'play' && {number} >= 0")

    def act(self, number: int, *actions: int) -> None:
        """Press the keys of actions; each answers the picture before it."""
        for action in actions:
            self.press(self._keys[number][action])
            self.person.page.wait_for_timeout(60)
