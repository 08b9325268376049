"""Miniworld's names for the properties of a room, for reading."""

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
    """A mixin of every room that adds Miniworld's names."""

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
        """Return the area of the rectangle around the room in m²."""
        return float(self.outline.area)

    @property
    def num_walls(self) -> int:
        """Return the number of the room's walls."""
        return len(self.outline.edges)

    @property
    def edge_dirs(self) -> NDArray[np.float64]:
        """Return the unit vector along each wall, float64[n, 3]."""
        return np.insert(np.array([edge.direction for edge in self.outline.edges]), 1, 0.0, axis=1)

    @property
    def edge_norms(self) -> NDArray[np.float64]:
        """Return the unit normal of each wall into the room, float64[n, 3]."""
        return np.insert(np.array([edge.normal for edge in self.outline.edges]), 1, 0.0, axis=1)

    @property
    def neighbors(self) -> list[Any]:
        """Return an empty list, as in Miniworld; ``portals`` say where the room leads."""
        return []

    @property
    def wall_tex_name(self) -> str:
        """Return the name of the walls' texture."""
        return self.wall

    @property
    def floor_tex_name(self) -> str:
        """Return the name of the floor's texture."""
        return self.floor

    @property
    def ceil_tex_name(self) -> str | None:
        """Return the name of the ceiling's texture; None without a ceiling."""
        return self.ceiling

    @property
    def no_ceiling(self) -> bool:
        """Return whether the room is open to the sky."""
        return self.ceiling is None

    def point_inside(self, p: ArrayLike) -> bool:
        """Return whether a point (x, y, z) is in the room and not on a wall."""
        x, _, z = np.asarray(p, np.float64).tolist()
        return bool(self.outline.contains(x, z))

    def __getattr__(self, name: str) -> Any:
        if name in _INSTEAD:
            advice = f"; {_INSTEAD[name]}"
        else:
            advice = ""
        raise WorldAttributeError(f"a room has no attribute {name!r}{advice}")
