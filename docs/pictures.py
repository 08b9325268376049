"""Make the pictures of these pages again.

python docs/pictures.py FOLDER

Figures and windows need nothing but minihuman; the report's page is photographed by Chromium and the replays by rerun's
viewer, under a virtual display. ``CONTRIBUTING.md`` says the same command by command.
"""

import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gymnasium
import numpy as np
from PIL import Image

from minihuman.activities.correction.screens import FilmScreen
from minihuman.activities.preferences.screens import PairScreen
from minihuman.admin.protocol_file import read_protocol
from minihuman.agents.team_agents import CookAgent
from minihuman.display.drawing.screen import compose_screen, picture_size_px
from minihuman.display.windows.window import VirtualClock
from minihuman.experiment.machine.screens import PlayScreen, Screen, TextScreen
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.protocol.protocol import Protocol, decode_protocol
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.runtime.agent_host import make_agent_host
from minihuman.runtime.session_loop import run_session
from minihuman.runtime.simulated_window import SimulatedWindow
from minihuman.runtime.team_host import TeamTable
from minihuman.simulation.participant import make_participant
from minihuman.worlds.adapters.world import World
from minihuman.worlds.grid.kitchen import Kitchen

ROOT = Path(__file__).parents[1]
STUDY = "fourrooms-transfer"
WINDOW_PX = (800, 450)
STEPS_COOKED = 60


def figures(folder: Path, work: Path) -> None:
    """Figures and the report of ten simulated people."""
    cli = [sys.executable, "-m", "minihuman"]
    people = ["--participants", "10", "--data", str(work)]
    subprocess.run([*cli, "simulate", str(ROOT / f"protocols/{STUDY}.toml"), *people], check=True)
    subprocess.run([*cli, "plot", str(work / STUDY), "--out", str(work / "figures")], check=True)
    one = work / STUDY / "sub-01/ses-01"
    subprocess.run([*cli, "plot", str(one), "--out", str(work / "figures")], check=True)
    for name, pattern in (("learning", "learning_*.png"), ("occupancy", "occupancy_*.png")):
        shutil.copy(sorted((work / "figures").glob(pattern))[-1], folder / f"{name}.png")
    for name in ("overview", "paths"):
        shutil.copy(next((work / "figures").glob(f"*/{name}.png")), folder / f"{name}.png")


def windows(folder: Path, work: Path) -> None:
    """What a participant of the demo sees, as every window composes it."""
    screens = _screens(read_protocol(ROOT / "protocols/demo.toml"), "optimal", work)
    wanted = {"window_keyboard_check": _is_check, "window_grid": _in_grid, "window_first_person": _in_room}
    for name, is_it in wanted.items():
        screen = next(screen for screen in screens if is_it(screen))
        Image.fromarray(compose_screen(screen, WINDOW_PX)).save(folder / f"{name}.png")
    demo = (ROOT / "protocols/demo.toml").read_text(encoding="utf-8")
    text = decode_protocol(demo.replace("max_steps = 100", 'max_steps = 100\nview = "text"', 1).encode())
    first = [
        one for one in _screens(text, "optimal", work / "text") if isinstance(one, PlayScreen) and one.episode == 0
    ]
    shown = sorted(first, key=lambda screen: screen.step)[-4]  # the goal is in sight
    Image.fromarray(compose_screen(shown, WINDOW_PX)).save(folder / "window_text.png")


def teaching(folder: Path, work: Path) -> None:
    """What a person sees who teaches: protocols/teach-fourrooms.toml with an agent that needs no learner."""
    toml = (ROOT / "protocols/teach-fourrooms.toml").read_text()
    for old, new in (('policy = ""', 'policy = "optimal:0.5"'), ('learner = "hg-dagger:updates=300"', "")):
        assert old in toml
        toml = toml.replace(old, new)
    screens = _screens(decode_protocol(toml.encode()), "supervisor:knows_all=1", work)
    played = [screen for screen in screens if isinstance(screen, PlayScreen) and screen.step > 1]
    wanted: dict[str, Screen] = {
        f"teach_{who}": next(s for s in played if s.controller == who) for who in ("agent", "person")
    }
    wanted["teach_correct"] = max((s for s in screens if isinstance(s, FilmScreen)), key=lambda film: film.step)
    wanted["teach_compare"] = next(s for s in screens if isinstance(s, PairScreen) and s.along > 0.5)
    for name, screen in wanted.items():
        Image.fromarray(compose_screen(screen, WINDOW_PX)).save(folder / f"{name}.png")


def water_maze(folder: Path) -> None:
    """The pool of protocols/navigation, as who starts in the west sees it."""
    sys.path.insert(0, str(ROOT / "protocols/navigation"))
    import_module("water_maze")
    with closing(World("WaterMaze-v0", {"start": "west"}, trusted=True)) as world:
        world.reset(0)
        Image.fromarray(world.frame(size_px=(560, 420))).quantize(128).save(folder / "water_maze.png", optimize=True)


