import gymnasium
import pytest

import minihuman  # noqa: F401
from minihuman.worlds.grid.planner import plan


@pytest.mark.parametrize("seed", range(20))
def test_the_plan_reaches_the_goal_and_every_step_of_it_counts(seed):
    env = gymnasium.make("minihuman/MiniGrid-FourRooms-v0")
    env.reset(seed=seed)
    actions = plan(env.unwrapped.state)
    for left in range(len(actions), 0, -1):
        assert len(plan(env.unwrapped.state)) == left
        _, reward, terminated, _, _ = env.step(actions[-left])
    assert terminated
    assert reward == 1 - 0.9 * (len(actions) / 100)
