"""Going back to a saved state in mid-episode while a window shows the world."""

from contextlib import closing

import numpy as np
import pytest

from minihuman.experiment.machine.screens import PlayScreen
from minihuman.worlds.adapters.world import World
from tests.window_host import hosted

pytestmark = pytest.mark.program


@pytest.mark.parametrize(
    ("world_id", "actions"),
    [
        ("minihuman/MiniGrid-DoorKey-8x8-v0", (2, 1, 2, 3, 0, 2, 5, 2)),
        ("minihuman/MiniWorld-FourRooms-v0", (2, 2, 1, 2, 0, 2)),
    ],
)
def test_a_world_on_display_goes_back_in_mid_episode_and_plays_and_looks_the_same_again(display, world_id, actions):
    world = World(world_id)

    def play(window):
        """Each state on the way and its picture, which the window has shown."""
        way = []
        for action in actions:
            world.step(action)
            picture = world.frame(size_px=(320, 240))
            shown = window.show(PlayScreen(picture, "", "", ()))
            assert shown.submit_ns <= shown.flip_ns
            way.append((world.state_hash(), picture))
        return way

    with closing(world), hosted("pygame", display, size_px=(320, 240)) as window:
        world.reset(8)  # the goal is far from here in both
        play(window)
        saved, here = world.save(), world.state_hash()
        first = play(window)
        assert world.state_hash() != here
        world.restore(saved)
        assert world.state_hash() == here
        second = play(window)
    for (hash_before, picture_before), (hash_after, picture_after) in zip(first, second, strict=True):
        assert hash_before == hash_after
        assert np.array_equal(picture_before, picture_after)
