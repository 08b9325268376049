"""The commands say in a sentence what is wrong with a world, and never end as if all were done."""

import signal
from pathlib import Path

import pytest

from minihuman.cli import main
from minihuman.worlds.adapters.world import World
from tests.worlds.odd.contract import build_odd_study
from tests.worlds.odd.table import ODD


@pytest.fixture(autouse=True)
def trusted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("MINIHUMAN_TRUST", "tests.worlds.odd.table")


def run_command(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *arguments: str
) -> tuple[int, str]:
    """Run a command in this process: its exit status, and what it printed as an error."""
    monkeypatch.setattr("sys.argv", ["minihuman", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    return int(ended.value.code or 0), capsys.readouterr().err


@pytest.mark.parametrize("command", ["check", "simulate", "serve"])
@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("StepExits", "step() tried to end the program"),
        ("StepInterrupts", "step() raised KeyboardInterrupt"),
        ("StepRaises", "step() raised ValueError: no such cell"),
        ("RewardNone", "the reward must be one number and is nothing (None)"),
        ("PictureFloat01", "which are shown as black"),
    ],
)
def test_a_world_that_fails_is_an_error_with_a_sentence(
    command: str,
    name: str,
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    protocol = tmp_path / "odd.toml"
    protocol.write_bytes(build_odd_study(ODD[name]).toml)
    others = [] if command == "check" else ["--data", str(tmp_path / "data")]
    code, error = run_command(monkeypatch, capsys, command, str(protocol), *others)
    assert code == 2
    assert said in error
    assert "Traceback" not in error
    assert error.count("\n") == 1


def test_ctrl_c_in_a_worlds_step_is_the_users(monkeypatch: pytest.MonkeyPatch) -> None:
    """Python has the signal handled between two instructions, so the error is raised where no code raises."""
    world = World(ODD["StepList"].id)
    world.reset(0)
    monkeypatch.setattr(world.unwrapped, "reward", lambda: signal.raise_signal(signal.SIGINT))
    handler = signal.signal(signal.SIGINT, signal.default_int_handler)  # a program in the background ignores it
    try:
        with pytest.raises(KeyboardInterrupt):
            world.step(0)
    finally:
        signal.signal(signal.SIGINT, handler)
