"""A minute in real time of environments of every family, in a window and in Chromium, with keys held at random.

    python -m tests.worlds.real_time_minutes [--only Breakout CarRacing] [--in window browser]

The families beyond the first twelve environments, and ten arcade games that a seed draws, are played in Chromium alone.

Each session is of the study that `minihuman new --world ID` writes, with episodes that follow each other for 60 s of
play. The window is on an X server of its own (Xvfb) and gets its keys from it (XTEST); Chromium gets them from its
driver. `minihuman verify` then judges the log. Writes the results into docs/environments.md; what is not installed
keeps the result that the page has.
"""

import argparse
import datetime
import json
import os
import random
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from docs.environments import register
from tests.programs import running

ROOT = Path(__file__).parents[2]
PAGE = ROOT / "docs/environments.md"
FOUND = ROOT / "docs/environments-real-time.json"
HEADING, NEXT = "## A minute in real time", "## Recorded sessions"
SECONDS = 60
WORLDS = {  # and the package that brings it
    "CartPole-v1": "gymnasium",
    "LunarLander-v3": "Box2D",
    "CarRacing-v3": "Box2D",
    "BipedalWalker-v3": "Box2D",
    "Reacher-v5": "mujoco",
    "HalfCheetah-v5": "mujoco",
    "ale_py:ALE/Breakout-v5": "ale_py",
    "ale_py:ALE/MontezumaRevenge-v5": "ale_py",
    "highway_env:highway-v0": "highway_env",
    "highway_env:parking-v0": "highway_env",
    "other_worlds:other/Crafter-v1": "crafter",
    "other_worlds:other/MiniHack-Room-Ultimate-15x15-v0": "minihack",
}
ARCADE_SEED, ARCADE_GAMES = 47, 10
BROWSER_ONLY = {
    "Taxi-v4": "gymnasium",
    "gymnasium_robotics:FetchReach-v4": "gymnasium_robotics",
    "gym_pusht:gym_pusht/PushT-v0": "gym_pusht",
    "vizdoom.gymnasium_wrapper:VizdoomBasic-v1": "vizdoom",
    "gymnasium_search_race:gymnasium_search_race/SearchRaceDiscrete-v3": "gymnasium_search_race",
}
_CODES = {"space": "Space", "page_up": "PageUp", "page_down": "PageDown"} | {
    arrow: f"Arrow{arrow.capitalize()}" for arrow in ("left", "right", "up", "down")
}


def draw_arcade_games() -> list[str]:
    """Ten games of those in the table of environments, by seed, without those that are played anyway."""
    tried = json.loads(PAGE.with_suffix(".json").read_text(encoding="utf-8"))
    games = sorted(name for name in tried if name.startswith("ale_py:") and name not in WORLDS)
    return random.Random(ARCADE_SEED).sample(games, ARCADE_GAMES)


def list_minutes() -> dict[tuple[str, str], str]:
    """Each environment and the place where it is played, and the package that brings it."""
    minutes = {(world_id, place): package for world_id, package in WORLDS.items() for place in ("window", "browser")}
    minutes |= {(world_id, "browser"): package for world_id, package in BROWSER_ONLY.items()}
    return minutes | {(world_id, "browser"): "ale_py" for world_id in draw_arcade_games()}


def write_study(world_id: str, folder: Path) -> tuple[Path, list[str], float | None]:
    """A protocol of one block that lasts a minute; its path, its keys and its period."""
    from minihuman.admin.protocol_file import ProtocolDraft
    from minihuman.experiment.protocol.protocol import decode_protocol

    text = ProtocolDraft(name="minute", world=world_id, episodes=1, participants=1).toml()
    text = re.sub(r"(?m)^episodes = 1$", "episodes = 400", text)
    text += f'max_block_s = {SECONDS}.0\nready = "first"\nfeedback_ms = 500\n'
    path = folder / "minute.toml"
    path.write_text(text, encoding="utf-8")
    protocol = decode_protocol(text.encode())
    [block] = protocol.blocks
    return (
        path,
        list(block.fixed_keys or protocol.keys.pool),
        block.step_period_ms if block.pace == "real_time" else None,
    )


def hold_at_random(keys: list[str], draw: random.Random) -> Iterator[tuple[str, bool, float]]:
    """Keys that go down and up for ever: the key, whether it goes down, and the wait before it, in seconds."""
    down: set[str] = set()
    while True:
        key = draw.choice(sorted(down)) if len(down) > 1 and draw.random() < 0.7 else draw.choice(keys)
        yield key, key not in down, draw.uniform(0.03, 0.25)
        down ^= {key}


