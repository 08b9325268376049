"""The paradigms of navigation to copy: their worlds keep count as their sources say, and their studies run."""

import math
from importlib import import_module
from pathlib import Path

import gymnasium
import pytest

import minihuman
from minihuman.reporting.study_measures import AngleConcentration, AngleMean, InfoAtEnd

FOLDER = Path(__file__).parents[3] / "protocols" / "navigation"


@pytest.fixture(autouse=True, scope="module")
def worlds():
    """Register the worlds from the folder of the protocols."""
    with pytest.MonkeyPatch.context() as patched:
        patched.syspath_prepend(FOLDER)
        for name in ("water_maze", "radial_arm_maze", "plus_maze", "triangle_completion", "pointing_task"):
            import_module(name)
        yield


def _follow(env, *, seed=1):
    """Follow the shortest path to the end; return the places after each step and the last info."""
    env.reset(seed=seed)
    poses = []
    while True:
        *_, terminated, truncated, info = env.step(env.unwrapped.shortest_path()[0])
        poses.append(env.unwrapped.pose())
        if terminated or truncated:
            return poses, info


def test_the_water_maze_measures_a_swim_as_its_path_says():
    env = gymnasium.make("WaterMaze-v0", start="south")
    poses, info = _follow(env)
    platform = env.unwrapped.platform.pos
    distances = [math.hypot(pose.x - platform[0], pose.z - platform[2]) for pose in poses]
    assert distances[-1] < 1.0 < distances[-3]
    assert info["proximity_m"] == pytest.approx(sum(distances) / len(distances))
    assert info["quadrant_share"] == sum(pose.x > 0 > pose.z for pose in poses) / len(poses)
    assert info["search_error"] > 0


def test_a_probe_has_no_platform_and_lasts_to_its_limit():
    poses, info = _follow(gymnasium.make("WaterMaze-v0", probe=True, max_steps=90))
    assert len(poses) == 90
    assert 0 < info["quadrant_share"] < 1


def test_the_radial_maze_tells_an_arm_without_food_from_one_that_was_visited():
    env = gymnasium.make("RadialArmMaze-v0", baited=(0, 1))
    env.reset(seed=1)
    world = env.unwrapped
    rewards = []
    for arm in (4, 0, 4, 0, 1):
        world.agent.pos = (0.0, 0.0, 0.0)
        env.step(0)
        world.agent.pos = world.ends[arm].pos
        _, reward, terminated, *_ = env.step(0)
        rewards.append(reward)
    assert rewards == [0, 1, 0, 0, 1]
    assert terminated
    assert world.info() == {"working_errors": 2, "reference_errors": 1}


@pytest.mark.nightly(by_day=["water-maze-quadrant_share"])
@pytest.mark.program
@pytest.mark.parametrize(
    ("name", "key"),
    [("water-maze", "quadrant_share"), ("radial-arm-maze", "working_errors"), ("plus-maze", "chose_place")],
)
def test_a_study_of_it_runs_is_proved_and_has_its_measure(name, key, tmp_path):
    (log,) = minihuman.simulate(FOLDER / f"{name}.toml", participants=1, data=tmp_path, trust=True)
    assert [check.text for check in minihuman.verify(log)][-1].endswith("all as logged")
    episodes = minihuman.open_study(tmp_path / name).query("select * from episodes")
    values = InfoAtEnd(key).compute({"episodes": episodes})
    assert len(values) == len(episodes)
    assert values["value"].between(0, 20).all()


@pytest.mark.program
@pytest.mark.parametrize(
    ("name", "key"), [("triangle-completion", "heading_error_deg"), ("pointing-task", "pointing_error_deg")]
)
def test_a_study_of_angles_is_proved_and_has_their_mean_direction_and_concentration(name, key, tmp_path):
    (log,) = minihuman.simulate(FOLDER / f"{name}.toml", participants=1, data=tmp_path, trust=True)
    assert [check.text for check in minihuman.verify(log)][-1].endswith("all as logged")
    tables = {"episodes": minihuman.open_study(tmp_path / name).query("select * from episodes")}
    errors_deg = InfoAtEnd(key).compute(tables)["value"]
    assert len(errors_deg) > 1
    assert errors_deg.between(-180, 180).all()
    cosines = [math.cos(math.radians(error)) for error in errors_deg]
    sines = [math.sin(math.radians(error)) for error in errors_deg]
    (mean_deg,) = AngleMean(key).compute(tables)["value"]
    (concentration,) = AngleConcentration(key).compute(tables)["value"]
    assert mean_deg == pytest.approx(math.degrees(math.atan2(sum(sines), sum(cosines))))
    assert concentration == pytest.approx(math.hypot(sum(cosines), sum(sines)) / len(errors_deg))
