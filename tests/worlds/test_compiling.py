"""A person who waits for the compiler reads why, once, and only where something is compiled."""

import os
import subprocess
import sys

import pytest

from minihuman.worlds.compiling import LINE

pytestmark = pytest.mark.program

CODE = "from minihuman.worlds.grid.core.cells import kind_of, lets_pass; kind_of(5), lets_pass(5)"


def said(folder):
    return subprocess.run(
        [sys.executable, "-c", CODE],
        env=os.environ | {"NUMBA_CACHE_DIR": str(folder)},
        capture_output=True,
        text=True,
        check=True,
    ).stderr


@pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="nothing is compiled then")
def test_compiling_is_announced_once_and_never_again_on_this_machine(tmp_path):
    assert said(tmp_path).splitlines() == [LINE]
    assert said(tmp_path) == ""
