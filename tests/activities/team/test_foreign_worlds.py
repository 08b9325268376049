"""One of PettingZoo's environments as a world of teams: stepped as it is by itself, played, proven and reported."""

from pathlib import Path

import numpy as np
import pytest
from gymnasium import spaces

import minihuman
from minihuman.admin.protocol_file import read_protocol
from minihuman.errors import WorldError
from minihuman.log.read.session_reader import read_log
from minihuman.runtime.simulated_session import simulate
from minihuman.worlds.team import TeamWorld

pytestmark = pytest.mark.program

PONG = Path(__file__).parents[3] / "docs" / "pong" / "pong.toml"
ID = "pong_world:Lab/CooperativePong-v0"
pytest.importorskip("pettingzoo.butterfly", reason="pip install pettingzoo, as the test extra does")


def pong_study(folder: Path, *, in_turns: bool = False) -> Path:
    """The shipped protocol and its world, shorter, in a folder of its own."""
    text = PONG.read_text(encoding="utf-8").replace("max_steps = 300", "max_steps = 25")
    ticks = 'pace = "real_time"\nstep_period_ms = 160\n'
    assert ticks in text
    text = text.replace(ticks, "" if in_turns else ticks)
    (folder / "pong_world.py").write_bytes(PONG.with_name("pong_world.py").read_bytes())
    path = folder / "pong.toml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture(scope="module", autouse=True)
def trusted() -> None:
    """The shipped world, which any later protocol names again."""
    read_protocol(PONG, trust=True)
    minihuman.make_team(ID)


def test_it_steps_as_it_does_by_itself() -> None:
    from pettingzoo.butterfly.cooperative_pong import cooperative_pong

    world = minihuman.make_team(ID, max_cycles=60)
    itself = cooperative_pong.parallel_env(render_mode="rgb_array", max_cycles=60)
    draw = np.random.default_rng(1)
    for seed in range(3):
        world.reset(seed)
        observed, _ = itself.reset(seed=seed)
        hashes = {world.state_hash()}
        while itself.agents:
            for body, agent in enumerate(itself.possible_agents):
                assert np.array_equal(world.observation(body), observed[agent])
            assert np.array_equal(world.frame(0, 640, 480), itself.render())
            joint = draw.integers(3, size=2).tolist()
            observed, rewards, terminated, _, _ = itself.step(dict(zip(itself.agents, joint, strict=True)))
            step = world.step(joint)
            hashes.add(world.state_hash())
            assert step.rewards == tuple(rewards.values())
        assert (step.terminated, step.truncated) == (any(terminated.values()), not any(terminated.values()))
        assert len(hashes) > 20
        with pytest.raises(WorldError, match="no episode runs; call reset first"):
            world.step([0, 0])


@pytest.mark.nightly
@pytest.mark.parametrize("in_turns", [False, True])
def test_a_study_in_it_is_proven_and_reported(tmp_path: Path, in_turns: bool) -> None:
    protocol = read_protocol(pong_study(tmp_path, in_turns=in_turns), trust=True)
    logs = list(simulate(protocol, tmp_path, participants=4, seed=3, player="random"))
    lines = list(minihuman.verify(tmp_path))
    assert lines
    assert all(line.ok for line in lines), [line.text for line in lines]
    for log in logs:
        for episode in read_log(log).episodes:
            assert len(episode.actions) == len(episode.team.actions) > 0
            assert np.isnan(episode.poses).all()  # nobody knows where they are
            assert np.isnan(episode.team.poses).all()
            assert episode.start.map is None
    minihuman.report(tmp_path / "pong", tmp_path / "report")
    assert ">nan<" not in (tmp_path / "report" / "report.html").read_text(encoding="utf-8").lower()


def test_steps_that_another_world_would_make_are_not_believed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    protocol = read_protocol(pong_study(tmp_path), trust=True)
    list(simulate(protocol, tmp_path, participants=2, seed=3, player="random"))
    made: type[TeamWorld] = type(minihuman.make_team(ID))
    step = made.step
    monkeypatch.setattr(made, "step", lambda world, actions: step(world, [0 for _ in actions]))
    assert not all(line.ok for line in minihuman.verify(tmp_path))


class Unequal:
    """Whose second agent can do more."""

    possible_agents = ("first", "second")

    def __init__(self, render_mode: str) -> None:
        self.render_mode = render_mode

    def action_space(self, agent: str) -> spaces.Space:
        return spaces.Discrete(2 if agent == "first" else 3)

    def observation_space(self, agent: str) -> spaces.Space:
        return spaces.Box(0, 1, (2,))


def test_agents_that_differ_are_refused() -> None:
    made = type(minihuman.make_team(ID)).__mro__[1]
    with pytest.raises(WorldError, match="needs one Discrete action space and one Box observation space"):
        made(Unequal)


def test_a_world_of_one_body_is_named_as_such() -> None:
    with pytest.raises(WorldError, match="pong_world:CartPole-v1 is not a team world"):
        minihuman.make_team("pong_world:CartPole-v1")


def test_it_is_not_copied_in_the_middle_of_an_episode() -> None:
    with pytest.raises(WorldError, match="cannot be copied in the middle of an episode"):
        minihuman.make_team(ID).save()
