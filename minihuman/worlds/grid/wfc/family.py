"""The family of worlds by Wave Function Collapse: a preset names a picture and how it is read.

The pictures are our own, under the names that presets give them (`#` is a wall, `.` is free), because Minigrid's are
not part of its packages. There are so few patterns of 2 x 2 cells that the maze, the dungeon and the dots have the same
ones as Minigrid's pictures, and so give the same layouts; rooms and obstacles are different from Minigrid's.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.grid.core.cells import EMPTY, GREEN_GOAL, GREY_WALL
from minihuman.worlds.grid.core.placement import stand
from minihuman.worlds.grid.core.state import HEADER, HEIGHT, WIDTH, Row, put
from minihuman.worlds.grid.layout import Recipe
from minihuman.worlds.grid.missions import MissionSpace
from minihuman.worlds.grid.wfc.collapse import Overlaps, collapse, find_overlaps, largest_part
from minihuman.worlds.kernels import kernel
from minihuman.worlds.options import check_bool, check_one_of, check_whole
from minihuman.worlds.rng import RngState, integer, shuffle

PICTURES: Mapping[str, str] = MappingProxyType(
    {
        "SimpleMaze": """
            ######
            #...#.
            #.#.#.
            #.#...
            #.####
            #.....
        """,
        "ScaledMaze": """
            #########
            #...#...#
            #...#...#
            #...#...#
            ###.#.###
            #.......#
            #.#####.#
            #.......#
        """,
        "Fabric": """
            ##########
            #...#....#
            #...#....#
            #........#
            #...#....#
            ##.###.###
            #........#
            #...#....#
            #...#....#
        """,
        "Blackdots": """
            ......
            .#....
            ....#.
            ......
        """,
        "Angular": """
            #.....
            ##....
            ###...
            ##....
            #.....
            ......
        """,
        "Hogs": """
            ........
            .###....
            .#.#.##.
            .....#..
            .##.....
            ..#.###.
            ....#...
            ........
        """,
    }
)

ATTEMPTS = 1000  # to collapse a layout, as in Minigrid
LAYOUTS = 100  # that are tried until two free cells are connected; Minigrid raises an error at the first
MAX_WFC_CELLS = 64  # on a side: collapsing takes at most a second with our pictures
MAX_WFC_PIXELS = 64  # on a side of a picture


class Preset(NamedTuple):
    """A picture's name, the number of cells on a side of its patterns, and whether layouts wrap around their edges."""

    picture: str
    width: int
    periodic: bool


PRESETS: Mapping[str, Preset] = MappingProxyType(
    {
        "MazeSimple": Preset("SimpleMaze", 2, False),
        "DungeonMazeScaled": Preset("ScaledMaze", 2, True),
        "RoomsFabric": Preset("Fabric", 3, False),
        "ObstaclesBlackdots": Preset("Blackdots", 2, False),
        "ObstaclesAngular": Preset("Angular", 3, True),
        "ObstaclesHogs3": Preset("Hogs", 3, True),
    }
)


@dataclass(frozen=True, slots=True, kw_only=True)
class WfcRecipe(Recipe):
    """A recipe whose layout is collapsed from a picture's patterns; the start, the goal and the direction are drawn.

    Attributes:
        name: the name of the preset, for errors.
        overlaps: the patterns, and which of them may be adjacent.
        periodic: whether layouts wrap around their edges.
        connected: whether only the largest connected part of a layout stays free.
    """

    name: str
    overlaps: Overlaps
    periodic: bool
    connected: bool

    def lay_out(self, row: Row, rng_state: RngState) -> None:
        """Lay out an episode in a cleared row.

        Raises:
            WorldError: if every attempt ends in contradiction, or no layout has two connected cells.
        """
        size = int(row[WIDTH]) - 2  # without the outer walls
        dig(row, rng_state, np.array(self._draw_free_cells(rng_state, size), np.int64))

    def _draw_free_cells(self, rng_state: RngState, size: int) -> list[tuple[int, int]]:
        """Draw a layout of ``size`` cells on a side; return its free cells (x, y), at least two.

        If ``connected`` is set, return only those of the largest connected part.

        Raises:
            WorldError: if every attempt ends in contradiction, or no layout has two connected cells.
        """
        for _ in range(LAYOUTS):
            patterns = collapse(
                rng_state, self.overlaps.weights, self.overlaps.adjacency, size, self.periodic, ATTEMPTS
            )
            if not len(patterns):
                raise WorldError(
                    f"{self.name}: {ATTEMPTS} attempts at {size} x {size} cells ended in contradiction; use another "
                    "size or picture"
                )
            free = [(x, y) for x, y in np.argwhere(~self.overlaps.walls[patterns].reshape(size, size)).tolist()]
            if self.connected:
                cells = largest_part(free)
            else:
                cells = free
            if len(cells) > 1:
                return cells
        raise WorldError(f"{self.name}: no two free cells of {size} x {size} are connected; use a larger size")


