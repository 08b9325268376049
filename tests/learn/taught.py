"""Small data sets of a simulated supervisor, as learners take them."""

import numpy as np

from minihuman.learn.policy.observation import ObservationEncoder
from minihuman.learn.teaching.dataset import Dataset
from minihuman.simulation.supervisor import Supervisor, SupervisorParameters
from minihuman.worlds.adapters.world import World
from teaching_study.simulation import TeachingSimulation

DOOR_KEY = "minihuman/MiniGrid-DoorKey-5x5-v0"
EMPTY = "minihuman/MiniGrid-Empty-5x5-v0"


def sitting(world_id=DOOR_KEY, *, actions=6, most_steps=60, seed=1, eyesight=None):
    """A sitting in a world, and a data set without a lesson for it."""
    world = World(world_id)
    world.reset(0)
    eyesight = eyesight or ObservationEncoder(missions=False)
    dataset = Dataset(world_id, {}, world.action_names[:actions], most_steps, eyesight, eyesight.space(world.unwrapped))
    return TeachingSimulation(world, eyesight, most_steps, np.random.default_rng(seed)), dataset


def taught(demonstrations=4, *, world_id=DOOR_KEY, policy=None, watched=0, seed=1, eyesight=None):
    """Demonstrations of the exploring expert, and episodes of a policy that it watched."""
    taking, dataset = sitting(world_id, seed=seed, eyesight=eyesight)
    supervisor = Supervisor(SupervisorParameters(), np.random.default_rng(seed))
    shown = [taking.watch(None, number, supervisor) for number in range(demonstrations)]
    shown += [taking.watch(policy, 100 + number, supervisor) for number in range(watched)]
    return dataset.with_more(shown)
