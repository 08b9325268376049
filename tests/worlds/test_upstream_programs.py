"""Programs written for Minigrid do with our worlds what they do with Minigrid's, by the id alone."""

import runpy
import subprocess
import sys
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import gymnasium
import numpy as np
import pygame
import pytest
from minigrid.wrappers import ImgObsWrapper, RGBImgPartialObsWrapper

import minihuman  # noqa: F401  # registers the worlds
from tests.machine import needs

pytestmark = [
    pytest.mark.program,
    pytest.mark.filterwarnings("ignore:.*out of date"),
    pytest.mark.filterwarnings("ignore:.*module 'minigrid"),  # Gymnasium's, of a module's environments registered twice
]

OURS = "minihuman/"
EMPTY = "MiniGrid-Empty-5x5-v0"
DOOR_KEY = "MiniGrid-DoorKey-5x5-v0"
ROUTE = (
    *(pygame.K_UP, pygame.K_UP, pygame.K_RIGHT, pygame.K_UP, pygame.K_UP),
    *(pygame.K_LEFT, pygame.K_PAGEUP, pygame.K_SPACE, pygame.K_PAGEDOWN, pygame.K_BACKSPACE, pygame.K_TAB, pygame.K_UP),
)


@pytest.fixture
def one_thread() -> Iterator[None]:
    import torch

    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@pytest.mark.filterwarnings("ignore:The system font")  # pygame's, of one that Minigrid asks for
@pytest.mark.parametrize("options", [(), ("--agent-view",)], ids=["whole grid", "agent's view"])
def test_minigrids_own_manual_control_plays_our_world(
    options: tuple[str, ...], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def play(world: str) -> str:
        events = [[SimpleNamespace(type=pygame.KEYDOWN, key=key)] for key in ROUTE]
        monkeypatch.setattr(pygame.event, "get", lambda *_, **__: events.pop(0) if events else _close_program())
        monkeypatch.setattr("sys.argv", ["manual_control", "--env-id", world, "--seed", "3", *options])
        with pytest.raises(SystemExit):
            runpy.run_module("minigrid.manual_control", run_name="__main__")
        return capsys.readouterr().out

    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    printed = play(EMPTY)
    assert "step=5, reward=0.95\nterminated!" in printed
    assert play(OURS + EMPTY) == printed


def _close_program() -> Any:
    raise SystemExit


def make_transformers_world(world: str) -> gymnasium.Env[Any, Any]:
    """Make a world as CleanRL's ppo_trxl does with ids that have MiniGrid in them."""
    env = gymnasium.make(world, agent_view_size=3, tile_size=28)
    env = ImgObsWrapper(RGBImgPartialObsWrapper(env, tile_size=28))
    return gymnasium.wrappers.RecordEpisodeStatistics(gymnasium.wrappers.TimeLimit(env, 96))


@pytest.mark.parametrize("world", ["MiniGrid-MemoryS9-v0", DOOR_KEY])
def test_a_transformer_of_cleanrl_sees_the_same_in_our_world(world: str) -> None:
    theirs, ours = make_transformers_world(world), make_transformers_world(OURS + world)
    assert (ours.observation_space, ours.action_space) == (theirs.observation_space, theirs.action_space)
    assert ours.spec is not None
    assert theirs.spec is not None
    assert ours.spec.max_episode_steps == theirs.spec.max_episode_steps
    rng = np.random.default_rng(1)
    for seed in range(2):
        assert np.array_equal(theirs.reset(seed=seed)[0], ours.reset(seed=seed)[0])
        for action in rng.integers(7, size=100):
            step, our_step = theirs.step(action), ours.step(action)
            assert np.array_equal(step[0], our_step[0])
            assert step[1:4] == our_step[1:4]
            if step[2] or step[3]:
                assert our_step[4]["episode"]["r"] == step[4]["episode"]["r"]
                break


def test_cleanrls_render_mode_makes_a_world_of_ours() -> None:
    with pytest.warns(UserWarning, match="not in the possible render_modes"):  # Gymnasium's, of Minigrid's worlds, too
        gymnasium.make(OURS + EMPTY, render_mode="debug_rgb_array").reset(seed=1)


@needs("learn")
@pytest.mark.nightly
@pytest.mark.usefixtures("one_thread")
def test_minigrids_tutorial_of_stable_baselines_ends_in_the_same_weights() -> None:
    import torch
    from stable_baselines3 import PPO
    from stable_baselines3.common.torch_layers import BaseFeaturesExtractor

    class Features(BaseFeaturesExtractor):
        """Convolutions of 2 x 2, as a picture of 7 x 7 allows."""

        def __init__(self, observation_space: gymnasium.Space[Any], features_dim: int = 512) -> None:
            super().__init__(observation_space, features_dim)
            channels = observation_space.shape[0]  # type: ignore[index]
            convolutions = [torch.nn.Conv2d(channels, 16, 2), torch.nn.Conv2d(16, 32, 2), torch.nn.Conv2d(32, 64, 2)]
            layers = [layer for convolution in convolutions for layer in (convolution, torch.nn.ReLU())]
            self.convolutions = torch.nn.Sequential(*layers, torch.nn.Flatten())
            with torch.no_grad():
                size = self.convolutions(torch.as_tensor(observation_space.sample()[None]).float()).shape[1]
            self.linear = torch.nn.Sequential(torch.nn.Linear(size, features_dim), torch.nn.ReLU())

        def forward(self, observations: Any) -> Any:
            """Compute the features."""
            return self.linear(self.convolutions(observations))

    def train(world: str) -> list[Any]:
        env = ImgObsWrapper(gymnasium.make(world, render_mode="rgb_array"))
        settings = {"features_extractor_class": Features, "features_extractor_kwargs": {"features_dim": 128}}
        model = PPO("CnnPolicy", env, policy_kwargs=settings, n_steps=128, n_epochs=2, seed=1, device="cpu")
        model.learn(256)
        return [weights.clone() for weights in model.policy.parameters()]

    require_equal_weights(train, "MiniGrid-Empty-16x16-v0")


@needs("torch-ac")
@pytest.mark.nightly
def test_torch_ac_as_rl_starter_files_use_it_learns_the_same() -> None:
    trainings = [
        subprocess.run(
            [sys.executable, "-m", "tests.worlds.torch_ac_training", world],
            capture_output=True,
            text=True,
            timeout=300,
            check=True,
        ).stdout
        for world in (DOOR_KEY, OURS + DOOR_KEY)
    ]
    assert "frames 128" in trainings[0]
    assert trainings[0] == trainings[1]


def require_equal_weights(train: Callable[[str], list[Any]], world: str) -> None:
    theirs, ours = train(world), train(OURS + world)
    assert len(ours) == len(theirs) > 0
    for weights, our_weights in zip(theirs, ours, strict=True):
        assert weights.equal(our_weights)
