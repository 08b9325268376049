"""What tests want of a machine that `pip install -e ".[test]"` does not bring, whether it is here, and how to have it.

Tests that need something say so with a mark (`@needs("chromium")`), modules that cannot even be imported without it
with `need_module`. What is missing is left out of the run, and the run's last lines say how many tests that is and how
to have it. `need` skips where a mark came too late. Under `CI` a test fails without what CI has, and is not left out.
"""

import ctypes.util
import os
import shutil
import sys
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NoReturn

import pytest

from tests import nightly


def _find_program(*names: str) -> Callable[[], str | None]:
    return lambda: next(filter(None, map(shutil.which, names)), None)


def _find_package(*names: str) -> Callable[[], str | None]:
    return lambda: sys.prefix if all(find_spec(name) is not None for name in names) else None


def _find_variable(name: str) -> Callable[[], str | None]:
    return lambda: os.environ.get(name)


def _find_sound() -> str | None:
    programs = all(map(shutil.which, ("pulseaudio", "parec")))
    library = ctypes.util.find_library("portaudio")
    return library if programs and find_spec("sounddevice") and find_spec("soundfile") else None


def _find_opengl() -> str | None:
    return "here" if all(map(ctypes.util.find_library, ("GL", "GLU", "EGL"))) else None


def _find_postgresql() -> str | None:
    folders = sorted(Path("/usr/lib/postgresql").glob("*/bin"), reverse=True)
    programs = [str(folder / "initdb") for folder in folders] + ["initdb"]
    return next(filter(None, map(shutil.which, programs)), None)


@dataclass(frozen=True)
class Requirement:
    """Something that a machine may have.

    Attributes:
        title: what a message calls it.
        install: the command that brings it.
        find: where it is; None where it is missing.
        in_ci: whether `.ci/run` has it wherever it runs the tests, so that a test without it fails there.
    """

    title: str
    install: str
    find: Callable[[], str | None]
    in_ci: bool = True

    @property
    def missing(self) -> str:
        """What is said where it is missing."""
        return f"{self.title}, missing here: {self.install}"


REQUIREMENTS = {
    "caddy": Requirement("Caddy", "apt-get install caddy", _find_program("caddy")),
    "chromium": Requirement(
        "Chromium", "apt-get install chromium", _find_program("chromium", "chromium-browser", "google-chrome")
    ),
    "firefox": Requirement("Firefox", "apt-get install firefox-esr", _find_program("firefox-esr", "firefox")),
    "sound": Requirement(
        "sounddevice, soundfile, PortAudio and PulseAudio",
        'apt-get install libportaudio2 pulseaudio pulseaudio-utils libasound2-plugins; pip install -e ".[sound]"',
        _find_sound,
    ),
    "compiler": Requirement("a C compiler", "apt-get install gcc libc6-dev", _find_program("cc"), in_ci=False),
    "node": Requirement("Node.js", "apt-get install nodejs", _find_program("node")),
    "npm": Requirement(
        "npm, which fetches packages",
        "apt-get install npm; its registry must be reachable",
        _find_program("npm"),
        in_ci=False,
    ),
    "openbox": Requirement("the window manager openbox", "apt-get install openbox", _find_program("openbox")),
    "opengl": Requirement(
        "OpenGL's libraries", "apt-get install libgl1 libglu1-mesa libegl1 libgl1-mesa-dri libopengl0", _find_opengl
    ),
    "postgresql": Requirement("PostgreSQL", "apt-get install postgresql", _find_postgresql),
    "setxkbmap": Requirement("setxkbmap", "apt-get install x11-xkb-utils", _find_program("setxkbmap")),
    "xvfb": Requirement("the X server Xvfb", "apt-get install xvfb", _find_program("Xvfb")),
    "kitchens": Requirement(
        "the packages that kitchens are compared with",
        "pip install --no-deps overcooked-ai==1.1.0 cogrid==0.3.2",
        _find_package("overcooked_ai_py", "cogrid"),
        in_ci=False,
    ),
    "learn": Requirement(
        "PyTorch and Stable-Baselines3",
        'pip install -e ".[learn]"',
        _find_package("torch", "stable_baselines3"),
        in_ci=False,
    ),
    "anywidget": Requirement("anywidget", 'pip install -e ".[notebook]"', _find_package("anywidget"), in_ci=False),
    "notebooks": Requirement(
        "JupyterLab and marimo",
        "pip install anywidget jupyterlab marimo",
        _find_package("anywidget", "jupyterlab", "marimo"),
        in_ci=False,
    ),
    "mkdocs": Requirement("MkDocs", 'pip install -e ".[docs]"', _find_package("mkdocs"), in_ci=False),
    "r": Requirement(
        "R with lme4 and glmmTMB",
        "apt-get install r-base-core r-cran-lme4 r-cran-glmmtmb r-cran-jsonlite",
        lambda: shutil.which("Rscript"),
        in_ci=False,
    ),
    "recordings": Requirement(
        "the worlds of other packages that sessions are recorded in",
        'pip install "gymnasium[box2d]" ale-py mujoco arcengine',
        _find_package("Box2D", "ale_py", "mujoco", "arcengine", "minari"),
        in_ci=False,
    ),
    "ray": Requirement("Ray", 'pip install -e ".[cluster]"', _find_package("ray"), in_ci=False),
    "other pyglet": Requirement(
        "the other major version of pyglet", ".ci/run pyglet2", _find_variable("MINIHUMAN_OTHER_PYGLET"), in_ci=False
    ),
    "torch-ac": Requirement(
        "torch-ac, which trains policies on Minigrid",
        "pip install torch-ac",
        _find_package("torch", "torch_ac"),
        in_ci=False,
    ),
    "validators": Requirement(
        "the validators of archives", ".ci/run standards", _find_variable("MINIHUMAN_STANDARDS"), in_ci=False
    ),
    "night": Requirement("the time that long proofs take", "pytest -m nightly", lambda: None, in_ci=False),
    "patterns": Requirement(
        "Minigrid's pictures for Wave Function Collapse",
        "export MINIGRID_WFC_PATTERNS=minigrid/envs/wfc/patterns of a clone of Minigrid",
        _find_variable("MINIGRID_WFC_PATTERNS"),
        in_ci=False,
    ),
}
FIXTURES = {"display": "xvfb", "typist_and_display": "xvfb"}  # what asks for these fixtures needs it


