"""A protocol tried against its worlds before anybody sits down."""

import subprocess
import sys

import pytest

from minihuman.errors import ProtocolError
from minihuman.study.protocol import Protocol, decode
from minihuman.study.rehearse import warm_up

TOML = """
[study]
name = "rehearsal"
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
episodes = 1
max_steps = 2
actions = [{action!r}]
"""


def protocol(world: str, action: str) -> Protocol:
    return decode(TOML.format(world=world, action=action).encode())


def test_a_world_that_fails_at_its_first_step_is_named_before_anybody_sits_down():
    corridor = "tests.worlds.corridor:tests/Corridor-v0"
    warm_up(protocol(corridor, "forward"), "study.toml")
    with pytest.raises(ProtocolError) as caught:
        warm_up(protocol(corridor, "crash"), "study.toml")
    assert str(caught.value) == (
        f"study.toml: $.blocks[0].world: {corridor} fails (RuntimeError: the corridor has collapsed)"
    )


@pytest.mark.program
def test_after_warming_up_an_episode_compiles_nothing(tmp_path):
    """In a fresh process: a freeze in front of a participant would be the worst moment for it."""
    script = f"""
from numba.core import event
from minihuman.study.protocol import decode
from minihuman.study.rehearse import warm_up
from minihuman.worlds.adapt import World

warm_up(decode({TOML.format(world="minihuman/MiniGrid-FourRooms-v0", action="forward").encode()!r}))
class Compiled(event.Listener):
    def on_start(self, event): print(event.data["dispatcher"])
    def on_end(self, event): pass
event.register("numba:compile", Compiled())
world = World("minihuman/MiniGrid-FourRooms-v0")
for seed in range(3):
    world.reset(seed)
    for action in (2, 0, 1, 2, 2):
        world.step(action), world.frame(), world.pose(), world.map(), world.state_hash()
"""
    ran = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert ran.stdout == ""
