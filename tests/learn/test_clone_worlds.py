"""Clones of what people did in worlds that step by themselves, and in worlds that only a limit ends."""

from typing import Any, ClassVar

import gymnasium
import numpy as np
import pytest

from minihuman.dataset.selection import Selection
from minihuman.learn.behaviour_cloning import CloneStudy, CloningSettings, clone_study
from tests.export.study import recorded

pytestmark = pytest.mark.program

PROTOCOL = """
[study]
name = "clones"
version = "1"
seed = 3
[keys]
keyboard_check = false
[[groups]]
name = "all"
blocks = ["only"]
[[blocks]]
name = "only"
world = "{world}"
episodes = 2
actions = {actions}
max_steps = {max_steps}
{more}
"""


class Endless(gymnasium.Env[dict[str, Any], int]):
    """Ends by no rule of its own; actions are counted from 1."""

    metadata: ClassVar[dict[str, Any]] = {"render_modes": ["rgb_array"]}
    action_space = gymnasium.spaces.Discrete(3, start=1)
    observation_space = gymnasium.spaces.Dict({"image": gymnasium.spaces.Box(0, 255, (7, 7, 3), np.uint8)})
    action_names = ("left", "stay", "right")

    def __init__(self, render_mode: str | None = None) -> None:
        self.render_mode = render_mode

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        super().reset(seed=seed)
        self._place = int(self.np_random.integers(3))
        return self._seen(), {}

    def step(self, action: int) -> Any:
        assert self.action_space.contains(action)
        self._place = (self._place + int(action) - 2) % 7
        return self._seen(), float(self._place == 3), False, False, {}

    def render(self) -> Any:
        return np.full((64, 64, 3), 30 * self._place, np.uint8)

    def _seen(self) -> dict[str, Any]:
        image = np.zeros((7, 7, 3), np.uint8)
        image[self._place] = 1
        return {"image": image}


gymnasium.register("Endless-v0", Endless, max_episode_steps=20)
gymnasium.register("Unlimited-v0", Endless)


@pytest.mark.parametrize(
    ("world", "actions", "more", "max_steps", "classes"),
    [
        (
            "minihuman/MiniGrid-Empty-5x5-v0",
            ["left", "right", "forward"],
            'pace = "real_time"\nstep_period_ms = 400.0\nnoop_action = "done"',
            30,
            ("left", "right", "forward", "pickup", "drop", "toggle", "done"),
        ),
        ("tests.learn.test_clone_worlds:Endless-v0", ["left", "right"], "", 20, ("left", "stay", "right")),
        ("tests.learn.test_clone_worlds:Unlimited-v0", ["left", "right"], "", 15, ("left", "stay", "right")),
    ],
)
def test_a_clone_comes_to_its_end(tmp_path, world, actions, more, max_steps, classes):
    toml = PROTOCOL.format(world=world, actions=actions, more=more, max_steps=max_steps).replace("'", '"')
    study = recorded(tmp_path, participants=3, player="random", toml=toml.encode())
    how = CloneStudy(world, evaluation_episodes=3, selection=Selection(), cloning=CloningSettings(most_epochs=2))
    card = clone_study(study, tmp_path / "clone.pt", how, command="test")
    assert "| chance |" in card
    assert f"Actions: {', '.join(classes)}." in card
