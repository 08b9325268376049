"""Collecting the tests stays cheap: what is dear to import is imported by the tests that use it."""

SLOW_IMPORTS = frozenset(
    {
        "boto3",
        "datasets",
        "h5py",
        "llvmlite",
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
