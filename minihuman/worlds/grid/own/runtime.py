"""All that translated rules call, in one module, as which they know it.

Only the process that compiles rules imports it.
"""
# mypy: ignore-errors

from minihuman.worlds.grid.own.arithmetic import *  # noqa: F403
from minihuman.worlds.grid.own.elements import *  # noqa: F403
from minihuman.worlds.grid.own.grid_acts import *  # noqa: F403
from minihuman.worlds.grid.own.numba_forms import *  # noqa: F403