@cache
def where(name: str) -> str | None:
    """Return where something is on this machine; None where it is missing."""
    return REQUIREMENTS[name].find()


def needs(*names: str) -> pytest.MarkDecorator:
    """Mark a test that needs these."""
    assert REQUIREMENTS.keys() >= set(names), names
    return pytest.mark.needs(*names)


def need(name: str) -> str:
    """Return where something is; skip the test where it is missing, fail it in CI."""
    place = where(name)
    if place is None:
        do_without(REQUIREMENTS[name])
    return place


def need_module(name: str) -> None:
    """Leave out the module that calls this, where what it cannot be imported without is missing."""
    if where(name) is None:
        pytest.skip(REQUIREMENTS[name].missing, allow_module_level=True)


def do_without(requirement: Requirement) -> NoReturn:
    """Skip a test; in CI, fail it where CI has what is missing."""
    if requirement.in_ci and os.environ.get("CI"):
        pytest.fail(requirement.missing)
    pytest.skip(requirement.missing)


class LeftOut:
    """What was left out of a run, and why."""

    def __init__(self) -> None:
        self.tests: Counter[str] = Counter()  # by what is missing
        self.modules: Counter[str] = Counter()

    @pytest.hookimpl(trylast=True)
    def pytest_collection_modifyitems(self, config: pytest.Config, items: list[pytest.Item]) -> None:
        """Leave out the tests whose needs are missing, and those that are left to the night."""
        number = nightly.deselect_nightly(config, items)
        if number:
            self.tests[REQUIREMENTS["night"].missing] = number
        kept = []
        left_out = []
        for item in items:
            missing = next((name for name in find_needs(item) if where(name) is None and not _fails(name)), None)
            if missing is None:
                kept.append(item)
            else:
                left_out.append(item)
                self.tests[REQUIREMENTS[missing].missing] += 1
        if left_out:
            config.hook.pytest_deselected(items=left_out)
            items[:] = kept

    @pytest.hookimpl(wrapper=True)
    def pytest_make_collect_report(self, collector: pytest.Collector) -> Any:
        """Leave out the modules that `need_module` ended."""
        report = yield
        reason = report.longrepr[2].removeprefix("Skipped: ") if report.outcome == "skipped" else ""
        if any(reason == requirement.missing for requirement in REQUIREMENTS.values()):
            self.modules[reason] += 1
            report.outcome = "passed"
            report.longrepr = None
            report.result = []
        return report

    def pytest_runtest_setup(self, item: pytest.Item) -> None:
        """In CI, fail what is not left out there."""
        for name in find_needs(item):
            need(name)

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        """Tell the controller, where tests run in several processes."""
        if hasattr(session.config, "workeroutput"):
            session.config.workeroutput["left_out"] = (dict(self.tests), dict(self.modules))

    @pytest.hookimpl(optionalhook=True)
    def pytest_testnodedown(self, node: Any) -> None:
        """Take what a worker left out; each of them collects all tests."""
        tests, modules = getattr(node, "workeroutput", {}).get("left_out", ({}, {}))
        self.tests |= Counter(tests)
        self.modules |= Counter(modules)

    def pytest_terminal_summary(self, terminalreporter: "pytest.TerminalReporter") -> None:
        """Say what was left out or skipped for want of something, and how to have it."""
        skipped = Counter(_skip_reason(report) for report in terminalreporter.stats.get("skipped", ()))
        lines = list(self.lines(skipped))
        if lines:
            terminalreporter.section("left out on this machine")
            for line in lines:
                terminalreporter.line(line)
            terminalreporter.line("`.ci/run all` has all of it, and runs the long proofs at full count")

    def lines(self, skipped: Counter[str]) -> Iterable[str]:
        """Say how many tests each missing thing costs."""
        for requirement in REQUIREMENTS.values():
            reason = requirement.missing
            amounts = (
                (self.tests[reason], "test", "left out"),
                (self.modules[reason], "module", "of tests left out"),
                (skipped[reason], "test", "skipped"),
            )
            parts = [f"{number} {noun}{'s' * (number != 1)} {what}" for number, noun, what in amounts if number]
            if parts:
                yield f"{', '.join(parts)} for want of {requirement.title}: {requirement.install}"


def find_needs(item: pytest.Item) -> list[str]:
    """Return what a test needs, by its marks and its fixtures."""
    marked = [name for mark in item.iter_markers("needs") for name in mark.args]
    return marked + [need for fixture, need in FIXTURES.items() if fixture in getattr(item, "fixturenames", ())]


def _fails(name: str) -> bool:
    """Whether a test without it fails instead of being left out."""
    return REQUIREMENTS[name].in_ci and bool(os.environ.get("CI"))


def _skip_reason(report: Any) -> str:
    return report.longrepr[2].removeprefix("Skipped: ") if isinstance(report.longrepr, tuple) else ""


def pytest_configure(config: pytest.Config) -> None:
    """Register the mark, and what leaves tests out."""
    config.addinivalue_line("markers", "needs(*names): wants something of the machine; `tests.machine` has the names")
    config.pluginmanager.register(LeftOut(), "left-out")
