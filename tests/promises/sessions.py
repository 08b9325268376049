"""Sessions really played, quickly: the session machine, a simulated participant, the recorder on disk."""

import os
from collections.abc import Callable, Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np

from minihuman.admin.next_session import plan_next_session
from minihuman.display.windows.window import VirtualClock
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.protocol.protocol import Protocol, decode_protocol
from minihuman.log.record.disk import RecorderSettings
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.runtime.session_loop import run_session
from minihuman.runtime.simulated_window import SimulatedWindow
from minihuman.simulation.participant import make_participant
from minihuman.worlds.adapters.world import World

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
    return decode_protocol((TOML.format(episodes=episodes, steps=steps) + more).encode())


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
    plan = plan_next_session(protocol, data)
    clock = VirtualClock()
    session = SessionMachine(plan, World, {"player": player, "window": "simulated", **facts}, picture_px=None)
    recorder = McapRecorder(data, plan, started_ns=started_ns, settings=RecorderSettings(sync=sync))
    window = SimulatedWindow(make_participant(player, np.random.default_rng(seed)), session, clock)
    log = run_session(session, window, recorder, clock)
    assert log is not None
    return log
