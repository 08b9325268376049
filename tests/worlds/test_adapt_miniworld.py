"""Miniworld's own world through adapt.py, in a process of its own: pyglet's headless switch is per process."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.machine import needs

_COMPARE = """
import pyglet
pyglet.options["headless"] = True
from minihuman.worlds.adapters.world import World
theirs, ours = World("miniworld:MiniWorld-FourRooms-v0"), World("minihuman/MiniWorld-FourRooms-v0")
theirs.reset(5), ours.reset(5)
assert theirs.action_names == ours.action_names
hashes = {theirs.state_hash()}
for action in (0, 2, 2, 1, 2):
    one, other = theirs.step(action), ours.step(action)
    assert (one.reward, one.terminated, one.truncated) == (other.reward, other.terminated, other.truncated)
    assert theirs.pose() == ours.pose()
    hashes.add(theirs.state_hash())
assert len(hashes) == 6
assert set(theirs.map().walls) == set(ours.map().walls)
assert theirs.map().things == ours.map().things
assert theirs.map().bounds == ours.map().bounds
assert theirs.frame("partial").shape == theirs.frame("full").shape == (600, 800, 3)
print("as ours", flush=True)
import os
os._exit(0)  # pyglet's own shutdown wants its contexts back in an order we do not keep
"""


@needs("opengl")
@pytest.mark.program
def test_what_is_read_off_a_miniworld_world_is_what_ours_says_of_itself():
    root = Path(__file__).parents[2]
    done = subprocess.run([sys.executable, "-c", _COMPARE], cwd=root, capture_output=True, text=True, timeout=300)
    assert done.stdout.endswith("as ours\n"), done.stderr
