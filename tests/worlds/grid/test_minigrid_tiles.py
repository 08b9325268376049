"""The palette ``minigrid`` gives Minigrid's pictures, to the pixel."""

import gymnasium
import minigrid  # noqa: F401  # registers the worlds we compare with
import numpy as np
import pytest
from minigrid.wrappers import RGBImgObsWrapper, RGBImgPartialObsWrapper

import minihuman  # noqa: F401
from minihuman.worlds.grid.env import GridWorld
from minihuman.worlds.grid.object_kinds import ObjectKind
from minihuman.worlds.grid.wrappers import PictureObservation
from tests.counts import count

# every kind of thing lies in one of these: doors, keys, boxes and balls to carry, lava, coloured floors and goals
NAMES = ("Playground-v0", "DoorKey-8x8-v0", "LavaCrossingS9N2-v0", "ObstructedMaze-1Dlhb-v0", "FourRooms-v0")
STEPS = count(40, 400)


def walk(env, seed):
    """Actions that also pick up, drop and open."""
    draw = np.random.default_rng(seed)
    return draw.choice(7, STEPS, p=(0.15, 0.15, 0.35, 0.12, 0.08, 0.12, 0.03))


@pytest.mark.parametrize("name", NAMES)
def test_every_picture_of_a_walk_is_minigrids(name):
    ours = gymnasium.make(f"minihuman/MiniGrid-{name}", render_mode="rgb_array", tile_size=9, palette="minigrid")
    theirs = gymnasium.make(f"MiniGrid-{name}", render_mode="rgb_array", tile_size=9)
    near = gymnasium.make(f"minihuman/MiniGrid-{name}", render_mode="rgb_array", agent_pov=True, palette="minigrid")
    near_theirs = gymnasium.make(f"MiniGrid-{name}", render_mode="rgb_array", agent_pov=True)
    worlds = ours, theirs, near, near_theirs
    for seed, action in enumerate(walk(ours, 3)):
        if seed % 40 == 0:
            for env in worlds:
                env.reset(seed=seed)
            np.testing.assert_array_equal(ours.render(), theirs.render())
        ends = [env.step(int(action))[2:4] for env in worlds]
        np.testing.assert_array_equal(ours.render(), theirs.render())
        np.testing.assert_array_equal(near.render(), near_theirs.render())
        if any(any(end) for end in ends):
            for env in worlds:
                env.reset(seed=100 + seed)


@pytest.mark.parametrize("tile_px", [1, 2, 3, 7, 8, 16, 32, 33])
def test_tiles_of_every_size_are_minigrids(tile_px):
    ours = gymnasium.make("minihuman/MiniGrid-Playground-v0")
    theirs = gymnasium.make("MiniGrid-Playground-v0")
    for seed in range(count(2, 20)):
        ours.reset(seed=seed)
        theirs.reset(seed=seed)
        for view, wrapper in (("full", RGBImgObsWrapper), ("partial", RGBImgPartialObsWrapper)):
            drawn = PictureObservation(ours, view=view, tile_px=tile_px, palette="minigrid").image({})
            expected = wrapper(theirs, tile_size=tile_px).observation({"image": 0, "mission": ""})["image"]
            np.testing.assert_array_equal(drawn, expected)


@pytest.mark.parametrize("direction", range(4))
@pytest.mark.parametrize("highlight", [True, False])
def test_the_agent_is_drawn_in_its_tile(direction, highlight):
    options = {"render_mode": "rgb_array", "agent_start_dir": direction, "agent_start_pos": (2, 2)}
    ours = gymnasium.make("minihuman/MiniGrid-Empty-5x5-v0", palette="minigrid", highlight=highlight, **options)
    theirs = gymnasium.make("MiniGrid-Empty-5x5-v0", highlight=highlight, **options)
    ours.reset(seed=0)
    theirs.reset(seed=0)
    np.testing.assert_array_equal(ours.render(), theirs.render())


def test_participants_of_a_world_in_this_palette_see_it_too():
    plain, env = (gymnasium.make("minihuman/MiniGrid-FourRooms-v0", **given) for given in ({}, {"palette": "minigrid"}))
    plain.reset(seed=1)
    env.reset(seed=1)
    drawn = PictureObservation(plain, tile_px=20, palette="minigrid").image({})
    np.testing.assert_array_equal(env.unwrapped.picture(size_px=(140, 140), palette="colour-safe"), drawn)


class Lamp(GridWorld):
    kinds = (
        ObjectKind("lamp", "M", draw=lambda canvas, colour, state: canvas.fill(canvas.disc(0.5, 0.5, 0.3), colour)),
    )

    def __init__(self, **options):
        super().__init__(width=5, height=5, max_steps=10, mission="look", palette="minigrid", **options)

    def layout(self, grid):
        grid.wall_rect()
        grid.put_agent(1, 2)
        grid.put(self.kinds[0]("blue"), 3, 2)


def test_a_kind_of_ones_own_is_drawn_on_minigrids_floor():
    env = Lamp(render_mode="rgb_array", tile_size=16, highlight=False)
    env.reset(seed=0)
    lamp = env.render()[32:48, 48:64]
    assert tuple(lamp[8, 8]) == (0, 0, 255)
    assert tuple(lamp[14, 14]) == (0, 0, 0)
