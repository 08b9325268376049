"""One row of the catalogue."""

from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True, slots=True)
class Entry:
    """A world's familiar name, where its class is, and what it is about."""

    name: str  # "MiniGrid-FourRooms-v0"; the id is "minihuman/" + name
    entry_point: str  # "minihuman.worlds.grid.env:GridEnv"
    kwargs: dict[str, Any] = field(default_factory=dict)
    vector_entry_point: str | None = None
    summary: str = ""
    guards_itself: bool = False  # it refuses misuse by itself: Gymnasium's two checking wrappers are left out

    @property
    def id(self) -> str:
        """The Gymnasium id."""
        return f"minihuman/{self.name}"
