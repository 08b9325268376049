"""A session in a browser that is interrupted at random: lines cut, pages loaded again, servers killed."""

import os
import random
import signal
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from minihuman.admin.verify.log import find_log_differences
from minihuman.experiment.machine.events import KeyPressed, Stepped
from minihuman.log.read.session_reader import read_events, read_log
from minihuman.worlds.adapters.world import World
from tests.counts import count
from tests.web.browser import Somebody, browser_processes, browsing
from tests.web.protocols import GRID, study
from tests.web.serving import Line, Serving, line, serving

KEYS_HZ = 6.0


@dataclass
class Interrupted:
    """What became of a session."""

    happened: Counter[str] = field(default_factory=Counter)
    heard: list[str] = field(default_factory=list)  # keys that went down in the page
    logged: list[str] = field(default_factory=list)
    accepted: int = 0  # presses that are to make a step
    steps: int = 0
    segments: int = 0
    complaints: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)  # of the page's own: what was shown and was not so


KINDS = "cut", "cut", "kill", "kill", "reload", "sleep"


def interrupt(
    folder: Path,
    *,
    times: int,
    seed: int,
    rtt_ms: float = 80.0,
    world=GRID,
    computed: str = "page",
    kinds: tuple[str, ...] = KINDS,
    upgrades: Literal["passed", "closed", "swallowed"] = "passed",
) -> Interrupted:
    """Play through as many interruptions of these kinds, then to the session's end."""
    chance = random.Random(seed)
    found = Interrupted()
    # the machine itself may be stopped meanwhile
    web = "image_size_px = [400, 300]\nreconnect_timeout_s = 86_400\nidle_timeout_s = 0"
    block = f'computed = "{computed}"'
    protocol = study(folder, world, episodes=max(4, times), max_steps=40, block=block, web=web)
    with (
        serving(protocol, folder) as served,
        line(served.port, rtt_ms=rtt_ms) as wire,
        browsing() as sit_down,
    ):
        wire.upgrades = upgrades
        somebody = sit_down(f"http://127.0.0.1:{wire.port}/#t={served.tokens[0]}")
        somebody.to_play()
        for _ in range(times):
            press(somebody, chance, chance.randint(4, 14))
            what = chance.choice(kinds)
            found.happened[what] += 1
            _do(what, somebody, served, wire, chance)
        press(somebody, chance, 6)
        somebody.until("s.welcomed && s.unsafe === 0")
        found.heard = somebody.page.evaluate("sessionStorage.getItem('heard')").split()
        assert somebody.errors == []
        served.stop()
    [part] = folder.rglob("*.mcap.part")
    events = list(read_events(part))
    presses = [event for event in events if isinstance(event, KeyPressed) and event.down and event.verdict != "repeat"]
    found.logged = [press.key for press in presses]
    found.accepted = sum(press.verdict == "accepted" and press.action is not None for press in presses)
    found.steps = sum(isinstance(event, Stepped) for event in events)
    found.complaints = list(find_log_differences(part, World))
    found.segments = len(read_log(part.parent).segments)
    found.notes = [event.text for event in events if getattr(event, "kind", "") == "page"]
    return found


def press(somebody: Somebody, chance: random.Random, count: int) -> None:
    """Press keys as quickly as a quick person; Enter where there is something to be read."""
    for _ in range(count):
        playing = somebody.state["playing"] or somebody.state["kind"] == "play"
        somebody.press(chance.choice("123") if playing else "enter")
        somebody.page.wait_for_timeout(1000 / KEYS_HZ)


def _do(what: str, somebody: Somebody, served: Serving, wire: Line, chance: random.Random) -> None:
    match what:
        case "cut":
            wire.cut()
            press(somebody, chance, chance.randint(0, 6))
            wire.mend()
        case "kill":
            served.kill()
            press(somebody, chance, chance.randint(0, 6))
            served.again()
        case "reload":
            somebody.page.reload()
            somebody.until("s.welcomed && s.kind !== ''")
        case "sleep":  # a laptop that is closed: its browser stands still, and most often its network is gone
            processes = browser_processes()
            assert processes
            for pid in processes:
                os.kill(pid, signal.SIGSTOP)
            if chance.random() < 0.7:
                wire.cut()
            time.sleep(
                chance.choice((0.3, 1.5, count(2.5, 12.0)))
            )  # over the server's patience with a silent page, too
            wire.mend()
            for pid in processes:
                os.kill(pid, signal.SIGCONT)
    if chance.random() < 0.7:  # else the next comes while this is being got over
        somebody.until("s.welcomed")
