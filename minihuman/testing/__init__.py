"""What every world, player, window and exporter promises, as checks that a lab runs on its own.

    from minihuman.testing import check_world

    def test_my_world():
        check_world("my_lab.envs:lab/Maze-v0")

Each raises `ContractError`, which names the promise that is not kept; ours all pass them.
"""

from minihuman.testing.exporter import check_exporter
from minihuman.testing.kept import ContractError
from minihuman.testing.player import check_player
from minihuman.testing.window import TypedWindow, check_window
from minihuman.testing.world import check_world

__all__ = ["ContractError", "TypedWindow", "check_exporter", "check_player", "check_window", "check_world"]
