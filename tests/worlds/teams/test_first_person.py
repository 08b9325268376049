"""Bodies in first person: they see each other, stop each other, and find the box for all."""

import math

import numpy as np

import minihuman

FORWARD, STAY = 2, 3


def rooms(bodies=2, **options):
    world = minihuman.make_team("minihuman/Team-FourRooms3D-v0", bodies=bodies, **options)
    world.reset(105)  # body 1 stands two metres before body 0
    return world


def test_each_sees_the_other_and_not_itself():
    world = rooms()
    yellow = (np.abs(world.frame(0, 160, 120).astype(int) - (170, 170, 0)) < 60).all(axis=2)
    assert yellow.sum() > 500
    blue = (np.abs(world.frame(0, 160, 120).astype(int) - (0, 0, 170)) < 60).all(axis=2)
    assert blue.sum() == 0
    before = world.state_hash()
    assert not np.array_equal(world.observation(0), world.observation(1))
    assert world.state_hash() == before  # looking changes nothing


def test_nobody_walks_through_another():
    world = rooms()
    for _ in range(20):
        done = world.step([FORWARD, STAY])
        one, other = world.pose(0), world.pose(1)
        assert math.hypot(one.x - other.x, one.z - other.z) >= 0.79
    assert (done.terminated, world.pose(1).x) == (False, rooms().pose(1).x)


def test_who_finds_the_box_finds_it_for_all():
    world = rooms(3)
    (box,) = world.map().things
    assert box.name == "red box"
    rng, done = np.random.default_rng(3), None
    while done is None or not done.terminated:
        done = world.step(rng.choice(3, 3, p=(0.15, 0.15, 0.7)).tolist())
        if done.truncated and not done.terminated:
            world.reset(int(rng.integers(1000)))
    assert done.rewards[0] > 0.7
    assert done.rewards == done.rewards[:1] * 3
    (box,) = world.map().things
    near = [math.hypot(world.pose(body).x - box.x, world.pose(body).z - box.z) for body in range(3)]
    assert min(near) < 1.2
