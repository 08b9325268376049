"""Our own pictures to collapse from, under the names that presets give them: ``#`` is wall, ``.`` is free.

Minigrid's are no part of its packages. Of patterns of 2 x 2 cells there are so few that the maze, the dungeon and the
dots hold the same ones as Minigrid's pictures, and so give the same layouts; rooms and obstacles are of our own kind.
"""

from collections.abc import Mapping
from types import MappingProxyType

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
