"""Compiled code is never older than its sources, and a person who waits for the compiler reads why."""

import ast
import inspect
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from minihuman.worlds import kernels
from minihuman.worlds.kernels import COMPILE_NOTICE

ROOT = Path(__file__).parents[2]
compiles = pytest.mark.skipif(os.environ.get("NUMBA_DISABLE_JIT") == "1", reason="nothing is compiled then")

CODE = "from minihuman.worlds.grid.core.cells import kind_of, lets_pass; kind_of(5), lets_pass(5)"
PLAY = """
import gymnasium, minihuman
from minihuman.worlds.hashing import hash64
env = gymnasium.make("minihuman/MiniGrid-Empty-5x5-v0").unwrapped
env.reset(seed=0)
pictures = []
for action in (2, 2, 1, 2, 2):
    reward, ended = env.step(action)[1:3]
    pictures.append(env.picture(size_px=(160, 160)))
    if ended:
        break
print(reward, hash64(pictures), env.state_hash())
"""
# by an edit in this one file, that the kernels of others are compiled from, a step down is two cells
EDITED = "minihuman/worlds/grid/core/cells.py"
BEFORE, AFTER = "y + (2 - direction) * (direction % 2)", "y + 2 * (2 - direction) * (direction % 2)"
REWARDS = "0.955", "0.964"  # for the fifth and for the fourth step of 100


def run(code: str, cache: Path, *, python: str = sys.executable, path: Path | None = None) -> tuple[str, str]:
    """What it prints, and what it says beside."""
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    environment |= {"NUMBA_CACHE_DIR": str(cache)} | ({"PYTHONPATH": str(path)} if path else {})
    ran = subprocess.run([python, "-c", code], env=environment, capture_output=True, text=True, check=True, cwd=cache)
    return ran.stdout.strip(), ran.stderr


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One for all: what one copy of minihuman leaves behind, the next finds."""
    return tmp_path_factory.mktemp("cache")


def copied(folder: Path) -> Path:
    folder.mkdir()
    for name in ("minihuman", "protocols"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, folder)
    return folder


def edit(checkout: Path) -> None:
    source = (checkout / EDITED).read_text()
    assert source.count(BEFORE) == 1
    (checkout / EDITED).write_text(source.replace(BEFORE, AFTER))


def assert_follows(before: str, after: str) -> None:
    assert (before.split()[0], after.split()[0]) == REWARDS
    assert all(old != new for old, new in zip(before.split(), after.split(), strict=True))  # picture and hash too


@pytest.mark.program
def test_worlds_follow_an_edit_in_a_checkout(tmp_path: Path, cache: Path) -> None:
    checkout = copied(tmp_path / "checkout")
    before, _ = run(PLAY, cache, path=checkout)
    edit(checkout)
    after, _ = run(PLAY, cache, path=checkout)
    assert_follows(before, after)


@pytest.mark.program
def test_worlds_follow_a_wheel_installed_over_another(tmp_path: Path, cache: Path) -> None:
    checkout, wheels, venv = copied(tmp_path / "checkout"), tmp_path / "wheels", tmp_path / "venv"
    python = str(venv / "bin" / "python")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", venv], check=True)
    (site,) = venv.glob("lib/*/site-packages")
    (site / "others.pth").write_text("\n".join(path for path in sys.path if path.endswith("site-packages")))
    pip = [sys.executable, "-m", "pip", "--python", python, "-q", "--no-input", "--disable-pip-version-check"]
    said = []
    for name in ("first", "second"):
        build = [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "--no-build-isolation", "--no-index"]
        subprocess.run([*build, "-w", wheels / name, checkout], check=True)
        (wheel,) = (wheels / name).glob("*.whl")
        subprocess.run([*pip, "install", "--no-deps", "--no-index", "--force-reinstall", wheel], check=True)
        where, _ = run("import minihuman; print(minihuman.__file__)", cache, python=python)
        assert where.startswith(str(site))
        said.append(run(PLAY, cache, python=python)[0])
        edit(checkout) if name == "first" else None
    assert_follows(*said)


@compiles
@pytest.mark.program
def test_compiling_is_announced_once_and_never_again_on_this_machine(tmp_path: Path) -> None:
    assert run(CODE, tmp_path)[1].splitlines() == [COMPILE_NOTICE]
    assert run(CODE, tmp_path)[1] == ""


@compiles
@pytest.mark.program
def test_damaged_code_is_compiled_anew(tmp_path: Path) -> None:
    run(CODE, tmp_path)
    (one, *_) = (tmp_path / "minihuman" / "kernels").iterdir()
    one.write_bytes(one.read_bytes()[:-100])
    assert run(CODE, tmp_path)[1].splitlines() == [COMPILE_NOTICE]
    assert run(CODE, tmp_path)[1] == ""


@compiles
@pytest.mark.program
def test_others_compile_functions_of_no_module_beside_us(tmp_path: Path) -> None:
    code = "import numba, minihuman.worlds.grid.env; made = {}; exec('def f(x): return x + 1', made)"
    assert run(f"{code}; made['f'].__module__ = None; print(numba.njit(made['f'])(1))", tmp_path)[0] == "2"


@pytest.mark.program
def test_a_digest_follows_whatever_a_module_imports_and_nothing_else(tmp_path: Path) -> None:
    lab = tmp_path / "lab"
    lab.mkdir()
    (lab / "__init__.py").touch()
    (lab / "rules.py").write_text("import os, sys; from .between import numbers\n")
    (lab / "between.py").write_text("if True:\n    from . import (  # a reason\n        numbers,\n    )\n")

    def digest() -> str:
        said = "from minihuman.worlds.source_digest import module_digest; print(module_digest('lab.rules'))"
        return run(said, tmp_path, path=tmp_path)[0]

    (lab / "numbers.py").write_text("STEP = 1\n")
    first = digest()
    (lab / "beside.py").write_text("STEP = 1\n")
    assert digest() == first
    (lab / "numbers.py").write_text("STEP = 2\n")
    assert digest() != first


SHIPPED = {"NUMBA_CPU_NAME": "x86-64-v3", "NUMBA_CPU_FEATURES": ""}
ANOTHER = "import llvmlite.binding as machine; machine.get_host_cpu_name = lambda: 'some-other-cpu'; "
OLD = (
    "features = machine.get_host_cpu_features(); features['avx2'] = False; "
    "machine.get_host_cpu_features = lambda: features; "
)
NEWER = "import numba; numba.__version__ += '.1'; "


@pytest.fixture(scope="module")
def with_code(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of minihuman with the code of what CODE runs beside it, as a platform's wheel has it."""
    folder = tmp_path_factory.mktemp("shipped")
    checkout, cache = copied(folder / "checkout"), folder / "cache"
    cache.mkdir()
    made = subprocess.run(
        [sys.executable, "-c", CODE],
        env=os.environ | SHIPPED | {"NUMBA_CACHE_DIR": str(cache), "PYTHONPATH": str(checkout)},
        cwd=cache,
        capture_output=True,
        text=True,
        check=True,
    )
    assert COMPILE_NOTICE in made.stderr
    shutil.copytree(cache / "minihuman" / "kernels", checkout / "minihuman" / "worlds" / "compiled")
    return checkout