def play_in_window(protocol: Path, data: Path, keys: list[str]) -> None:
    from minihuman.display.windows.blocking_window import TITLE
    from tests.xserver import Typist, xvfb

    with xvfb() as display:
        command = [sys.executable, "-m", "minihuman", "run", str(protocol), "--data", str(data), "--windowed"]
        env = {**os.environ, "DISPLAY": display}
        until_s = time.monotonic() + 4 * SECONDS
        with running(command, env=env, stderr=subprocess.PIPE, text=True) as program:
            typist = Typist(display)
            typist.focus(TITLE)
            enter_s = 0.0
            for key, goes_down, wait_s in hold_at_random(keys, random.Random(1)):
                time.sleep(wait_s)
                if program.poll() is not None:
                    break
                (typist.press if goes_down else typist.release)(key)
                if time.monotonic() > enter_s:
                    typist.tap("enter")
                    enter_s = time.monotonic() + 1.0
                if time.monotonic() > until_s:
                    program.kill()
            typist.close()
            assert program.stderr is not None
            said = program.stderr.read()
        assert program.returncode == 0, said


def play_in_browser(protocol: Path, data: Path, keys: list[str]) -> None:
    from tests.web.browser import browsing
    from tests.web.serving import serving

    with serving(protocol, data) as served, browsing() as sit_down:
        person = sit_down(f"http://127.0.0.1:{served.port}/#t={served.tokens[0]}")
        keyboard = person.page.keyboard
        person.page.wait_for_function("typeof minihuman !== 'undefined'")
        person.until("s.welcomed && s.kind !== ''", patience_s=180)
        enter_s = 0.0
        for key, goes_down, wait_s in hold_at_random(keys, random.Random(1)):
            person.page.wait_for_timeout(1000 * wait_s)
            if person.state["finished"]:
                break
            code = _CODES.get(key) or (f"Digit{key}" if key.isdigit() else f"Key{key.upper()}")
            (keyboard.down if goes_down else keyboard.up)(code)
            if time.monotonic() > enter_s:
                keyboard.press("Enter")
                enter_s = time.monotonic() + 1.0
        assert person.errors == [], person.errors
        for _ in range(600):  # the page is done before the log is
            if any(data.rglob("*.mcap")):
                break
            time.sleep(0.1)


def measure_cost_ms(world_id: str, steps: int = 15) -> float:
    """What a step and its picture cost in Gymnasium's own environment, in milliseconds of CPU time."""
    import gymnasium

    module, _, name = world_id.rpartition(":")
    if module:
        register(module)
    env = gymnasium.make(name, render_mode="rgb_array", disable_env_checker=True)
    env.reset(seed=0)
    env.render()
    began_s = time.process_time()
    for _ in range(steps):
        _, _, terminated, truncated, _ = env.step(env.action_space.sample())
        env.render()
        if terminated or truncated:
            env.reset()
    cost_ms = 1000 * (time.process_time() - began_s) / steps
    env.close()
    return cost_ms


def try_world(world_id: str, where: str) -> dict[str, str]:
    """Play for a minute and verify; what was found."""
    from minihuman.log.read.session_reader import read_log
    from minihuman.trust import Trust, list_foreign_modules

    Trust(frozenset(), list_foreign_modules([world_id])).record()
    with tempfile.TemporaryDirectory() as name:
        data = Path(name)
        protocol, keys, period_ms = write_study(world_id, data)
        load = os.getloadavg()[0]
        {"window": play_in_window, "browser": play_in_browser}[where](protocol, data, keys)
        [path] = data.rglob("*.mcap")
        log = read_log(path)
        checked = subprocess.run(
            [sys.executable, "-m", "minihuman", "verify", str(path)], capture_output=True, text=True, check=False
        )
    played_s = sum(int(one.t_ns[-1] - one.t_ns[0]) for one in log.episodes if len(one.t_ns) > 1) / 1e9
    spaces_ms = np.concatenate([np.diff(one.t_ns) / 1e6 for one in log.episodes if len(one.t_ns) > 1] or [np.zeros(1)])
    steps = sum(len(one.actions) for one in log.episodes)
    lines = (checked.stdout + checked.stderr).strip().splitlines()
    print(*lines, sep="\n", flush=True)
    pace = f"{np.median(spaces_ms):.1f} of {period_ms:.1f}" if period_ms else "on key"
    return {
        "steps": f"{steps:,} in {played_s:.0f} s",
        "period": pace,
        "period_95": f"{np.quantile(spaces_ms, 0.95):.1f}" if period_ms else "",
        "episodes": str(len(log.episodes)),
        "actions": str(len({*(action for one in log.episodes for action in one.actions_taken)})),
        "verify": "clean" if checked.returncode == 0 else "differs",
        "cost": f"{measure_cost_ms(world_id):.0f}",
        "load": f"{max(load, os.getloadavg()[0]):.0f}",
        "date": f"{datetime.datetime.now(datetime.UTC):%d %B %Y}",
    }


