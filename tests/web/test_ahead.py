"""The look-out: every scene that keys can lead to is known before they are pressed, and is what the world shows."""

import random

import numpy as np
import pytest

from minihuman.experiment.machine.events import EpisodeEnded, Stepped
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.log.record.recorder import MemoryRecorder
from minihuman.web.computed import PageWorld
from minihuman.web.outbox import PageSettings
from minihuman.web.prefetch import LookAheadGraph
from minihuman.web.screen_values import ImageCache
from minihuman.web.session_host import SessionHost
from minihuman.worlds.adapters.world import World
from tests.web.page_model import PageModel
from tests.web.protocols import FIRST_PERSON, GRID, study

PX = (160, 120)
MS = 1_000_000
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
    chance = random.Random(3)
    for _ in range(25):
        while look_ahead_graph.grow():
            pass
        action = chance.choice(actions)
        known, _ = look_ahead_graph.root.edges[action]
        transition = actual.step(action)
        if transition.terminated or transition.truncated:
            break
        assert look_ahead_graph.step(action, actual) is known
        assert known.hash == actual.scene_hash()
        assert known.picture == album.number(actual.frame(plan.view, PX, plan.palette))
    assert look_ahead_graph.wrong == 0


def test_turning_left_and_right_again_is_one_scene_and_is_simulated_once(tmp_path) -> None:
    plan = first_episode(tmp_path, GRID)
    look_ahead_graph = LookAheadGraph(plan, World, [0, 1, 2], PX, ImageCache())
    actual = World(plan.world, plan.options)
    actual.reset(plan.seed)
    first = look_ahead_graph.root
    for action in (0, 1):
        while look_ahead_graph.grow():
            pass
        actual.step(action)
        look_ahead_graph.step(action, actual)
    assert look_ahead_graph.root is first
    assert not look_ahead_graph.grow()


ARCADE = "tests.worlds.paddle:tests/Arcade-v0", ("noop", "left", "right")


def test_a_world_that_cannot_be_copied_plays_without_look_ahead(tmp_path) -> None:
    plan = first_episode(tmp_path, ARCADE)
    look_ahead_graph = LookAheadGraph(plan, World, [0, 1, 2], PX, ImageCache())
    actual = World(plan.world, plan.options)
    actual.reset(plan.seed)
    assert not look_ahead_graph.grow()
    for action in (1, 2, 0):
        actual.step(action)
        assert look_ahead_graph.step(action, actual).hash == actual.scene_hash()
        update = look_ahead_graph.take_new()
        assert update is not None
        assert update.edges == []


def test_a_session_in_a_world_that_cannot_be_copied_is_played_to_its_end(tmp_path) -> None:
    protocol = decode_protocol(study(tmp_path, ARCADE, episodes=1, max_steps=6).read_bytes())
    plan, recorder = expand_protocol(protocol, enrol_participant(protocol, 0)), MemoryRecorder()
    session = SessionMachine(plan, PageWorld, {"window": "web"}, picture_px=PX, renders_steps=False)
    host = SessionHost(session, recorder, PageWorld, PageSettings(picture_px=PX))
    host.restart(computes=True)
    keys = ["enter", *"123123", "enter", "enter", "enter"]
    page = PageModel(host, [((300 + 200 * k) * MS, key, True) for k, key in enumerate(keys)], frame_ns=16 * MS)
    page.run()
    assert sum(isinstance(event, Stepped) for event in recorder.events) == 6
    assert [event.outcome for event in recorder.events if isinstance(event, EpisodeEnded)] == ["ended"]
    assert host.session.failure is None
    host.close()


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
