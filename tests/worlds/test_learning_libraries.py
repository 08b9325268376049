"""Libraries that know no text: a grid told in numbers alone, and learners of other projects on worlds of ours."""

import gymnasium
import pytest

import minihuman  # noqa: F401  # registers the worlds
from minihuman.worlds.grid.wrappers import Tokens
from tests.machine import needs
from tests.worlds.test_gymnasium import GRID, ROOMS

pytestmark = pytest.mark.filterwarnings("ignore:.*out of date")  # v0 of worlds that have a v1


@pytest.fixture
def one_thread():
    """Networks as small as these are slower on several threads, which wait for each other."""
    import torch

    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@needs("learn")
@pytest.mark.program
def test_stable_baselines_learns_on_a_grid_by_its_id(one_thread):
    from stable_baselines3 import PPO
    from stable_baselines3.common.env_util import make_vec_env
    from stable_baselines3.common.evaluation import evaluate_policy

    envs = make_vec_env("minihuman/MiniGrid-Empty-5x5-v0", n_envs=8, wrapper_class=Tokens, seed=0)
    settings = {"n_steps": 128, "batch_size": 256, "n_epochs": 6, "learning_rate": 1e-3}
    agent = PPO("MultiInputPolicy", envs, seed=0, device="cpu", **settings)
    before, _ = evaluate_policy(agent, envs, 20, deterministic=False)
    agent.learn(8192)
    after, _ = evaluate_policy(agent, envs, 20, deterministic=False)
    assert before < 0.5
    assert after > 0.8  # 0.955 is the most there is
    envs.close()


@needs("learn")
@pytest.mark.program
@pytest.mark.filterwarnings("ignore:It seems that your observation space image")  # numbers of cells, no pixels
@pytest.mark.filterwarnings("ignore:The minimal resolution for an image")
def test_stable_baselines_plays_a_grid_with_missions(one_thread):
    from stable_baselines3 import PPO
    from stable_baselines3.common.env_checker import check_env as check_env_of_theirs

    env = Tokens(gymnasium.make(GRID))
    check_env_of_theirs(env)
    assert PPO("MultiInputPolicy", env, n_steps=32, batch_size=32, device="cpu").learn(32).num_timesteps == 32


@needs("learn")
@pytest.mark.program
def test_stable_baselines_learns_on_rooms_as_they_come(one_thread):
    from stable_baselines3 import PPO

    agent = PPO("CnnPolicy", ROOMS, n_steps=32, batch_size=32, n_epochs=1, seed=0, device="cpu")
    agent.learn(32)
    assert agent.num_timesteps == 32
