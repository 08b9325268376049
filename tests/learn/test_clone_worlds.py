"""Clones of what people did in worlds that step by themselves, and in worlds that only a limit ends."""

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
        ("tests.worlds.endless:Endless-v0", ["left", "right"], "", 20, ("left", "stay", "right")),
        ("tests.worlds.endless:Unlimited-v0", ["left", "right"], "", 15, ("left", "stay", "right")),
    ],
)
def test_a_clone_comes_to_its_end(tmp_path, world, actions, more, max_steps, classes):
    toml = PROTOCOL.format(world=world, actions=actions, more=more, max_steps=max_steps).replace("'", '"')
    study = recorded(tmp_path, participants=3, player="random", toml=toml.encode())
    how = CloneStudy(world, evaluation_episodes=3, selection=Selection(), cloning=CloningSettings(most_epochs=2))
    card = clone_study(study, tmp_path / "clone.pt", how, command="test")
    assert "| chance |" in card
    assert f"Actions: {', '.join(classes)}." in card
