"""Tries what it is told on its standard input, a world and its options a line, as check and simulate would."""

import json
import sys
import traceback

import numpy as np
from msgspec.structs import replace

from minihuman.display.windows.window import VirtualClock
from minihuman.errors import MinihumanError, WorldError
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.plan.dry_run import check_worlds
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.log.record.recorder import MemoryRecorder
from minihuman.runtime.session_loop import run_session
from minihuman.runtime.simulated_window import SimulatedWindow
from minihuman.simulation.participant import make_participant
from minihuman.worlds.adapters.world import World

TOML = """
[study]
name = "options"
version = "1"
seed = 1
[keys]
pool = ["1", "2"]
[[groups]]
name = "all"
blocks = ["only"]
[[blocks]]
name = "only"
world = {world!r}
episodes = 2
max_steps = 1
actions = [{action!r}]
"""


def outcome(world_id: str, options: dict[str, object]) -> str:
    action = "turn_left" if "MiniWorld" in world_id else "left"
    protocol = decode_protocol(TOML.format(world=world_id, action=action).encode())
    protocol = replace(protocol, blocks=(replace(protocol.blocks[0], options=options),))
    try:
        check_worlds(protocol, "study.toml")
    except MinihumanError as error:
        said = str(error)
        if "\n" in said or "$.blocks[0]" not in said:
            return f"broken: refused in words that nobody can use: {said!r}"
        return f"refused: {said}"
    simulate(protocol)
    world = World(world_id, options)
    world.reset(0)
    try:
        world.shortest_path(), world.path_length_bounds()
    except WorldError as error:  # it may say that it would take too long
        return f"played; {str(error).splitlines()[0]}"
    return "played"


def simulate(protocol) -> None:
    plan = expand_protocol(protocol, enrol_participant(protocol, 0))
    clock, session = VirtualClock(), SessionMachine(plan, World, {}, picture_px=None)
    window = SimulatedWindow(make_participant("random", np.random.default_rng(0)), session, clock)
    run_session(session, window, MemoryRecorder(), clock)


def main() -> None:
    for line in sys.stdin:
        try:
            said = outcome(*json.loads(line))
        except Exception:
            said = "broken: " + " | ".join(traceback.format_exc().splitlines()[-4:])
        print(said, flush=True)


if __name__ == "__main__":
    main()
