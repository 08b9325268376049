"""Sessions really played, quickly: the session machine, a simulated participant, the recorder on disk."""

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np

from minihuman.lab.next_session import next_session
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.players.choose import make_player
from minihuman.seats.run import run_session
from minihuman.seats.simulated import SimulatedWindow
from minihuman.study.protocol import Protocol, decode
from minihuman.study.session import Session
from minihuman.windows.scripted import VirtualClock
from minihuman.worlds.adapt.world import World

STARTED_NS = 1_790_000_000_123_456_789
TOML = """
[study]
name = "promised"
version = "1"
seed = 11
participants = 40
consent = "I take part of my own free will."
closing = "Thank you."
[keys]
pool = ["1", "2", "3", "4", "q"]
[[groups]]
name = "all"
blocks = ["small"]
[[blocks]]
name = "small"
world = "minihuman/MiniGrid-Empty-5x5-v0"
actions = ["left", "right", "forward"]
max_steps = {steps}
episodes = {episodes}
feedback = "{{outcome}}"
"""


def study(*, episodes: int = 4, steps: int = 30, more: str = "") -> Protocol:
    """A protocol of one block of a small grid world."""
    return decode((TOML.format(episodes=episodes, steps=steps) + more).encode())


def play(
    data: Path,
    protocol: Protocol,
    *,
    player: str = "random",
    seed: int = 5,
    sync: Callable[[int], None] = os.fsync,
    started_ns: int = STARTED_NS,
    facts: Mapping[str, str] = MappingProxyType({}),
) -> Path:
    """Play the next participant's session on a virtual clock, and give its log."""
    plan = next_session(protocol, data)
    clock = VirtualClock()
    session = Session(plan, World, {"player": player, "window": "simulated", **facts}, picture_px=None)
    recorder = McapRecorder(data, plan, started_ns=started_ns, sync=sync)
    window = SimulatedWindow(make_player(player, np.random.default_rng(seed)), session, clock)
    log = run_session(session, window, recorder, clock)
    assert log is not None
    return log
