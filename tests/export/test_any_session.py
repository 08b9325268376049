"""Whatever a session holds, every format writes it or says one line: no traceback, nothing half-written."""

import shutil
import subprocess
import sys
from pathlib import Path

import gymnasium
import numpy as np
import pytest

from minihuman.dataset.selection import Selection
from minihuman.errors import ExportError
from minihuman.exporters.exporter import export_study, list_exporters
from minihuman.worlds.grid.env import GridWorld
from minihuman.worlds.grid.object_kinds import door, goal, key
from tests.copied import as_another
from tests.export.study import recorded

pytestmark = pytest.mark.program

GOLDEN = Path(__file__).parents[1] / "golden/v1"
CASES = ["no-episode", "no-step", "resumed", "real-time", "cut-off", "recovered", "foreign"]
REPRESENTATIVE_CASES = {"no-episode", "resumed", "foreign"}  # no session, a common one, and a world of others
# formats that refuse a study without steps; every other one, a new one too, writes an empty export
NEED_STEPS = ("minari", "lerobot", "imitation", "robomimic", "rlds")
HIGHEST = """
import sys
from pathlib import Path
import pyarrow
from minihuman.dataset.selection import Selection
from minihuman.exporters.exporter import export_study
export_study("imitation", Path(sys.argv[1]), Path(sys.argv[2]), Selection())
print(pyarrow.default_memory_pool().max_memory())
"""
PROTOCOL = """
[study]
name = "{name}"
version = "1"
seed = 5
[[groups]]
name = "all"
blocks = ["only"]
[[blocks]]
name = "only"
world = "{world}"
episodes = 2
actions = {actions}
max_steps = {max_steps}
"""


class Corridor(GridWorld):
    """The world of docs/grid-worlds.md."""

    def __init__(self, length=9, **options):
        super().__init__(width=length, height=5, max_steps=100, mission="get out", **options)

    def layout(self, grid):
        grid.wall_rect()
        x = grid.integer(3, grid.width - 3)
        grid.down(x, 1, 3)
        grid.put(door("red", locked=True), x, 2)
        grid.put(goal(), grid.width - 2, 2)
        grid.place_agent(size=(x, grid.height))
        grid.place(key("red"), size=(x, grid.height))


gymnasium.register("lab/Corridor-v0", entry_point=Corridor, disable_env_checker=True, order_enforce=False)


def own(folder, name, world, actions, max_steps):
    toml = PROTOCOL.format(name=name, world=world, actions=actions, max_steps=max_steps).replace("'", '"')
    return recorded(folder, participants=1, player="random", toml=toml.encode())


@pytest.fixture(scope="module")
def studies(tmp_path_factory):
    folder = tmp_path_factory.mktemp("studies")
    for case in CASES:
        shutil.copytree(GOLDEN / case, folder / case)
    own(folder, "from-docs", "tests.export.test_any_session:lab/Corridor-v0", ["left", "forward", "pickup"], 40)
    own(folder, "from-one", "tests.worlds.endless:Endless-v0", ["left", "right"], 20)
    return folder


OF_TEAMS = {"pettingzoo", "overcooked"}  # tests/activities/team exports with them
UNFINISHED_TOO = Selection(with_=("unfinished",))


@pytest.mark.parametrize(
    "case",
    [
        case if case in REPRESENTATIVE_CASES else pytest.param(case, marks=pytest.mark.nightly(sample=number % 2 == 0))
        for number, case in enumerate((*CASES, "from-docs", "from-one"))
    ],
)
@pytest.mark.parametrize("name", sorted(set(list_exporters()) - OF_TEAMS))
def test_a_format_writes_a_session_or_says_why_not(studies, tmp_path, name, case):
    out = tmp_path / "out"
    if case in ("no-episode", "no-step") and name in NEED_STEPS:
        with pytest.raises(
            ExportError,
            match=r"nothing to export: .*0 episodes of 0 sessions included|nothing to export: .*has no step",
        ):
            export_study(name, studies / case, out, UNFINISHED_TOO)
        assert list(tmp_path.iterdir()) == []
        return
    written, _ = export_study(name, studies / case, out, UNFINISHED_TOO)
    assert written.episodes > 0 or case == "no-episode"
    assert all(path.exists() for path in written.paths)


