"""The source is the reference: without compilation the same worlds come out, number for number."""

import hashlib
import os
import subprocess
import sys

import gymnasium
import numpy as np
import pytest

import minihuman  # noqa: F401

WORLDS = (
    "FourRooms-v0",
    "DoorKey-6x6-v0",
    "Dynamic-Obstacles-5x5-v0",
    "LavaCrossingS9N2-v0",
    "MultiRoom-N2-S4-v0",
    "ObstructedMaze-1Dlhb-v0",
    "MemoryS7-v0",
    "PutNear-6x6-N2-v0",
)


def digest():
    """Everything that a few episodes of a few worlds show."""
    hashed = hashlib.sha256()
    for name in WORLDS:
        env = gymnasium.make(f"minihuman/MiniGrid-{name}", max_steps=25)
        chance = np.random.default_rng(0)
        for seed in (0, None):
            hashed.update(env.reset(seed=seed)[0]["image"].tobytes())
            over = False
            while not over:
                observation, reward, terminated, truncated, _ = env.step(int(chance.integers(env.action_space.n)))
                hashed.update(observation["image"].tobytes() + repr((reward, terminated, truncated)).encode())
                over = terminated or truncated
            hashed.update(repr(env.unwrapped.state_hash()).encode())
            hashed.update(env.unwrapped.picture(size_px=(21, 21)).tobytes())
    return hashed.hexdigest()


@pytest.mark.program
def test_without_compilation_the_same_worlds_come_out():
    code = "from tests.worlds.grid.test_plain_python import digest; print(digest())"
    plain = subprocess.run(
        [sys.executable, "-W", "error::RuntimeWarning", "-c", code],
        env=os.environ | {"NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert plain.returncode == 0, plain.stderr
    assert plain.stdout.strip() == digest()
