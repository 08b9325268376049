"""A small scene to draw in tests: two brick rooms with an opening between them, and things in both."""

import functools
import hashlib
import math
import os
import sys
from concurrent.futures import ThreadPoolExecutor

import gymnasium
import numpy as np

import minihuman  # noqa: F401  registers the worlds
from minihuman.worlds.first_person.render.asset_files import asset_library
from minihuman.worlds.first_person.render.drawing import RenderTarget, render, render_depth, render_top
from minihuman.worlds.first_person.render.render_pool import RenderPool
from minihuman.worlds.first_person.render.scene import (
    BoxLook,
    Camera,
    FrameLook,
    MeshLook,
    Opening,
    Scene,
    SceneRoom,
    Surface,
    build_scene,
)

HEIGHT = 2.5
library = functools.partial(asset_library, None)  # the worlds' own: textures take ten seconds each in plain Python
CAMERA = Camera((-1.5, 1.5, 0.3), 0.1)


def room(x0: float, x1: float, holes: dict[int, int], *, roofed: bool = True) -> SceneRoom:
    """A room 4 m deep around z = 0; ``holes`` maps a wall to the room its 2 m wide opening leads into."""
    outline = np.array([[x1, 2.0], [x1, -2.0], [x0, -2.0], [x0, 2.0]])
    floor = np.array([[x, 0.0, z] for x, z in outline])
    up = np.array([0.0, HEIGHT, 0.0])
    surfaces = [Surface(floor, outline, "floor_tiles_bw_1")]
    if roofed:
        surfaces.append(Surface(floor[::-1] + up, outline[::-1].copy(), "concrete_tiles_1"))
    openings = []
    for wall in range(4):
        a, b = floor[wall], floor[(wall + 1) % 4]
        length = float(np.abs(b - a).sum())
        pieces = [(0.0, length)]
        if wall in holes:
            pieces = [(0.0, length / 2 - 1), (length / 2 + 1, length)]
            s, t = (a + (b - a) * part / length for part in (length / 2 - 1, length / 2 + 1))
            openings.append(Opening(np.array([s, s + up, t + up, t]), holes[wall]))
        for start, end in pieces:
            s, t = a + (b - a) * start / length, a + (b - a) * end / length
            places = np.array([[start, 0.0], [start, HEIGHT], [end, HEIGHT], [end, 0.0]])
            surfaces.append(Surface(np.array([s, s + up, t + up, t]), places, "brick_wall_1"))
    return SceneRoom(outline, surfaces, openings, roofed)


def two_rooms(*, roofed: bool = True) -> Scene:
    rooms = [room(-2.0, 2.0, {0: 1}, roofed=roofed), room(2.0, 6.0, {2: 0}, roofed=roofed)]
    looks = [
        BoxLook((0.6, 0.6, 0.6), (1.0, 0.1, 0.1)),
        MeshLook("ball_blue", 0.6),
        FrameLook(("chars/ch_0x65_1",), 1, 1),
    ]
    places = np.array([[0.8, 0.0, -0.7, 0.4], [4.0, 0.0, 0.5, 0.0], [-1.9, 1.4, -0.5, 0.0]])
    return build_scene(rooms, looks, library=library(), places=places)


def digest(width: int, height: int) -> str:
    """One hash over pictures, distances and a plan."""
    scene = two_rooms()
    total = hashlib.sha256()
    for yaw in (0.1, 2.0, -1.0):
        camera = Camera((-1.5, 1.5, 0.3), yaw, math.radians(-3))
        total.update(render(scene, camera, width, height).tobytes())
        total.update(render_depth(scene, camera, width, height).tobytes())
    total.update(render_top(scene, width, height).tobytes())
    return total.hexdigest()


def display_digest(width: int, height: int) -> str:
    """One hash over a world's pictures in the look of a display: near its walls, and a thing."""
    world = gymnasium.make("minihuman/MiniWorld-OneRoom-v0", look="display", trig=1).unwrapped
    world.begin(seed=1)
    total = hashlib.sha256()
    for world.agent.dir in (0.7, 2.9, 5.0):
        total.update(world.picture(size_px=(width, height)).tobytes())
    return total.hexdigest()


def apart(width: int, height: int, *, pictures: int = 5) -> str:
    """One hash over pictures of as many headings."""
    drawn = [render(two_rooms(), Camera(CAMERA.position, yaw), width, height) for yaw in range(pictures)]
    return hashlib.sha256(np.stack(drawn).tobytes()).hexdigest()


def together(width: int, height: int, *, threads: int = 2, pictures: int = 5) -> str:
    """The same, of pictures drawn together."""
    targets = [RenderTarget(two_rooms(), width, height) for _ in range(pictures)]
    for yaw, target in enumerate(targets):
        target.aim(CAMERA.position, yaw, 0.0, CAMERA.fov_y_deg, CAMERA.near_m, CAMERA.far_m)
    out = np.empty((pictures, height, width, 3), np.uint8)
    RenderPool(pictures, threads).paint(targets, out)
    return hashlib.sha256(out.tobytes()).hexdigest()


def threaded_digests(width: int, height: int) -> set[str]:
    """The hashes that two threads get at the same time, eight times."""
    with ThreadPoolExecutor(2) as pool:
        return set(pool.map(lambda _: digest(width, height), range(8)))


if __name__ == "__main__":
    if sys.argv[3:] == ["alone"]:
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    width, height = map(int, sys.argv[1:3])
    print(digest(width, height))
    if sys.argv[3:] == ["everything"]:
        print(together(width, height, pictures=2), display_digest(width, height), sep="\n")