def wfc(
    *, wfc_config: str = "MazeSimple", size: int = 25, ensure_connected: bool = True, patterns: str | None = None
) -> WfcRecipe:
    """Return the recipe of a maze by Wave Function Collapse.

    Args:
        wfc_config: the preset, which names a picture and how it is read.
        size: the number of cells on a side, including the outer walls.
        ensure_connected: whether only the largest connected part stays free.
        patterns: a folder of pictures to use instead of ours, named as in the preset (``SimpleMaze.png``).

    Raises:
        WorldError: if an option is not valid, or the picture cannot be read or has an unsuitable size.
    """
    preset = PRESETS[check_one_of("wfc_config", wfc_config, tuple(PRESETS))]
    check_whole("size", size, 5, MAX_WFC_CELLS)
    check_bool("ensure_connected", ensure_connected)
    if patterns is None:
        pattern_overlaps = _read_built_in_picture(preset.picture, preset.width)
    else:
        pattern_overlaps = _read_picture_file(patterns, preset)
    return WfcRecipe(
        layout=dig,
        numbers=(),
        width=size,
        height=size,
        max_steps=20 * size,
        mission=MissionSpace("traverse the maze to get to the goal"),
        name=wfc_config,
        overlaps=pattern_overlaps,
        periodic=preset.periodic,
        connected=ensure_connected,
    )


@cache
def _read_built_in_picture(picture: str, width: int) -> Overlaps:
    """Return the patterns of one of `PICTURES`, ``width`` pixels on a side, and which may be adjacent."""
    lines = PICTURES[picture].split()
    is_free = np.array([[sign != "#" for sign in line] for line in lines])
    pixels = np.repeat(255 * is_free[:, :, None], 3, axis=2).astype(np.uint8)
    return find_overlaps(pixels, width)


def _read_picture_file(folder: str, preset: Preset) -> Overlaps:
    """Return the patterns of a preset's picture in a folder of PNG files, and which may be adjacent.

    Raises:
        WorldError: if the folder is not a path, or the picture cannot be read or has an unsuitable size.
    """
    from PIL import Image, UnidentifiedImageError  # only for pictures of the user's own

    if not isinstance(folder, str):
        raise WorldError(f"patterns must be the path of a folder, not {folder!r}")
    path = Path(folder, f"{preset.picture}.png")
    try:
        with Image.open(path) as image:
            if max(image.size) > MAX_WFC_PIXELS or min(image.size) < preset.width:
                raise WorldError(
                    f"{path} is {image.size[0]} x {image.size[1]} pixels; "
                    f"each side must have {preset.width} to {MAX_WFC_PIXELS} pixels"
                )
            pixels = np.asarray(image.convert("RGB"))
    except (OSError, UnidentifiedImageError, ValueError) as error:
        raise WorldError(
            f"the pattern {path} cannot be read as a picture ({error}); name a folder that has it with patterns"
        ) from None
    return find_overlaps(pixels, preset.width)


@kernel("(int32[::1], uint64[::1], int64[:, ::1])")
def dig(row: Row, rng_state: RngState, free: NDArray[np.int64]) -> None:
    """Fill the grid with walls except the free cells of a layout, and draw the start and the goal among these.

    ``free`` has the column and row of each free cell, int64[n, 2].

    The layout has no outer walls, so its cell (0, 0) is the grid's cell (1, 1).
    """
    height = row[HEIGHT]
    for k in range(HEADER, HEADER + row[WIDTH] * height):
        row[k] = GREY_WALL
    for x, y in free:
        row[HEADER + (x + 1) * height + y + 1] = EMPTY
    order = np.arange(len(free))
    shuffle(rng_state, order)
    start = order[0]
    goal = order[1]
    put(row, free[goal, 0] + 1, free[goal, 1] + 1, GREEN_GOAL)
    stand(row, free[start, 0] + 1, free[start, 1] + 1, integer(rng_state, 0, 4))
