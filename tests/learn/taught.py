"""Small data sets of a simulated supervisor, as learners take them."""

import numpy as np

from minihuman.learn.agent.observe import Eyesight
from minihuman.learn.teach.dataset import Dataset
from minihuman.learn.teach.sitting import Sitting
from minihuman.players.supervisor import Supervising, Supervisor
from minihuman.worlds.adapt.world import World

DOOR_KEY = "minihuman/MiniGrid-DoorKey-5x5-v0"
EMPTY = "minihuman/MiniGrid-Empty-5x5-v0"


def sitting(world_id=DOOR_KEY, *, actions=6, most_steps=60, seed=1, eyesight=None):
    """A sitting in a world, and a data set without a lesson for it."""
    world = World(world_id)
    world.reset(0)
    eyesight = eyesight or Eyesight(missions=False)
    dataset = Dataset(world_id, {}, world.action_names[:actions], most_steps, eyesight, eyesight.space(world.unwrapped))
    return Sitting(world, eyesight, most_steps, np.random.default_rng(seed)), dataset


def taught(demonstrations=4, *, world_id=DOOR_KEY, policy=None, watched=0, seed=1, eyesight=None):
    """Demonstrations of the exploring expert, and episodes of a policy that it watched."""
    taking, dataset = sitting(world_id, seed=seed, eyesight=eyesight)
    supervisor = Supervisor(Supervising(), np.random.default_rng(seed))
    shown = [taking.watch(None, number, supervisor) for number in range(demonstrations)]
    shown += [taking.watch(policy, 100 + number, supervisor) for number in range(watched)]
    return dataset.with_more(shown)
