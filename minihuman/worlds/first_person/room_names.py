"""Miniworld's names for what a room is, to read."""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from minihuman.worlds.upstream_names import WorldAttributeError

_INSTEAD = {
    **dict.fromkeys(("wall_segs", "wall_verts", "wall_norms", "wall_texcs"), "read env.unwrapped.wall_segs"),
    **dict.fromkeys(("floor_verts", "ceil_verts", "floor_texcs", "ceil_texcs"), "read outline.corners"),
    **dict.fromkeys(("wall_tex", "floor_tex", "ceil_tex"), "read wall, floor or ceiling, names of textures"),
    "add_portal": "call open(), or connect_rooms() of the world",
}


class RoomNames:
    """Mixed into every room."""

    __slots__ = ()

    if TYPE_CHECKING:
        outline: Any
        floor: str
        wall: str
        ceiling: str | None

    @property
    def mid_x(self) -> float:
        """Return the middle of the room along x."""
        return float(self.outline.max_x + self.outline.min_x) / 2

    @property
    def mid_z(self) -> float:
        """Return the middle of the room along z."""
        return float(self.outline.max_z + self.outline.min_z) / 2

    @property
    def area(self) -> float:
        """Return the area of the rectangle around the room, m²."""
        return float(self.outline.area)

    @property
    def num_walls(self) -> int:
        """Return how many walls the room has."""
        return len(self.outline.edges)

    @property
    def edge_dirs(self) -> NDArray[np.float64]:
        """Return where each wall leads, float64[n, 3]: a step of length 1."""
        return np.insert(np.array([edge.direction for edge in self.outline.edges]), 1, 0.0, axis=1)

    @property
    def edge_norms(self) -> NDArray[np.float64]:
        """Return where each wall faces, float64[n, 3]: a step of length 1 into the room."""
        return np.insert(np.array([edge.normal for edge in self.outline.edges]), 1, 0.0, axis=1)

    @property
    def neighbors(self) -> list[Any]:
        """Return an empty list, as in Miniworld, which fills none; ``portals`` say where the room leads."""
        return []

    @property
    def wall_tex_name(self) -> str:
        """Return the texture of the walls."""
        return self.wall

    @property
    def floor_tex_name(self) -> str:
        """Return the texture of the floor."""
        return self.floor

    @property
    def ceil_tex_name(self) -> str | None:
        """Return the texture of the ceiling; None without one."""
        return self.ceiling

    @property
    def no_ceiling(self) -> bool:
        """Return whether the room is open to the sky."""
        return self.ceiling is None

    def point_inside(self, p: ArrayLike) -> bool:
        """Return whether a point (x, y, z) is in the room, not on a wall."""
        x, _, z = np.asarray(p, np.float64).tolist()
        return bool(self.outline.contains(x, z))

    def __getattr__(self, name: str) -> Any:
        if name in _INSTEAD:
            advice = f"; {_INSTEAD[name]}"
        else:
            advice = ""
        raise WorldAttributeError(f"a room has no attribute {name!r}{advice}")
