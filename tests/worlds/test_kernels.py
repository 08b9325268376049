"""Kernels run from a library that was compiled before, which is never older than its sources; and without one."""

import importlib
import inspect
import os
import pickle
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from minihuman.errors import MinihumanError
from minihuman.worlds import build, kernels, library_manifest
from minihuman.worlds.grid.core.rules import step
from minihuman.worlds.grid.core.search import distances
from minihuman.worlds.grid.core.state import HEIGHT, WIDTH, clear, row_length
from minihuman.worlds.kernels import COMPILE_NOTICE, KERNELS, LateKernel, load_library
from minihuman.worlds.library_manifest import LIBRARY_FOLDER, PACKAGE
from tests.worlds.build.checkouts import CELLS, copy_checkout, edit_kernel

ROOT = Path(__file__).parents[2]
native = pytest.mark.skipif(
    bool({"NUMBA_DISABLE_JIT", "MINIHUMAN_KERNELS"} & os.environ.keys()), reason="the library is not used then"
)

PLAY = """
import gymnasium, minihuman, sys
from minihuman.worlds.hashing import hash64
env = gymnasium.make("minihuman/MiniGrid-Empty-5x5-v0").unwrapped
env.reset(seed=0)
pictures = []
for action in (2, 2, 1, 2, 2):
    reward, ended = env.step(action)[1:3]
    pictures.append(env.picture(size_px=(160, 160)))
    if ended:
        break
print(reward, hash64(pictures), env.state_hash(), {"numba", "llvmlite"} & sys.modules.keys())
"""
WITHOUT = """
import sys
class Blocked:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in ("numba", "llvmlite"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
sys.meta_path.insert(0, Blocked())
"""
REWARDS = "0.955", "0.964"  # for the fifth and for the fourth step of 100


