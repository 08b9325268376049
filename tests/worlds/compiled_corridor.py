"""A corridor with a compiled step ahead, never in the cache, that notes who laid it out."""

import os
from pathlib import Path
from typing import Any

import gymnasium
from numba import njit

from tests.worlds.corridor import CorridorEnv


@njit
def ahead(cell: int) -> int:
    return cell + 1


class CompiledCorridorEnv(CorridorEnv):
    def __init__(self, notes: str, name: str, render_mode: str | None = None) -> None:
        super().__init__(render_mode)
        self.notes = Path(notes)
        self.name = name

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[int, dict[str, Any]]:
        with self.notes.open("a") as notes:
            notes.write(f"{self.name} {os.getpid()}\n")
        ahead(0)
        return super().reset(seed=seed, options=options)


gymnasium.register("tests/CompiledCorridor-v0", entry_point=CompiledCorridorEnv)
