"""The look-out: every scene that keys can lead to is known before they are pressed, and is what the world shows."""

import random

import numpy as np
import pytest

from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.web.image_cache import ImageCache
from minihuman.web.look_ahead import LookAheadGraph, compute_depth
from minihuman.worlds.adapters.world import World
from tests.web.protocols import FIRST_PERSON, GRID, study

PX = (160, 120)
RANDOM = "minihuman/MiniGrid-Dynamic-Obstacles-6x6-v0", ("left", "right", "forward")
FOREIGN = "minigrid:MiniGrid-FourRooms-v0", ("left", "right", "forward")


def first_episode(folder, world, max_steps=40):
    protocol = decode_protocol(study(folder, world, max_steps=max_steps).read_bytes())
    return expand_protocol(protocol, enrol_participant(protocol, 0)).episodes[0]


@pytest.mark.parametrize("world", [GRID, FIRST_PERSON, RANDOM, FOREIGN], ids=["grid", "3d", "random", "foreign"])
def test_wherever_keys_lead_the_scene_was_known_and_its_picture_is_the_worlds(tmp_path, world) -> None:
    plan = first_episode(tmp_path, world)
    actual = World(plan.world, plan.options)
    actual.reset(plan.seed)
    actions = [actual.action_names.index(name) for name in plan.actions]
    album = ImageCache("lossless")
    look_ahead_graph = LookAheadGraph(plan, World, actions, PX, album)
    look_ahead_graph.depth = 2
    chance = random.Random(3)
    for _ in range(25):
        while look_ahead_graph.grow():
            pass
        action = chance.choice(actions)
        known = look_ahead_graph.leads_to(action)
        assert known is not None
        transition = actual.step(action)
        if transition.terminated or transition.truncated:
            break
        assert look_ahead_graph.step(action, actual) is known
        assert known.hash == actual.scene_hash()
        assert known.picture == album.number(actual.frame(plan.view, PX, plan.palette))
    assert look_ahead_graph.wrong == 0


def test_turning_left_and_right_again_is_one_scene(tmp_path) -> None:
    plan = first_episode(tmp_path, GRID)
    look_ahead_graph = LookAheadGraph(plan, World, [0, 1, 2], PX, ImageCache())
    look_ahead_graph.depth = 3
    while look_ahead_graph.grow():
        pass
    assert len(look_ahead_graph.scenes) < 1 + 3 + 9 + 27
    left = look_ahead_graph.scenes[look_ahead_graph.root.edges[0].scene]
    assert left.edges[1].scene == look_ahead_graph.root.number


def test_the_last_keys_branch_is_looked_at_first(tmp_path) -> None:
    plan = first_episode(tmp_path, GRID)
    look_ahead_graph = LookAheadGraph(plan, World, [0, 1, 2], PX, ImageCache())
    actual = World(plan.world, plan.options)
    actual.reset(plan.seed)
    actual.step(1)
    look_ahead_graph.step(1, actual)
    look_ahead_graph.depth = 3
    look_ahead_graph.grow()
    assert list(look_ahead_graph.root.edges) == [1]


def test_where_the_session_went_elsewhere_the_look_out_goes_there_and_counts_it(tmp_path) -> None:
    plan = first_episode(tmp_path, GRID)
    look_ahead_graph = LookAheadGraph(plan, World, [0, 1, 2], PX, ImageCache())
    actual = World(plan.world, plan.options)
    actual.reset(plan.seed)
    while look_ahead_graph.grow():
        pass
    actual.step(0)
    scene = look_ahead_graph.step(1, actual)  # it says right where the session turned left
    assert (look_ahead_graph.wrong, scene.hash) == (1, actual.scene_hash())


def test_a_picture_is_packed_once(tmp_path) -> None:
    album = ImageCache()
    one, two = np.zeros((6, 8, 3), np.uint8), np.full((6, 8, 3), 7, np.uint8)
    assert [album.number(one), album.number(two), album.number(one.copy())] == [0, 1, 0]
    assert len(album.take_new()) == 2
    album.number(two)
    assert album.take_new() == []


@pytest.mark.parametrize(
    ("rtt_ms", "keys_hz", "depth"), [(0, 2, 1), (3, 4, 1), (150, 2, 2), (300, 6, 3), (300, 2, 2), (2000, 8, 6)]
)
def test_a_longer_line_and_quicker_keys_ask_for_more_steps(rtt_ms, keys_hz, depth) -> None:
    assert compute_depth(rtt_ms * 1_000_000, keys_hz) == depth
