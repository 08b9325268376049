"""A third party's world that fails at its third step, in the way that its option says; "" plays on."""

import os
import signal
import sys
import time
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import spaces

FAULT_STEP = 3
ENDING_FAULTS = ("raise", "exit", "os_exit", "segfault", "hang", "none", "shape", "memory")
FAULTS = (*ENDING_FAULTS, "nan")  # a reward that is no number ends no session


class FaultyEnv(gymnasium.Env[Any, Any]):
    """Counts steps."""

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["rgb_array"]}

    def __init__(self, fault: str = "", render_mode: str | None = None) -> None:
        self.render_mode = render_mode
        self.fault = fault
        self.action_space = spaces.Discrete(2)
        self.observation_space = spaces.Box(0, 99, (1,), np.int64)
        self.steps = 0
        while fault == "loop_at_construction":
            pass

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        super().reset(seed=seed)
        self.steps = 0
        return np.array([0]), {}

    def step(self, action: int) -> Any:
        self.steps += 1
        if self.steps == FAULT_STEP and self.fault == "none":
            return None
        reward = _fail(self.fault) if self.steps == FAULT_STEP else 0.0
        info = {"is_success": True, "coins": np.int64(7), "large": 2**70, "other": object()}
        return np.array([self.steps]), reward, False, False, info

    def render(self) -> Any:
        is_bad = self.fault == "shape" and self.steps == FAULT_STEP
        return np.full((8, 8) if is_bad else (8, 8, 3), 10 * self.steps, np.uint8)


def _fail(fault: str) -> float:
    """Fail in that way; return the reward where that is no way to end."""
    match fault:
        case "raise":
            raise RuntimeError("the floor has gone")
        case "exit":
            sys.exit()
        case "os_exit":
            os._exit(0)
        case "segfault":
            os.kill(os.getpid(), signal.SIGSEGV)
        case "hang":
            _hang()
        case "memory":
            np.empty(2**45, np.uint8)  # more than any limit
        case "nan":
            return float("nan")
    return 0.0


def _hang() -> None:
    while True:
        time.sleep(3600)


gymnasium.register("tests/Faulty-v0", entry_point=FaultyEnv)
