"""A station and a server run with what their requirement files name; every other command says what is missing."""

import os
import re
import subprocess
import sys
import tomllib
from functools import cache
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "requirements"
BLOCKER = """
import sys

blocked = set(sys.argv[1].split(","))
sys.argv = ["minihuman", *sys.argv[2:]]


class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in blocked:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


sys.meta_path.insert(0, Blocker())
from minihuman.cli import main

main()
"""


def names_in(name: str) -> set[str]:
    """The packages of a requirement file."""
    lines = (FOLDER / name).read_text(encoding="utf-8").splitlines()
    return {re.split(r"[^\w.-]", line)[0].lower() for line in lines if line and not line.lstrip().startswith("#")}


@cache
def modules_beside(role: str) -> tuple[str, ...]:
    """The modules that are installed here and come from packages that the locked file does not name."""
    allowed = names_in(f"{role}.txt") | {"minihuman-lab", "pip", "setuptools"}
    installed = packages_distributions().items()
    return tuple(
        sorted(
            module
            for module, names in installed
            if not allowed & {name.lower().replace("_", "-") for name in names} and module != "__pycache__"
        )
    )


def run(role: str, *command: str, cwd: Path) -> subprocess.CompletedProcess[str]:
    """Run a command where nothing is importable but the packages of a locked file."""
    arguments = [sys.executable, "-c", BLOCKER, ",".join(modules_beside(role)), *command]
    bare = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
    return subprocess.run(arguments, cwd=cwd, capture_output=True, text=True, timeout=300, env=bare)


@pytest.mark.parametrize("role", ["station", "server"])
def test_the_bounds_are_those_of_the_package(role: str) -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    known = {*project["dependencies"], *project["optional-dependencies"]["web"]}
    lines = [
        line for line in (FOLDER / f"{role}.in").read_text(encoding="utf-8").splitlines() if not line.startswith("#")
    ]
    assert [line for line in lines if line.replace("'", '"') not in {one.replace("'", '"') for one in known}] == []
    assert {re.split(r"[^\w.-]", line)[0].lower() for line in lines} <= names_in(f"{role}.txt")
    assert len(names_in(f"{role}.txt")) <= 30


@pytest.mark.program
def test_a_station_simulates_verifies_and_names_what_other_commands_need(tmp_path: Path) -> None:
    demo = str(ROOT / "protocols/demo.toml")
    made = run("station", "simulate", demo, "--participants", "1", "--player", "optimal", "--data", ".", cwd=tmp_path)
    assert made.returncode == 0, made.stderr
    for command in (["verify", "demo"], ["status", "demo"], ["check", demo], ["info", "demo/sub-01/ses-01"]):
        found = run("station", *command, cwd=tmp_path)
        assert found.returncode == 0, found.stderr
    opened = run("station", "run", demo, "--next-slot", "--data", "live", cwd=tmp_path)
    assert "cannot open a window" in opened.stderr, "it got as far as its window"
    named = {}
    for command, needed in (
        (["report", "demo", "--out", "r"], "pandas"),
        (["plot", "demo", "--out", "f"], "matplotlib"),
        (["query", "demo", "select 1"], "duckdb"),
        (["replay", "demo", "--out", "r.rrd"], "rerun-sdk"),
        (["serve", demo], "uvicorn"),
    ):
        found = run("station", *command, cwd=tmp_path)
        assert found.returncode == 2, found.stderr
        assert len(found.stderr.splitlines()) == 1
        assert f"needs {needed}" in found.stderr
        assert "pip install" in found.stderr
        named[command[0]] = set(re.findall(r"'([\w.-]+)", found.stderr))
    assert named["report"] >= {"pandas", "scipy", "matplotlib", "jinja2", "duckdb", "pyarrow"}, "all of them at once"
    assert not named["report"] & (names_in("station.txt") | {"rerun-sdk"}), "and nothing that is there"
    assert named["serve"] >= {"uvicorn", "starlette", "websockets", "jinja2", "isal", "simplejpeg"}


@pytest.mark.program
def test_a_server_needs_no_more_than_its_file_names(tmp_path: Path) -> None:
    """It gets as far as its port, which is taken here."""
    import socket

    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        found = run("server", "serve", str(ROOT / "protocols/demo.toml"), "--port", port, "--data", ".", cwd=tmp_path)
    assert found.returncode == 2, found.stderr
    assert f"port {port}" in found.stderr
    assert "needs" not in found.stderr
    demo = str(ROOT / "protocols/demo.toml")
    deployed = run("server", "deploy", demo, "--address", "https://study.example.org", cwd=tmp_path)
    assert deployed.returncode == 0, deployed.stderr
    missing = run("server", "desk", "nowhere", cwd=tmp_path)
    assert "nowhere" in missing.stderr
    assert "needs" not in missing.stderr