def write_page(found: dict[str, dict[str, str]]) -> None:
    """The section of docs/environments.md."""
    text = PAGE.read_text(encoding="utf-8")
    tried = json.loads(PAGE.with_suffix(".json").read_text(encoding="utf-8"))
    before, after = text.partition(HEADING)[0].partition(NEXT)[0].rstrip(), text.partition(NEXT)[2]
    loads = [int(one["load"]) for one in found.values()]
    days = dict.fromkeys(one["date"] for one in found.values())
    lines = [
        HEADING,
        "",
        f"Worlds played for {SECONDS} s each, in a pygame window under Xvfb and in Chromium, with keys held at random;",
        "`minihuman verify` then replayed the log. *Period*: the time between two steps in ms, median and 95 %, and",
        "the protocol's. *Own*: CPU-ms of a step and its picture in Gymnasium's environment alone, MuJoCo's without a",
        "graphics card. A world whose own time is near the period or above it cannot keep real time.",
        f"The last {ARCADE_GAMES} are games of ale-py that the seed {ARCADE_SEED} drew.",
        f"Two cores at a load of up to {max(loads)}, so the times are upper values.",
        f"{', '.join(days)}; `python -m tests.worlds.real_time_minutes`.",
        "",
        "| id | where | steps | episodes | different actions | period | 95 % | own | verify |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for world_id, where in list_minutes():
        if one := found.get(f"{world_id} {where}"):
            columns = ("steps", "episodes", "actions", "period", "period_95", "cost", "verify")
            cells = " | ".join(one.get(column, "") for column in columns)
            mark = ", marked nondeterministic" if tried.get(world_id, {}).get("replays", "").startswith("no") else ""
            lines.append(f"| `{world_id}` | {where} | {cells}{mark} |")
    missing = [
        f"`{world_id}` in the {where}" for world_id, where in list_minutes() if f"{world_id} {where}" not in found
    ]
    lines += ["", f"No result yet: {', '.join(missing)}."] if missing else []
    PAGE.write_text("\n".join([before, "", *lines, "", NEXT + after]), encoding="utf-8", newline="\n")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", nargs="+", default=[""], help="the ids with one of these in them")
    parser.add_argument("--in", nargs="+", default=["window", "browser"], dest="places")
    parser.add_argument("--costs", action="store_true", help="only measure again what a step costs, of known results")
    asked = parser.parse_args()
    if asked.costs:
        known = json.loads(FOUND.read_text(encoding="utf-8"))
        for name, one in known.items():
            one["cost"] = f"{measure_cost_ms(name.rpartition(' ')[0]):.0f}"
        FOUND.write_text(json.dumps(known, indent=1) + "\n", encoding="utf-8", newline="\n")
        write_page(known)
        return
    for (world_id, where), package in list_minutes().items():
        if where not in asked.places or not any(part in world_id for part in asked.only) or find_spec(package) is None:
            continue
        found = try_world(world_id, where)
        print(world_id, where, found, flush=True)
        known = json.loads(FOUND.read_text(encoding="utf-8")) if FOUND.exists() else {}
        known[f"{world_id} {where}"] = found
        FOUND.write_text(json.dumps(known, indent=1) + "\n", encoding="utf-8", newline="\n")
        write_page(known)


if __name__ == "__main__":
    if str(ROOT / "docs") not in sys.path:
        sys.path.insert(0, str(ROOT / "docs"))
    os.environ["PYTHONPATH"] = os.pathsep.join([str(ROOT), str(ROOT / "docs"), os.environ.get("PYTHONPATH", "")])
    os.environ.setdefault("MUJOCO_GL", "egl")  # its picture is drawn without a window, as on a server
    main()