def test_an_action_is_the_number_that_the_environment_takes(studies, tmp_path, monkeypatch):
    import minari

    export_study("minari", studies / "from-one", tmp_path / "out", Selection())
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "out"))
    dataset = minari.load_dataset("minihuman/from-one/endless-v0")
    env = dataset.recover_environment()
    for episode, facts in zip(dataset, dataset.storage.get_episode_metadata(range(2)), strict=True):
        assert set(episode.actions.tolist()) == {1, 3}  # left and right of three, counted from 1
        env.reset(seed=int(facts["seed"]))
        rewards = [env.step(action)[1] for action in episode.actions]
        assert rewards == episode.rewards.tolist()


def test_a_world_of_a_class_is_made_again_by_name(studies, tmp_path, monkeypatch):
    import minari

    export_study("minari", studies / "from-docs", tmp_path / "out", Selection())
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "out"))
    dataset = minari.load_dataset("minihuman/from-docs/corridor-v0")
    assert dataset.env_spec.entry_point == "tests.export.test_any_session:Corridor"
    env = dataset.recover_environment()
    for episode, facts in zip(dataset, dataset.storage.get_episode_metadata(range(2)), strict=True):
        observation, _ = env.reset(seed=int(facts["seed"]))
        assert np.array_equal(observation["image"], episode.observations["image"][0])
        for step, action in enumerate(episode.actions, 1):
            observation, *_ = env.step(action)
            assert np.array_equal(observation["image"], episode.observations["image"][step])


def test_two_attempts_of_an_episode_are_told_apart(studies, tmp_path, monkeypatch):
    import minari

    export_study("minari", studies / "resumed", tmp_path / "out", UNFINISHED_TOO)
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path / "out"))
    dataset = minari.load_dataset("minihuman/resumed/minigrid-empty-5x5-v0")
    facts = list(dataset.storage.get_episode_metadata(range(4)))
    places = [(its["segment"], its["episode"], its["attempt"], its["outcome"]) for its in facts]
    assert places == [(1, 1, 1, "goal"), (1, 2, 1, "abandoned"), (2, 2, 2, "goal"), (2, 3, 1, "goal")]
    assert [bool(e.terminations[-1] or e.truncations[-1]) for e in dataset] == [True] * 4
    assert dataset.storage.metadata["requirements"][0].startswith("minihuman-lab>=")


def test_what_a_format_cannot_hold_is_in_the_card(studies, tmp_path):
    folder = tmp_path / "both"
    shutil.copytree(studies / "no-step/sub-01", folder / "sub-02")
    shutil.copytree(studies / "resumed/sub-01", folder / "sub-01")
    written, _ = export_study("imitation", folder, tmp_path / "out", UNFINISHED_TOO)
    assert written.episodes == 4
    assert "sub-01 session 1 episode 1 has no step" in (tmp_path / "out/README.md").read_text()


@pytest.mark.nightly
def test_imitation_takes_no_more_memory_for_many_sessions(tmp_path):
    """What Arrow holds at its highest, in a fresh process each: trajectories are written as they come."""
    study = recorded(tmp_path, participants=1)
    [log] = study.rglob("*.mcap")
    highest = []
    for sessions in (8, 32):
        folder = tmp_path / f"of-{sessions}"
        for number in range(sessions):
            as_another(log, f"sub-{number:02}", folder)
        command = [sys.executable, "-c", HIGHEST, str(folder), str(tmp_path / f"out-{sessions}")]
        highest.append(int(subprocess.run(command, capture_output=True, text=True, check=True).stdout))
    assert highest[1] < 1.2 * highest[0]


@pytest.mark.parametrize("name", sorted(OF_TEAMS))
def test_a_format_of_teams_names_what_one_body_played(studies, tmp_path, name):
    with pytest.raises(ExportError, match=r"nothing to export: .*was played by one body"):
        export_study(name, studies / "resumed", tmp_path / "out", UNFINISHED_TOO)
    assert list(tmp_path.iterdir()) == []
