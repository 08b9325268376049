"""The look of a display: nearer to the truth than the classic one, with joints and contact in shade."""

import math

import gymnasium
import numpy as np
import pytest

import minihuman  # noqa: F401  registers the worlds
from minihuman.errors import WorldError

LOOKS = "classic", "display"
FINE = 4  # times as many pixels each way


def seen(look, size_px=(320, 180), *, name="CollectHealth", yaw_rad=0.3, **options):
    world = gymnasium.make(f"minihuman/MiniWorld-{name}-v0", look=look, **options).unwrapped
    world.reset(seed=1)
    world.agent.dir = yaw_rad
    return world.picture(size_px=size_px).astype(np.float64)


def error(look, yaw_rad):
    """The difference of each channel from what sixteen times the samples show, float64[540, 960, 3]."""
    fine = seen(look, (FINE * 960, FINE * 540), yaw_rad=yaw_rad)
    return seen(look, (960, 540), yaw_rad=yaw_rad) - fine.reshape(540, FINE, 960, FINE, 3).mean(axis=(1, 3))


def test_a_display_shows_less_error_and_less_flicker_in_a_turn():
    errors = {look: [error(look, 0.3 + math.radians(0.3) * frame) for frame in range(3)] for look in LOOKS}
    off = {look: np.abs(each).mean() for look, each in errors.items()}
    flicker = {look: np.abs(np.diff(each, axis=0)).mean() for look, each in errors.items()}
    assert off["display"] < 0.6 * off["classic"]
    assert flicker["display"] < 0.6 * flicker["classic"]


def test_a_world_without_a_look_is_drawn_as_the_classic_one():
    world = gymnasium.make("minihuman/MiniWorld-CollectHealth-v0").unwrapped
    world.reset(seed=1)
    world.agent.dir = 0.3
    assert np.array_equal(world.picture(size_px=(320, 180)), seen("classic"))
    assert not np.array_equal(seen("display"), seen("classic"))


def corner_of_a_room(look, thing):
    """Into a corner of a room with a thing at a place (x, y, z), float64[480, 640], how bright."""
    world = gymnasium.make("minihuman/MiniWorld-OneRoom-v0", look=look).unwrapped
    world.reset(seed=1)
    world.agent.pos, world.agent.dir, world.entities[0].pos = (5.0, 0.0, 5.0), math.pi / 4, thing
    return world.picture(size_px=(640, 480)).astype(np.float64).mean(axis=2)


def test_a_wall_is_darker_at_its_corner_and_the_floor_around_a_thing():
    before, behind = (7.0, 0.0, 3.0), (1.0, 0.0, 9.0)
    display, classic = (
        [corner_of_a_room(look, thing) for thing in (before, behind)] for look in ("display", "classic")
    )
    part = display[1] / np.maximum(classic[1], 1.0)
    assert part[225:235, 316:324].mean() < 0.75 * part[225:235, 60:80].mean()  # a corner against the middle of a wall
    floor = (classic[0] == classic[1]) & (classic[1] > 0.0)
    around = display[0][floor] / np.maximum(display[1][floor], 1.0)
    assert (around > 1.02).sum() < 0.1 * (around < 0.98).sum()  # a run of pixels that begins elsewhere has other sizes
    assert (around < 0.85).sum() > 200


def test_an_edge_towards_the_viewer_is_not_shaded_like_a_corner():
    shown = {}
    for look in LOOKS:  # into YMaze's fork, where two arms meet in an edge, with slivers of wall beside it
        world = gymnasium.make("minihuman/MiniWorld-YMaze-v0", look=look).unwrapped
        world.reset(seed=9961)
        world.agent.pos, world.agent.dir = (-4.534, 0.0, 0.838), 0.2623
        shown[look] = world.picture(size_px=(800, 600)).astype(np.float64).mean(axis=2)
    part = shown["display"] / np.maximum(shown["classic"], 1.0)
    edge, wall = part[290:330, 476:496].mean(), part[290:330, 540:600].mean()
    assert edge > 0.9 * wall


def test_other_looks_are_refused():
    with pytest.raises(WorldError, match=r"look is 'photo'"):
        gymnasium.make("minihuman/MiniWorld-OneRoom-v0", look="photo")


def test_a_batch_and_a_copy_have_the_look():
    worlds = gymnasium.make_vec(
        "minihuman/MiniWorld-Hallway-v0", num_envs=2, vectorization_mode="vector_entry_point", look="display"
    )
    observed, _ = worlds.reset(seed=3)
    alone = gymnasium.make("minihuman/MiniWorld-Hallway-v0", look="display").unwrapped
    assert np.array_equal(observed[0], alone.reset(seed=3)[0])
    assert not np.array_equal(observed[0], gymnasium.make("minihuman/MiniWorld-Hallway-v0").reset(seed=3)[0])
