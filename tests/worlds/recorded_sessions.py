"""Sessions in five kinds of world, each recorded, verified, replayed, drawn and exported: what was exported replays.

    python -m tests.worlds.recorded_sessions

writes the results into docs/environments.md. Keys are held and clicks made by a script; the arm is moved by SDL's
virtual gamepad in a pygame window. What is not installed is left out, and said.
"""

import datetime
import os
import random
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

PAGE = Path(__file__).parents[2] / "docs/environments.md"
HEADING = "## Recorded sessions"
_TOML = """
[study]
name = "recorded"
version = "1"
seed = 5
closing = ""
[keys]
pool = {pool}
keyboard_check = false
[[groups]]
name = "all"
blocks = ["world"]
[[blocks]]
name = "world"
world = "{world}"
episodes = 1
actions = {actions}
key_map = "fixed"
fixed_keys = {{ {keys} }}
max_steps = {steps}
final_frame_ms = 0
{more}
"""
_HELD = 'pace = "real_time"\nstep_period_ms = {period_ms}\nnoop_action = "{noop}"\nhold = "repeat"\n'


@dataclass(frozen=True, slots=True)
class Recording:
    """A world and how it is played."""

    name: str
    package: str  # that brings it
    module: str  # that registers it; "" for Gymnasium's own
    world: str
    keys: dict[str, str]
    noop: str = ""
    period_ms: float = 20.0
    steps: int = 150
    more: str = ""
    player: str = "keys"

    @property
    def is_installed(self) -> bool:
        return all(find_spec(name) is not None for name in (self.package.replace("-", "_"), "minari", "gymnasium"))

    def toml(self) -> str:
        held = _HELD.format(period_ms=self.period_ms, noop=self.noop) if self.noop else ""
        return _TOML.format(
            pool=list(self.keys),
            world=f"{self.module}:{self.world}" if self.module else self.world,
            actions=list(self.keys.values()),
            keys=", ".join(f'{key} = "{action}"' for key, action in self.keys.items()),
            steps=self.steps,
            more=held + self.more,
        )


_ARROWS = {"left": "axis_0_minus", "right": "axis_0_plus", "up": "axis_1_plus"}
RECORDINGS = (
    Recording("a car, keys held", "Box2D", "", "CarRacing-v3", _ARROWS | {"down": "axis_2_plus"}, "rest"),
    Recording("a lander, keys held", "Box2D", "", "LunarLanderContinuous-v3", _ARROWS, "rest"),
    Recording(
        "an arcade game, keys held",
        "ale-py",
        "ale_py",
        "ALE/Breakout-v5",
        {"space": "fire", "left": "left", "right": "right"},
        "noop",
        1000 / 15,
        120,
    ),
    Recording(
        "an arm, by gamepad",
        "mujoco",
        "",
        "Reacher-v5",
        {"pad_south": "axis_0_plus", "stick_up": "axis_1_minus"},
        "rest",
        25.0,
        50,
        "axes = { pad_left_x = { component = 0, scale = -1.0 }, pad_left_y = { component = 1 } }\n",
        "gamepad",
    ),
    Recording(
        "a game of arcengine, by clicks",
        "arcengine",
        "docs.other_worlds",
        "other/ArcLights-v0",
        {"1": "axis_0_plus"},
        period_ms=200.0,
        steps=20,
        more="spot = { x = 0, y = 1 }\n",
        player="clicks",
    ),
)


def record(one: Recording, data: Path) -> Path:
    """Play the session; the log."""
    if one.player == "gamepad":
        protocol = data / "pad.toml"
        data.mkdir(parents=True, exist_ok=True)
        protocol.write_text(one.toml())
        command = [sys.executable, "-m", "tests.windows.virtual_gamepad", str(data), str(protocol)]
        env = {"MUJOCO_GL": "egl", **os.environ}  # SDL's window has no display, so MuJoCo must do without one, too
        subprocess.run(command, check=True, timeout=300, capture_output=True, cwd=Path(__file__).parents[2], env=env)
    else:
        _play(one, data)
    [log] = data.rglob("*.mcap")
    return log


def _play(one: Recording, data: Path) -> None:
    from minihuman.display.windows.window import ScriptedWindow, VirtualClock
    from minihuman.experiment.machine.inputs import Input, KeyDown, KeyUp, PointerPressed
    from minihuman.experiment.machine.session import SessionMachine
    from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
    from minihuman.experiment.protocol.protocol import decode_protocol
    from minihuman.log.record.mcap_recorder import McapRecorder
    from minihuman.runtime.session_loop import run_session
    from minihuman.worlds.adapters.world import World

    ms, draw, keys = 1_000_000, random.Random(3), list(one.keys)
    inputs: list[Input] = [KeyDown(60 * ms, "enter"), KeyUp(70 * ms, "enter")]
    at_ms, end_ms, down = 150.0, 150 + one.steps * one.period_ms, set[str]()
    while at_ms < end_ms:
        at_ms += draw.uniform(5, 120)
        at_ns = round(at_ms * ms)
        if one.player == "clicks":
            inputs.append(PointerPressed(at_ns, draw.random(), draw.random(), "picture"))
            continue
        key = draw.choice(keys)
        down ^= {key}
        inputs.append((KeyDown if key in down else KeyUp)(at_ns, key, key))
    inputs.append(KeyUp(round((end_ms + 60_000) * ms), "f7"))
    protocol = decode_protocol(one.toml().encode())
    plan, clock = expand_protocol(protocol, enrol_participant(protocol, 0)), VirtualClock()
    session = SessionMachine(plan, World, {"machine": "script"})
    recorder = McapRecorder(data, plan, started_ns=0)
    run_session(session, ScriptedWindow(inputs, clock, frame_ns=2 * ms), recorder, clock)
    assert session.failure is None, session.failure


