"""Collecting finds all tests, and stays cheap: what is dear to import is imported by the tests that use it."""

from fnmatch import fnmatch
from pathlib import Path

import pytest

TESTS = Path(__file__).parent
SLOW_IMPORTS = frozenset(  # without llvmlite: 0.03 CPU seconds, and the tests of the build ask it which of them can run
    {
        "boto3",
        "datasets",
        "h5py",
        "mcp",
        "minari",
        "miniworld",
        "numba",
        "playwright",
        "polars",
        "pyglet",
        "ray",
        "rerun",
        "scipy.optimize",
        "scipy.stats",  # ``import scipy`` loads its parts where they are used
        "statsmodels",
        "trimesh",
    }
)


def test_collecting_imports_no_slow_library(collected_modules: frozenset[str]) -> None:
    """Each process collects all tests before it runs its share: import these inside the functions that use them."""
    assert SLOW_IMPORTS & collected_modules == set()


def test_pytest_looks_into_every_folder_that_has_tests(request: pytest.FixtureRequest) -> None:
    """It passes over folders of some names, such as "build", without a word."""
    patterns = request.config.getini("norecursedirs")
    files = [file.relative_to(TESTS) for file in TESTS.rglob("test_*.py") if "node_modules" not in file.parts]
    assert len(files) > 300
    passed_over = {
        str(file) for file in files for folder in file.parts[:-1] if any(fnmatch(folder, name) for name in patterns)
    }
    assert passed_over == set()
