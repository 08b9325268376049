"""A protocol tried against its worlds before anybody sits down."""

import pytest

from minihuman.errors import ProtocolError
from minihuman.experiment.plan.dry_run import check_worlds
from minihuman.experiment.protocol.protocol import Protocol, decode_protocol

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
    return decode_protocol(TOML.format(world=world, action=action).encode())


def test_a_world_that_fails_at_its_first_step_is_named_before_anybody_sits_down():
    corridor = "tests.worlds.corridor:tests/Corridor-v0"
    check_worlds(protocol(corridor, "forward"), "study.toml")
    with pytest.raises(ProtocolError) as caught:
        check_worlds(protocol(corridor, "crash"), "study.toml")
    assert str(caught.value) == (
        f"study.toml: $.blocks[0].world: {corridor} cannot be played (step() raised RuntimeError: the corridor has "
        "collapsed (corridor.py:41))"
    )
