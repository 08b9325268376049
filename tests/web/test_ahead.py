"""The look-out: every scene that keys can lead to is known before they are pressed, and is what the world shows."""

import random

import numpy as np
import pytest

from minihuman.study.expand import enrol, expand
from minihuman.study.protocol import decode
from minihuman.web.ahead import Lookout, depth_for
from minihuman.web.album import Album
from minihuman.worlds.adapt.world import World
from tests.web.protocols import FIRST_PERSON, GRID, study

PX = (160, 120)
RANDOM = "minihuman/MiniGrid-Dynamic-Obstacles-6x6-v0", ("left", "right", "forward")
FOREIGN = "minigrid:MiniGrid-FourRooms-v0", ("left", "right", "forward")


def first_episode(folder, world, max_steps=40):
    protocol = decode(study(folder, world, max_steps=max_steps).read_bytes())
    return expand(protocol, enrol(protocol, 0)).episodes[0]


@pytest.mark.parametrize("world", [GRID, FIRST_PERSON, RANDOM, FOREIGN], ids=["grid", "3d", "random", "foreign"])
def test_wherever_keys_lead_the_scene_was_known_and_its_picture_is_the_worlds(tmp_path, world) -> None:
    plan = first_episode(tmp_path, world)
    actual = World(plan.world, plan.options)
    actual.reset(plan.seed)
    actions = [actual.action_names.index(name) for name in plan.actions]
    album = Album("lossless")
    lookout = Lookout(plan, World, actions, PX, album)
    lookout.depth = 2
    chance = random.Random(3)
    for _ in range(25):
        while lookout.grow():
            pass
        action = chance.choice(actions)
        known = lookout.leads_to(action)
        assert known is not None
        transition = actual.step(action)
        if transition.terminated or transition.truncated:
            break
        assert lookout.step(action, actual) is known
        assert known.hash == actual.scene_hash()
        assert known.picture == album.number(actual.frame(plan.view, PX, plan.palette))
    assert lookout.wrong == 0


def test_turning_left_and_right_again_is_one_scene(tmp_path) -> None:
    plan = first_episode(tmp_path, GRID)
    lookout = Lookout(plan, World, [0, 1, 2], PX, Album())
    lookout.depth = 3
    while lookout.grow():
        pass
    assert len(lookout.scenes) < 1 + 3 + 9 + 27
    left = lookout.scenes[lookout.root.edges[0].scene]
    assert left.edges[1].scene == lookout.root.number


def test_the_last_keys_branch_is_looked_at_first(tmp_path) -> None:
    plan = first_episode(tmp_path, GRID)
    lookout = Lookout(plan, World, [0, 1, 2], PX, Album())
    actual = World(plan.world, plan.options)
    actual.reset(plan.seed)
    actual.step(1)
    lookout.step(1, actual)
    lookout.depth = 3
    lookout.grow()
    assert list(lookout.root.edges) == [1]


def test_where_the_session_went_elsewhere_the_look_out_goes_there_and_counts_it(tmp_path) -> None:
    plan = first_episode(tmp_path, GRID)
    lookout = Lookout(plan, World, [0, 1, 2], PX, Album())
    actual = World(plan.world, plan.options)
    actual.reset(plan.seed)
    while lookout.grow():
        pass
    actual.step(0)
    scene = lookout.step(1, actual)  # it says right where the session turned left
    assert (lookout.wrong, scene.hash) == (1, actual.scene_hash())


def test_a_picture_is_packed_once(tmp_path) -> None:
    album = Album()
    one, two = np.zeros((6, 8, 3), np.uint8), np.full((6, 8, 3), 7, np.uint8)
    assert [album.number(one), album.number(two), album.number(one.copy())] == [0, 1, 0]
    assert len(album.take_new()) == 2
    album.number(two)
    assert album.take_new() == []


@pytest.mark.parametrize(
    ("rtt_ms", "keys_hz", "depth"), [(0, 2, 1), (3, 4, 1), (150, 2, 2), (300, 6, 3), (300, 2, 2), (2000, 8, 6)]
)
def test_a_longer_line_and_quicker_keys_ask_for_more_steps(rtt_ms, keys_hz, depth) -> None:
    assert depth_for(rtt_ms * 1_000_000, keys_hz) == depth