def runs_v3() -> bool:
    from llvmlite import binding

    from minihuman.worlds.kernels import shipped_target

    return shipped_target(binding.get_process_triple(), binding.get_host_cpu_features()) is not None


@compiles
@pytest.mark.program
@pytest.mark.skipif(not runs_v3(), reason="code is shipped for x86-64-v3")
@pytest.mark.parametrize(
    ("before", "found"), [("", True), (ANOTHER, True), (ANOTHER + OLD, False), (NEWER, False)], ids=str
)
def test_shipped_code_is_found_on_any_processor_that_runs_it_and_by_its_own_versions_alone(
    tmp_path: Path, with_code: Path, before: str, found: bool
) -> None:
    assert (COMPILE_NOTICE not in run(before + CODE, tmp_path, path=with_code)[1]) == found


@compiles
@pytest.mark.program
@pytest.mark.skipif(not runs_v3(), reason="code is shipped for x86-64-v3")
def test_shipped_code_is_refused_after_one_changed_line_and_where_another_processor_is_asked_for(
    tmp_path: Path, with_code: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NUMBA_CPU_NAME", "generic")
    assert COMPILE_NOTICE in run(CODE, tmp_path, path=with_code)[1]
    monkeypatch.delenv("NUMBA_CPU_NAME")
    edited = tmp_path / "edited"
    shutil.copytree(with_code, edited)
    source = edited / "minihuman/worlds/grid/core/cells.py"
    source.write_text(source.read_text().replace("\n\n\n", "\n\n\n# one line more\n", 1))
    (cache := tmp_path / "empty").mkdir()
    assert COMPILE_NOTICE not in run(CODE, cache, path=with_code)[1]
    assert COMPILE_NOTICE in run(CODE, cache, path=edited)[1]


def test_the_docstring_lists_all_that_is_used_of_the_inside_of_numba():
    tree = ast.parse(inspect.getsource(kernels))
    inside = [
        name.name
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(("numba.core", "numba.misc", "numba.np"))
        for name in node.names
    ]
    private = [
        node.attr
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute)
        and node.attr.startswith("_")
        and not node.attr.startswith("__")
        and not (isinstance(node.value, ast.Name) and node.value.id == "self")
    ]
    assert len(inside) > 5
    assert len(private) > 2
    assert [name for name in (*inside, *private) if name not in kernels.__doc__] == []
