"""The functions that translated rules call, collected in one module, which they know as ``rt``.

Only the process that compiles rules imports this module.
"""
# mypy: ignore-errors

from minihuman.worlds.grid.own.arithmetic import *  # noqa: F403
from minihuman.worlds.grid.own.elements import *  # noqa: F403
from minihuman.worlds.grid.own.grid_acts import *  # noqa: F403
from minihuman.worlds.grid.own.numba_forms import *  # noqa: F403
