"""The two functions of translated source that Python calls, and the table of addresses that both read.

The table is int64. It contains addresses of arrays, lengths and numbers at the indices that this module names, and ends
with the record of a fault. The numbers of a batch's worlds are in matrices with a row for each world.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

(
    ROWS,
    ROW_LENGTH,
    OWN_NUMBERS,
    INT_SETTINGS,
    FLOAT_SETTINGS,
    RNG,
    MISSIONS,
    ACTIONS,
    REWARDS,
    TERMINATED,
    TRUNCATED,
    STEPPED,
    FIRST,
    LAST,
    WORLDS,
    COUNT,
    SCRATCH,
) = range(17)
FAULT = 20  # the fault's kind, its place, two numbers, and the world
BLOCK = 28  # the context of the present world, in the order of `context`
TABLE = 40  # the table's length

# The row's numbers in these texts are those of `minihuman.worlds.grid.core.state`: 8 is the phase, 23 a failed layout.
_CONTEXT = """
            block[0] = table[{ROWS}] + 4 * n * i
            block[1] = n
            block[2] = table[{OWN_NUMBERS}] + 8 * {own} * i
            block[3] = table[{INT_SETTINGS}] + 8 * {settings} * i
            block[4] = table[{FLOAT_SETTINGS}] + 8 * {floats} * i
            block[5] = table[{RNG}] + 48 * i
            block[6] = t + 8 * {FAULT}
            block[7] = table[{MISSIONS}] + 8 * {mission} * i
            block[8] = table[{SCRATCH}]
            table[{FAULT} + 4] = i"""

_LAYOUTS = """
@rt.njit
def layouts(t):
    table = rt.I64(t, {TABLE})
    n = table[{ROW_LENGTH}]
    c = t + 8 * {BLOCK}
    block = rt.I64(c, 9)
    worlds = rt.I64(table[{WORLDS}], table[{COUNT}])
    for k in range(table[{COUNT}]):
        i = worlds[k]
        if True:{context}
        rt.clear_row(rt.row(c))
        rt.clear_bodies(c, {bodies})
        rt.fill(c, 0, rt.view_1(rt.own(c), 0, {own}), 0)
        rt.fill(c, 0, rt.view_1(rt.mission(c), 0, {mission}), 0)
        {layout}(c)
        if rt.row(c)[23] != 0:
            rt.fail(c, -1, 5, 0, 0)
        rt.check_bodies(c, -1, {bodies})
        rt.row(c)[8] = 1
    return np.int64(0)
"""

_STEPS = """
@rt.njit
def steps(t):
    table = rt.I64(t, {TABLE})
    n = table[{ROW_LENGTH}]
    c = t + 8 * {BLOCK}
    block = rt.I64(c, 9)
    last = table[{LAST}]
    actions = rt.I64(table[{ACTIONS}], last * {bodies})
    rewards = rt.F64(table[{REWARDS}], last * {bodies})
    terminated = rt.U8(table[{TERMINATED}], last)
    truncated = rt.U8(table[{TRUNCATED}], last)
    stepped = rt.U8(table[{STEPPED}], last)
    for i in range(table[{FIRST}], last):
        if stepped[i]:
{context}
            {call}
            terminated[i] = ended
            rt.row(c)[8] = 2 if ended or truncated[i] else 1
            rt.check_bodies(c, -1, {bodies})
    return np.int64(0)
"""


def make_table(arrays: Mapping[int, NDArray[Any]]) -> NDArray[np.int64]:
    """Return a batch's table with the addresses of its arrays; the arrays must outlive the table.

    ``arrays`` has each array by its index in the table, such as `ROWS`.
    """
    table = np.zeros(TABLE, np.int64)
    for index, array in arrays.items():
        table[index] = array.ctypes.data
    rows = arrays[ROWS]
    table[ROW_LENGTH] = rows.shape[1]
    table[LAST] = len(rows)
    return table


def format_entries(
    *, layout: str, rule: str | None, bodies: int, is_team: bool, lengths: Mapping[str, int]
) -> list[str]:
    """Return the source lines of the functions ``layouts`` and, if there is a rule, ``steps``.

    Args:
        layout: the name of the translated layout.
        rule: the name of the translated `reward_and_done`; None without one.
        bodies: the number of bodies.
        is_team: whether the rules take an action and return a reward for each body.
        lengths: the numbers of elements in a world's declared fields ("own"), whole and float settings ("settings",
            "floats"), "mission" and "scratch" memory.
    """
    indices = {name: number for name, number in globals().items() if name.isupper() and isinstance(number, int)}
    context = _CONTEXT.format(**indices, **lengths)
    text = _LAYOUTS.format(**indices, **lengths, context=context, layout=layout, bodies=bodies)
    if rule is not None:
        call = _format_call(rule, bodies, is_team=is_team)
        text += _STEPS.format(**indices, context=context, bodies=bodies, call=call)
    return text.splitlines()


def _format_call(rule: str, bodies: int, *, is_team: bool) -> str:
    """Return the source lines that call a rule for one world and store its rewards.

    The parameters are those of `format_entries`.
    """
    if not is_team:
        return f"rewards[i], ended = {rule}(c, actions[i], rewards[i], terminated[i] != 0)"
    places = [f"i * {bodies} + {body}" for body in range(bodies)]
    actions = "".join(f"actions[{place}], " for place in places)
    rewards = "".join(f"rewards[{place}], " for place in places)
    stores = "\n            ".join(f"rewards[{place}] = earned[{body}]" for body, place in enumerate(places))
    return f"earned, ended = {rule}(c, ({actions}), ({rewards}), terminated[i] != 0)\n            {stores}"
