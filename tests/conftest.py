"""Fixtures that more than one folder of tests needs."""

import gc
import os
import sys
from collections.abc import Generator, Iterator
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

from tests import machine, meter, nightly, processes
from tests.built_worlds import build_worlds
from tests.typefaces import use_test_faces
from tests.xserver import xvfb

# How fast this machine is just now is no property of the code. Examples are the same each time in CI, as Hypothesis has
# it there by default: what is judged is a change. Everywhere else they are new ones each time.
settings.register_profile(
    "minihuman", deadline=None, suppress_health_check=[HealthCheck.too_slow], derandomize="CI" in os.environ
)
settings.load_profile("minihuman")


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add our options."""
    meter.add_option(parser)


def pytest_configure(config: pytest.Config) -> None:
    """Before any world is imported, in each process that runs tests."""
    nightly.choose_counts(config)
    meter.register(config)
    config.pluginmanager.register(processes)
    config.pluginmanager.register(machine)
    build_worlds()
    use_test_faces()


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int:
    """Run a process more than there are cores: browsers, windows and servers keep a quarter of the time waiting."""
    return (os.cpu_count() or 1) + 1


_ALLOCATIONS_PER_COLLECTION = 20_000  # of 700: a worker's heap is large, and searching it took 6 % of the time
IMPORTED = pytest.StashKey[frozenset[str]]()


@pytest.hookimpl(wrapper=True)
def pytest_collection(session: pytest.Session) -> Generator[None, object, object]:
    """Collect without the garbage collector, and keep it from what was collected.

    Modules and items stay until the end. The collector went through all of them again and again, for more than half of
    the time that collecting took.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.set_threshold(_ALLOCATIONS_PER_COLLECTION, *gc.get_threshold()[1:])
        gc.enable()
        session.config.stash[IMPORTED] = frozenset(sys.modules)


@pytest.fixture(scope="session")
def collected_modules(pytestconfig: pytest.Config) -> frozenset[str]:
    """The names of the modules that were imported once this process had collected its tests."""
    return pytestconfig.stash[IMPORTED]


@pytest.fixture(scope="session", autouse=True)
def configuration(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The folder of the user's configuration, for this process and those it starts; our test worlds are trusted."""
    folder = tmp_path_factory.mktemp("configuration")
    named = (
        "worlds.corridor",
        "worlds.duet",
        "worlds.endless",
        "worlds.levers",
        "worlds.slow",
        "worlds.paddle",
        "worlds.wrapped",
        "export.changing",
    )
    named += ("export.test_any_session", "study.test_activities")
    (folder / "trust.jsonl").write_text("".join(f'{{"module": "tests.{name}"}}\n' for name in named))
    with pytest.MonkeyPatch.context() as patched:
        patched.setenv("MINIHUMAN_CONFIG", str(folder))
        yield folder


@pytest.fixture(scope="session")
def display() -> Iterator[str]:
    """An X display of our own, ":12"; one for the whole run."""
    with xvfb() as name:
        yield name
