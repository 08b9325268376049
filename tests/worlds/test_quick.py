"""Kernels are compiled in less time than Numba takes by itself: to the same code, and nothing else is touched."""

import operator
import re

import numba
import numpy as np
import pytest
from numba.core.registry import cpu_target
from numba.core.types import Function

from minihuman.worlds.kernels import QUICK, compiler

if not compiler(numba.__version__):
    pytest.skip(f"Numba {numba.__version__} compiles by itself", allow_module_level=True)

from minihuman.worlds.quick import Quick  # after what may skip: other versions may lack what it imports


def nearest(places, x, wanted):
    """Loops, comparisons, whole and real numbers, tuples, reading and writing arrays."""
    best, at = 1e9, -1
    for i in range(places.shape[0]):
        a, b = places[i, 0] - x, places[i, 1]
        away = np.sqrt(a * a + b * b) / max(abs(wanted[i & 3]), 1)
        if away < best and not (i % 3 == 1 or wanted[i & 3] == -2):
            best, at = min(away, best), i
            wanted[(i >> 1) & 3] += int(np.floor(away)) ^ 5
    return best, at


def compiled(**how):
    """The machine code of `nearest` with a kernel's options, without the names of what it calls."""
    function = numba.njit(error_model="numpy", no_cfunc_wrapper=True, no_cpython_wrapper=True, _nrt=False, **how)(
        nearest
    )
    function.compile("(float64[:, ::1], float64, int32[::1])")
    [code] = function.inspect_asm().values()
    lines = [line.strip() for line in code.splitlines()]
    names = re.compile(r"_ZN\w*|\.L\w+|<string>|\"[^\"]*\"")
    return [names.sub("NAME", line) for line in lines if line and not line.startswith((".", "#", "_"))]


def test_the_machine_code_is_what_numba_makes_by_itself():
    assert compiled(pipeline_class=Quick) == compiled()
    assert len(compiled(pipeline_class=Quick)) > 50


def named(x):
    """Operators called by name, and given to somebody else."""
    twice = operator.mul
    return operator.add(twice(x, 2), abs(x)) if operator.lt(x, 3) else operator.neg(x)


def test_an_operator_may_be_named_like_any_function():
    function = numba.njit(pipeline_class=Quick)(named)
    assert [function(x) for x in (-1, 2, 3)] == [-1, 6, -3]


def test_numba_compiles_all_else_as_before():
    compiled(pipeline_class=Quick)
    known = cpu_target.typing_context.resolve_value_type(operator.mul)
    assert type(known) is Function


def test_a_version_it_was_not_tried_with_compiles_by_itself():
    assert compiler(f"{QUICK[0]}.7") == {"pipeline_class": Quick}
    assert compiler("0.99.0") == compiler("0.6.8") == {}
