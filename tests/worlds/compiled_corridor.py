"""A corridor with a compiled step ahead, never in the cache, that notes who laid it out."""

import os
import time
from pathlib import Path
from typing import Any

import gymnasium
from numba import njit

from tests.worlds.corridor import CorridorEnv


@njit
def ahead(cell: int) -> int:
    return cell + 1


class CompiledCorridorEnv(CorridorEnv):
    """``after`` makes compiling it take until the world of that name is noted."""

    def __init__(self, notes: str, name: str, after: str | None = None, render_mode: str | None = None) -> None:
        super().__init__(render_mode)
        self.notes = Path(notes)
        self.name = name
        self.after = after

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[int, dict[str, Any]]:
        with self.notes.open("a") as notes:
            notes.write(f"{self.name} {os.getpid()}\n")
        cold = not ahead.signatures
        ahead(0)
        deadline = time.monotonic() + 60
        while cold and self.after and f"{self.after} " not in self.notes.read_text() and time.monotonic() < deadline:
            time.sleep(0.05)
        return super().reset(seed=seed, options=options)


gymnasium.register("tests/CompiledCorridor-v0", entry_point=CompiledCorridorEnv)
