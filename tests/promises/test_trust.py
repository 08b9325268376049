"""Only trusted code runs: nothing of the folder that somebody is in, nothing that a log names."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from minihuman.errors import WorldError
from minihuman.replay.recording import viewer_command, viewer_environment
from minihuman.worlds.adapters.world import trusted_world_factory

TRAP = "import pathlib; pathlib.Path(__file__).with_name(f'ran-{__name__}').touch(); raise SystemExit(3)\n"


@pytest.fixture
def trapped(tmp_path: Path) -> Path:
    """A folder with files that are named as libraries are."""
    for name in ("rerun", "msgspec", "numpy", "minihuman", "json"):
        (tmp_path / f"{name}.py").write_text(TRAP)
    return tmp_path


@pytest.mark.program
def test_a_replay_in_a_folder_with_a_file_named_rerun_runs_the_real_one(trapped: Path) -> None:
    command = viewer_command(Path("x.rrd"), web=False)
    assert command[:4] == [sys.executable, "-P", "-m", "rerun"]
    environment = {**viewer_environment(), "HOME": str(trapped / "home")}
    said = subprocess.run([*command[:4], "--version"], cwd=trapped, env=environment, capture_output=True, text=True)
    assert said.returncode == 0, said.stderr
    assert "rerun" in said.stdout
    assert not list(trapped.glob("ran-*"))
    assert not list((trapped / "home").rglob("analytics*")), "its usage statistics are off"


@pytest.mark.program
def test_a_command_in_a_folder_of_traps_runs_none_of_them(trapped: Path) -> None:
    script = Path(sys.executable).with_name("minihuman")
    if not script.exists():
        pytest.skip("minihuman is not installed as a command here")
    protocol = Path(__file__).parents[2] / "protocols" / "demo.toml"
    cache = {**os.environ, "NUMBA_CACHE_DIR": str(trapped / "cache")}  # nothing is compiled yet, so a companion starts
    command = [script, "run", protocol, "--data", trapped / "data", "--window", "none"]
    said = subprocess.run(command, cwd=trapped, env=cache, capture_output=True, text=True, timeout=300)
    assert said.returncode == 2, "there is no such window; by then every world is compiled"
    assert "Traceback" not in said.stderr
    assert not list(trapped.glob("ran-*"))


def test_a_module_that_a_log_names_is_not_imported() -> None:
    sys.modules.pop("this", None)
    with pytest.raises(WorldError, match="pass --trust this"):
        trusted_world_factory()("this:X-v0", {})
    assert "this" not in sys.modules
    with pytest.raises(WorldError, match="X"):
        trusted_world_factory(["this"])("this:X-v0", {})
    assert "this" in sys.modules