def two_floors(folder: Path) -> None:
    """The building of two floors: the hall with its stairs, and the plans of both floors."""
    sys.path.insert(0, str(ROOT / "protocols" / "navigation"))
    import_module("wayfinding")
    with closing(World("TwoFloors-v0", {"trig": 1}, trusted=True)) as world:
        world.reset(1)
        env = world.unwrapped
        env.agent.pos = (2.0, 0.0, 2.6)
        env.agent.dir = 0.08
        hall = env.picture(size_px=(560, 420))
        plans = [env.picture(view="full", floor=floor, size_px=(280, 210)) for floor in (1, 0)]
        picture = np.hstack([hall, np.vstack(plans)])
        colours = Image.fromarray(picture).quantize(128, method=Image.Quantize.MAXCOVERAGE)  # of small things, too
        colours.save(folder / "two_floors.png", optimize=True)


def rules_and_goals(folder: Path) -> None:
    """A task of protocols/rules.toml, as every window composes it, with a thing in hand."""
    study = read_protocol(ROOT / "protocols/rules.toml")
    plan = expand_protocol(study, enrol_participant(study, 0))
    episode = next(planned for planned in plan.episodes if planned.block_name == "two-rules")
    env: Any = gymnasium.make(episode.world, **episode.options).unwrapped
    env.reset(seed=episode.seed)
    for action in env.shortest_path()[:-1]:
        env.step(action)
    picture = env.picture(view="full", size_px=picture_size_px(WINDOW_PX))
    legend = tuple(episode.key_map.keys.items())
    shown = PlayScreen(picture, env.mission, "Part 3 of 4, episode 1 of 5", legend)
    Image.fromarray(compose_screen(shown, WINDOW_PX)).save(folder / "window_rules.png", optimize=True)


def kitchen(folder: Path) -> None:
    """A kitchen in which both cooks have something to do."""
    cooked = Kitchen(layout="counter_circuit_o_1order")
    cooked.reset(0)
    agents, rng = [CookAgent(""), CookAgent("")], np.random.default_rng(0)
    for _ in range(STEPS_COOKED):
        joint = []
        for seat, agent in enumerate(agents):
            view: Any = SimpleNamespace(
                unwrapped=SimpleNamespace(team=cooked, seat=seat), action_names=cooked.action_names
            )
            joint.append(int(rng.choice(6, p=agent.action_probabilities(view).astype(np.float64))))
        cooked.step(joint)
    Image.fromarray(cooked.frame(0, 640, 400)).save(folder / "team_kitchen.png")


def teams(folder: Path, work: Path) -> None:
    """What two people see who are in one kitchen: protocols/team.toml, at the same step."""
    toml = (ROOT / "protocols/team.toml").read_text()
    for old, new in (('pairing = "drawn"', 'roles = ["cook 1", "cook 2"]'), ("max_steps = 200", "max_steps = 40")):
        assert old in toml
        toml = toml.replace(old, new)
    protocol = decode_protocol(toml.replace("episodes = 4", "episodes = 1").encode())
    table = TeamTable(protocol, work, lambda: 0.0, gather=2)
    with ThreadPoolExecutor(2) as pool:
        both = list(pool.map(lambda index: _screens(protocol, "random", work, index, "two-people", table), (0, 1)))
    seen = [next(s for s in screens if isinstance(s, PlayScreen) and s.step == 30) for screens in both]
    one, other = (compose_screen(screen, WINDOW_PX) for screen in seen)
    gap = np.full((WINDOW_PX[1], 12, 3), 255, np.uint8)
    Image.fromarray(np.hstack([one, gap, other])).save(folder / "teams.png", optimize=True)


def _screens(
    protocol: Protocol,
    player: str,
    work: Path,
    index: int = 0,
    group: str | None = None,
    table: TeamTable | None = None,
) -> list[Screen]:
    """Every screen of a session, as a simulated person comes past it."""
    clock = VirtualClock()
    plan = expand_protocol(protocol, enrol_participant(protocol, index, group), overridden=group is not None)
    session = SessionMachine(plan, World, {}, picture_px=(600, 450))
    recorder = McapRecorder(work, plan, started_ns=0)
    seen: list[Screen] = []

    class Watching(SimulatedWindow):
        def show(self, screen: Screen):  # type: ignore[no-untyped-def]
            film = isinstance(screen, FilmScreen)  # whose pictures are drawn when they are asked for
            seen.append(replace(screen, pictures=tuple(screen.pictures)) if film else screen)
            return super().show(screen)

    window = Watching(make_participant(player, np.random.default_rng(1)), session, clock)
    run_session(
        session, window, recorder, clock, agent=make_agent_host(protocol, plan, work, patient=True, teams=table)
    )
    return seen


def _is_check(screen: Screen) -> bool:
    return isinstance(screen, TextScreen) and bool(getattr(screen, "keys", ()))


def _in_grid(screen: Screen) -> bool:
    return isinstance(screen, PlayScreen)


def _in_room(screen: Screen) -> bool:
    return isinstance(screen, PlayScreen) and screen.picture.shape[0] != screen.picture.shape[1]  # a grid is square


def main(folder: Path) -> None:
    """Make them all that need no display."""
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as work:
        figures(folder, Path(work))
        windows(folder, Path(work))
        teaching(folder, Path(work))
        teams(folder, Path(work))
    kitchen(folder)
    water_maze(folder)
    two_floors(folder)
    rules_and_goals(folder)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