def try_recording(one: Recording, folder: Path) -> str:
    """Record, verify, draw, export and replay what was exported; a line of what was found."""
    import minihuman
    from minihuman.admin.verify.log import find_log_differences, verify_session
    from minihuman.dataset.tables import select
    from minihuman.figures.gallery import draw_all_figures
    from minihuman.log.read.session_reader import read_log
    from minihuman.trust import Trust, list_foreign_modules
    from minihuman.worlds.adapters.world import World

    world_id = f"{one.module}:{one.world}" if one.module else one.world
    if one.module:
        Trust(frozenset(), list_foreign_modules([world_id])).record()
    log = record(one, folder / "data")
    assert list(find_log_differences(log, World)) == []
    assert all(ok for _, ok in verify_session(log)), [text for text, ok in verify_session(log) if not ok]
    [episode] = read_log(log).episodes
    kinds = len({*episode.actions_taken})
    assert kinds > 3 or one.world.startswith("ALE"), "the world was played"
    study = folder / "data" / "recorded"
    figures = list(draw_all_figures(select(study), folder / "figures", each_session=True))
    assert [path for path in figures if path.stat().st_size > 1000]
    minihuman.export("minari", study, folder / "minari")
    minihuman.export("lerobot", study, folder / "lerobot")
    for read in (read_minari, read_lerobot):
        actions, rewards = read(folder, world_id)
        again = replay_rewards(world_id, episode.plan.seed, actions)
        np.testing.assert_allclose(again, rewards, rtol=1e-6, atol=1e-6, err_msg=read.__name__)  # LeRobot's are float32
    return f"{len(episode.actions)} steps, {kinds} different actions"


def read_minari(folder: Path, world_id: str) -> tuple[list[Any], list[float]]:
    """The actions that Minari hands out, and the rewards."""
    import minari

    os.environ["MINARI_DATASETS_PATH"] = str(folder / "minari")
    [stored] = minari.load_dataset(next(iter(minari.list_local_datasets()))).iterate_episodes()
    return [take_row(stored.actions, row) for row in range(len(stored.rewards))], list(stored.rewards)


def take_row(actions: Any, row: int) -> Any:
    """One action of what Minari keeps: a dict or tuple of columns where the space is one."""
    if isinstance(actions, dict):
        return {name: take_row(column, row) for name, column in actions.items()}
    if isinstance(actions, tuple):
        return tuple(take_row(column, row) for column in actions)
    return actions[row]


def read_lerobot(folder: Path, world_id: str) -> tuple[list[Any], list[float]]:
    """The actions of the LeRobot data set's columns, and the rewards."""
    import pyarrow.parquet as pq

    from minihuman.worlds.adapters.world import World

    [table] = [pq.read_table(path) for path in (folder / "lerobot").rglob("data/**/*.parquet")]
    rewards = np.ravel(np.array(table["next.reward"].to_pylist())).tolist()
    if "discrete_action" in table.column_names:
        return np.ravel(np.array(table["discrete_action"].to_pylist())).tolist(), rewards
    world = World(world_id)
    vectors = [tuple(float(value) for value in row) for row in table["action"].to_pylist()]
    return [world.actions.value(vector) for vector in vectors], rewards


def replay_rewards(world_id: str, seed: int, actions: list[Any]) -> list[float]:
    """What Gymnasium's own environment gives for them."""
    env = gymnasium.make(world_id, render_mode="rgb_array")
    env.reset(seed=seed)
    found = [float(env.step(action)[1]) for action in actions]
    env.close()
    return found


def write_page(results: list[tuple[Recording, str]]) -> None:
    """The section of docs/environments.md."""
    brought = sorted({one.package for one, found in results if not found.startswith("not")} | {"gymnasium", "minari"})
    versions = ", ".join(f"{name} {version(name)}" for name in brought if name != "Box2D")
    before = PAGE.read_text(encoding="utf-8").partition(HEADING)[0].rstrip()
    lines = [
        HEADING,
        "",
        "One session each, logged, verified, replayed, drawn and exported to Minari and LeRobot; the exported actions",
        "gave the logged rewards in Gymnasium's own environment.",
        f"{datetime.datetime.now(datetime.UTC):%d %B %Y}, {versions}; `python -m tests.worlds.recorded_sessions`.",
        "",
        "| what | world | found |",
        "|---|---|---|",
        *(f"| {one.name} | `{one.world}` | {found} |" for one, found in results),
    ]
    PAGE.write_text("\n".join([before, "", *lines, ""]), encoding="utf-8", newline="\n")


def main(only: Callable[[Recording], bool] = lambda one: one.is_installed) -> None:
    """Try what is installed; keep what the page says of the rest."""
    known = PAGE.read_text(encoding="utf-8").splitlines()
    results = []
    for one in RECORDINGS:
        before = next((line.split(" | ")[2].strip(" |") for line in known if f"| `{one.world}` |" in line
                       and line.startswith(f"| {one.name}")), "not tried")  # fmt: skip
        with tempfile.TemporaryDirectory() as name:
            found = before if not only(one) else try_recording(one, Path(name))
        print(one.name, found, flush=True)
        results.append((one, found))
    write_page(results)


if __name__ == "__main__":
    if str(Path(__file__).parents[2]) not in sys.path:
        sys.path.insert(0, str(Path(__file__).parents[2]))
    import_module("docs.other_worlds") if find_spec("arcengine") else None
    main()
