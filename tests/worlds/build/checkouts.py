"""Copies of what a build needs of this checkout, and an edit of a kernel in them."""

import shutil
from pathlib import Path

ROOT = Path(__file__).parents[3]
# by an edit in this one file, that the kernels of others are compiled from, a step down is two cells
CELLS = "worlds/grid/core/cells.py"
BEFORE, AFTER = "y + (2 - direction) * (direction % 2)", "y + 2 * (2 - direction) * (direction % 2)"


def copy_checkout(folder: Path) -> Path:
    """Copy what a wheel is built of, with the library where there is one."""
    folder.mkdir()
    for name in ("minihuman", "protocols", "kernel_build"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "hatch_build.py", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, folder)
    return folder


def edit_kernel(checkout: Path) -> None:
    """Change what grid worlds compute."""
    path = checkout / "minihuman" / CELLS
    source = path.read_text()
    assert source.count(BEFORE) == 1
    path.write_text(source.replace(BEFORE, AFTER))
