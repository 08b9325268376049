"""Takeovers by real keys in a real browser: key to changed pixels beside plain play, and how late they are stamped.

    python -m benchmarks.web_takeover [--keys 50] [--rtt 0 300] [--world minihuman/MiniGrid-FourRooms-v0]

As `benchmarks.web_latency`: an X server of its own (Xvfb), Chromium in it with a head, key events that the server
itself makes (XTEST), a TCP proxy that makes the line as long as asked. First a block of plain play, then one in which
an agent plays and every second key takes over from it, the other hands back. Every takeover has to be in the log.
Prints distributions; judges nothing.
"""

import argparse
import os
import random
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from Xlib.display import Display

import minihuman
from benchmarks.latency import UNSEEN_S, difference, distribution, turns
from benchmarks.takeover import PROTOCOL
from benchmarks.web_latency import SCREEN_PX, focus, watch
from minihuman.admin.protocol_file import read_protocol
from minihuman.admin.verify.log import find_log_differences
from minihuman.experiment.machine.events import Linked
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.log.model.session_log import EpisodeLog
from minihuman.log.model.teaching_events import TeachingRecord
from minihuman.log.read.reader import read_segment_starts
from minihuman.log.read.session_reader import read_events, read_log
from minihuman.worlds.adapters.world import World
from tests.web.browser import Somebody, browsing
from tests.web.serving import line, serving
from tests.xserver import Typist, xvfb

WEB = "\n[web]\nimage_size_px = [400, 300]\n"


@dataclass(frozen=True, slots=True)
class Found:
    """One session's keys, in ms."""

    play_pixels: list[float]
    takeover_pixels: list[float]
    play_flips: list[float]
    takeover_flips: list[float]
    stamps: list[float]  # how much later than it was sent a takeover is stamped
    error: float  # of the clocks' offset
    complaints: list[str]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--keys", type=int, default=50)
    parser.add_argument("--rtt", type=float, nargs="+", default=[0.0, 300.0])
    parser.add_argument("--world", default="minihuman/MiniGrid-FourRooms-v0")
    asked = parser.parse_args()
    print(f"minihuman {minihuman.__version__}, load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    for rtt_ms in asked.rtt:
        found = measure(asked.world, asked.keys, rtt_ms)
        print(f"line {rtt_ms:.0f} ms; clocks right to {found.error:.2f} ms; {found.complaints or 'proven'}")
        print(f"  play: key to pixels     {distribution(found.play_pixels)}")
        print(f"  takeover to pixels      {distribution(found.takeover_pixels)}")
        print(f"  takeover minus play     {difference(found.takeover_pixels, found.play_pixels)}")
        print(f"  play: key to flip       {distribution(found.play_flips)}")
        print(f"  takeover to flip        {distribution(found.takeover_flips)}")
        print(f"  takeover minus play     {difference(found.takeover_flips, found.play_flips)}")
        print(f"  stamp after it was sent {distribution(found.stamps)}", flush=True)


def measure(world: str, keys: int, rtt_ms: float) -> Found:
    """Turn left and right as often, alone and then beside an agent, each key when the one before was seen."""
    with tempfile.TemporaryDirectory() as name, xvfb(SCREEN_PX) as display:
        folder = Path(name)
        protocol = folder / "takeover.toml"
        protocol.write_text(PROTOCOL.format(world=world, actions=turns(world), keys=keys) + WEB)
        study = read_protocol(protocol)
        plain, beside = (
            list(episode.key_map.keys) for episode in expand_protocol(study, enrol_participant(study, 0)).episodes
        )
        screen: dict[str, Any] = {
            "headless": False,
            "env": {"DISPLAY": display},
            "size": None,
            "more": ("--kiosk", "--start-fullscreen"),
        }
        with serving(protocol, folder) as served, line(served.port, rtt_ms=rtt_ms) as wire, browsing(**screen) as sit:
            somebody = sit(f"http://127.0.0.1:{wire.port}/#t={served.tokens[0]}")
            typist, looking = Typist(display), Display(display)
            focus(looking)
            look = watch(looking)
            to_play(somebody, typist, rtt_ms)
            play = [press_and_see(typist, look, plain[number % 2]) for number in range(keys)]
            to_play(somebody, typist, rtt_ms)
            takeovers = []
            for number in range(keys):
                takeovers.append(press_and_see(typist, look, beside[number % 2]))
                if number + 1 < keys:
                    press_and_see(typist, look, "space")
            somebody.until("s.unsafe === 0")
            served.stop()
        [log] = folder.rglob("*.mcap*")
        return found_in(log, play, takeovers)


def to_play(somebody: Somebody, typist: Typist, rtt_ms: float) -> None:
    """Go on with Enter until an episode is played, and until the line's times and the first scenes are there."""
    somebody.until("s.welcomed && s.kind !== '' && !s.playing")
    for _ in range(200):
        if somebody.state["playing"]:
            break
        typist.tap("enter")
        somebody.page.wait_for_timeout(300 + 2 * rtt_ms)
    somebody.until("s.known")
    somebody.page.wait_for_timeout(6_000 + 4 * rtt_ms)


def press_and_see(typist: Typist, look: Any, key: str) -> tuple[float, int]:
    """How long it took until the picture was another, ms, and when the key was sent, ns since 1970."""
    before = look()
    time.sleep(random.uniform(0.08, 0.2))
    began_s, sent_ns = time.monotonic(), time.time_ns()
    typist.press(key)
    while look() == before and time.monotonic() - began_s < UNSEEN_S:
        time.sleep(0.0003)
    seen_ms = (time.monotonic() - began_s) * 1000
    typist.release(key)
    return seen_ms, sent_ns


def found_in(path: Path, play: list[tuple[float, int]], takeovers: list[tuple[float, int]]) -> Found:
    """What the log says of the same keys."""
    log = read_log(path if path.suffix == ".mcap" else path.parent)
    linked = [event for event in read_events(path) if isinstance(event, Linked)]
    best = min(linked, key=lambda event: event.least_rtt_ns)
    zero_ns = int(read_segment_starts(path)[1]) + best.offset_ns
    alone, taught = log.episodes[0], log.episodes[1].taught
    assert isinstance(taught, TeachingRecord)
    taken = [change.pressed_ns + zero_ns for change in taught.controls if change.reason == "key"]
    assert len(taken) == len(takeovers), f"{len(taken)} of {len(takeovers)} takeovers are in the log"
    return Found(
        play_pixels=[ms for ms, _ in play],
        takeover_pixels=[ms for ms, _ in takeovers],
        play_flips=flips(alone),
        takeover_flips=flips(log.episodes[1]),
        stamps=[(at_ns - sent_ns) / 1e6 for at_ns, (_, sent_ns) in zip(taken, takeovers, strict=True)],
        error=best.error_ns / 1e6,
        complaints=list(find_log_differences(path, World)),
    )


def flips(episode: EpisodeLog) -> list[float]:
    """From each step's key to the first flip of its picture, ms."""
    first = {frame.step: frame.flip_ns for frame in reversed(list(episode.frames))}
    return [(first[step] - at) / 1e6 for step, at in enumerate(episode.key_t_ns.tolist(), 1) if step in first]


if __name__ == "__main__":
    main()