def run(code: str, *, python: str = sys.executable, path: Path = ROOT, **more: str) -> tuple[str, str]:
    """What it prints, and what it says beside."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    environment |= {"PYTHONPATH": str(path)} | more
    ran = subprocess.run([python, "-c", code], env=environment, capture_output=True, text=True, check=False, cwd=path)
    assert ran.returncode == 0, ran.stderr
    return ran.stdout.strip(), ran.stderr


@native
@pytest.mark.program
def test_worlds_follow_an_edit_in_a_checkout_and_somebody_who_waits_for_the_compiler_reads_why(tmp_path):
    checkout = copy_checkout(tmp_path / "checkout")
    before, said = run(PLAY, path=checkout)
    assert before.endswith("set()")
    assert said == ""
    edit_kernel(checkout)
    after, said = run(PLAY, path=checkout)
    assert (before.split()[0], after.split()[0]) == REWARDS
    assert all(old != new for old, new in zip(before.split()[:3], after.split()[:3], strict=True))  # picture, hash too
    assert said.splitlines() == [COMPILE_NOTICE]


@pytest.mark.nightly
@native
@pytest.mark.program
def test_numba_computes_what_the_library_does():
    library, by_numba = run(PLAY)[0], run(PLAY, MINIHUMAN_KERNELS="jit")[0]
    assert library.split()[:3] == by_numba.split()[:3]
    assert by_numba.endswith(("{'numba', 'llvmlite'}", "{'llvmlite', 'numba'}"))


@native
@pytest.mark.program
def test_a_wheel_brings_the_library_and_needs_no_compiler(tmp_path):
    checkout, wheels, venv = copy_checkout(tmp_path / "checkout"), tmp_path / "wheels", tmp_path / "venv"
    build = [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "--no-build-isolation", "--no-index"]
    subprocess.run([*build, "-w", wheels, checkout], check=True)
    (wheel,) = wheels.glob("*.whl")
    assert re.search(r"-py3-none-(?!any)\w+\.whl$", wheel.name)
    python = str(venv / "bin" / "python")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", venv], check=True)
    (site,) = venv.glob("lib/*/site-packages")
    (site / "others.pth").write_text("\n".join(path for path in sys.path if path.endswith("site-packages")))
    pip = [sys.executable, "-m", "pip", "--python", python, "-q", "--no-input", "--disable-pip-version-check"]
    subprocess.run([*pip, "install", "--no-deps", "--no-index", "--force-reinstall", wheel], check=True)
    said, _ = run(f"import minihuman; print(minihuman.__file__)\n{WITHOUT}\n{PLAY}", python=python, path=tmp_path)
    where, played = said.splitlines()
    assert where.startswith(str(site))
    assert played == run(PLAY)[0]


@native
def test_what_an_edit_may_have_changed_is_not_taken_from_the_library(monkeypatch):
    fitting = load_library(LIBRARY_FOLDER)
    assert fitting is not None
    assert fitting.has_all
    known = library_manifest.source_digest
    monkeypatch.setattr(library_manifest, "source_digest", lambda path: "" if path == CELLS else known(path))
    left = load_library(LIBRARY_FOLDER)
    assert left is not None
    assert not left.has_all
    gone = fitting.numbers.keys() - left.numbers.keys()
    assert "minihuman.worlds.grid.core.rules.step" in gone
    assert "minihuman.worlds.first_person.render.visibility.cover" in left.numbers
    monkeypatch.setattr(library_manifest, "source_digest", lambda path: "")
    assert load_library(LIBRARY_FOLDER) is None
    monkeypatch.undo()
    monkeypatch.setattr(library_manifest, "API", ["another"])
    assert load_library(LIBRARY_FOLDER) is None
    monkeypatch.undo()
    monkeypatch.setattr(kernels, "HERE", ["linux", "riscv64"])
    assert load_library(LIBRARY_FOLDER) is None


@native
def test_every_kernel_that_python_calls_is_in_the_library():
    for path in (PACKAGE / "worlds").rglob("*.py"):
        if "\n@kernel(" in path.read_text(encoding="utf-8") and path.parent.name != "build":
            importlib.import_module(".".join(path.relative_to(PACKAGE.parent).with_suffix("").parts))
    of_the_page_alone = "minihuman.worlds.build."
    called_by_python = {
        name: kernel
        for name, (kernel, _) in KERNELS.items()
        if name.startswith("minihuman.") and not name.startswith(of_the_page_alone)
    }
    assert [name for name, kernel in called_by_python.items() if isinstance(kernel, LateKernel)] == []
    assert len(called_by_python) > 100


@native
def test_what_a_kernel_is_given_is_what_it_is_written_for_or_an_error_that_names_it():
    row, words, image = np.zeros(row_length(3, 3), np.int32), np.zeros(6, np.uint64), np.zeros((3, 3, 3), np.uint8)
    clear(row)
    assert step(row, 0, words, image) == step(row, np.int8(0), words, image) == step(row, False, words, image)
    assert step(row.view(np.dtype(np.int32).newbyteorder("=")), 0, words, image) == step(row, 0, words, image)
    for wrong in (
        (row.astype(np.int64), 0, words, image),
        (row[::2], 0, words, image),
        (row, 0.5, words, image),
        (row, 2**70, words, image),
        (row, "left", words, image),
        (row, 0, words, image[0]),
        (row, 0, words),
        (row.tolist(), 0, words, image),
    ):
        with pytest.raises((TypeError, OverflowError), match=r"grid\.core\.rules\.step takes"):
            step(*wrong)
    row.flags.writeable = False
    with pytest.raises(TypeError, match="takes"):
        clear(row)


@native
def test_an_array_that_a_kernel_returns_is_pythons_own():
    row = np.zeros(row_length(3, 3), np.int32)
    row[[WIDTH, HEIGHT]] = 3
    found = distances(row, np.array([0], np.int64), True)
    found[:] = 7
    assert (found.shape, found.dtype, found.flags.writeable) == ((3, 3, 4), np.int32, True)


@native
def test_a_kernel_is_pickled_by_its_name():
    assert pickle.loads(pickle.dumps(step)) is step
    assert inspect.isroutine(step)


LAB = """
from minihuman.worlds.grid.core.cells import ahead
from minihuman.worlds.grid.core.state import Row, cell_at
from minihuman.worlds.kernels import device_function, kernel

@kernel()
def is_wall_ahead(row: Row, x: int, y: int) -> bool:
    return beside(row, x, y) & 15 == STILL_TO_COME

@device_function()
def beside(row: Row, x: int, y: int) -> int:
    i, j = ahead(x, y, 0)
    return cell_at(row, i, j)

STILL_TO_COME = 2
import numpy as np
row = np.zeros(200, np.int32)
row[:2] = 3
print(is_wall_ahead(row, 0, 0))
row[:] = np.where(row == 0, 2, row)
print(is_wall_ahead(row, 0, 0))
"""


@native
@pytest.mark.program
def test_a_labs_own_kernels_are_compiled_by_numba_and_call_ours(tmp_path):
    (tmp_path / "lab.py").write_text(LAB)
    code = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); import lab"
    assert run(code)[0].split() == ["False", "True"]
    with pytest.raises(AssertionError, match=re.escape(kernels.NO_COMPILER.format("lab"))):
        run(WITHOUT + code)
    assert run(WITHOUT + code, NUMBA_DISABLE_JIT="1")[0].split() == ["False", "True"]


def test_an_error_says_that_numba_is_missing(monkeypatch):
    monkeypatch.delattr(build, "compilation", raising=False)  # another test may have imported it
    monkeypatch.setitem(sys.modules, "minihuman.worlds.build.compilation", None)
    with pytest.raises(MinihumanError, match=r"run `pip install -e .` again in minihuman's folder"):
        kernels._import_compiler(step)
