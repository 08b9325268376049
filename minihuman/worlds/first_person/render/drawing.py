"""Drawing: from a scene and a camera to a picture, depths, a plan from above, or the visible entities."""

import math
import os
import struct
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.first_person.render import visibility
from minihuman.worlds.first_person.render.assets import ARROW_FACES, CUBE_FACES
from minihuman.worlds.first_person.render.draw_buffers import size_of
from minihuman.worlds.first_person.render.kernel_tables import F64, I32
from minihuman.worlds.first_person.render.rasterisation import (
    BOTTOM,
    HEIGHT,
    LEAST,
    LIGHT,
    LOOK,
    ROOM,
    SKY,
    TOP,
    VIEW_SIZE,
)
from minihuman.worlds.first_person.render.scene import Camera, Light, Scene, SceneTables, Vector
from minihuman.worlds.first_person.render.shading import colour
from minihuman.worlds.pose import Pose
from minihuman.worlds.trigonometry import cosine, sine

_GLOBAL_AMBIENT = 0.2  # OpenGL adds this much white to every light
_AGENT_RGB = (1.0, 0.0, 0.0)
_AGENT_RADIUS_M = 0.4
_AGENT_HEIGHT_M = 1.6
_PLAN_MARGIN_M = 1.0  # of sky around the floor plan
_AGENT_BOX_M = _AGENT_RADIUS_M, 0.0, 0.0, _AGENT_RADIUS_M
_QUERY_CUBE_M = 0.2
_QUERY_BOX_M = _QUERY_CUBE_M / 2, 0.0, _QUERY_CUBE_M, _QUERY_CUBE_M / 2
MOST_SPANS = 43  # memory for spans per row of samples, at first; an odd number spreads rows over a processor's cache
_BAND_PIXELS = 150_000  # per core; with fewer, handing work to another thread takes as long as drawing it
_BANDS_A_CORE = 3  # a floor takes longer than a ceiling, so with one band per core some threads would wait

_MOST_PIXELS = 4096  # along a side of a picture

_EYE = struct.Struct(f"{LIGHT}d")  # the numbers of a view before those of the light
_memory = threading.local()  # arrays to draw into, reused for each picture; no content passes from one to the next


def render(
    scene: Scene, camera: Camera, width: int, height: int, *, out: NDArray[np.uint8] | None = None
) -> NDArray[np.uint8]:
    """Return the camera's picture, uint8[height, width, 3], drawn into the contiguous array ``out`` if given.

    Raises:
        WorldError: if the picture has no pixels or a side of over 4096.
    """
    target = RenderTarget(scene, width, height)
    target.aim(*_camera_numbers(camera))
    return target.draw(out)


class RenderTarget:
    """A scene that is drawn repeatedly in one size; what is the same in every picture is prepared once.

    Args:
        scene: the scene.
        width: the width of a picture in pixels.
        height: the height of a picture in pixels.
        trig: whether headings are turned by the host's sine and cosine (0) or our own (1).

    Raises:
        WorldError: if the picture has no pixels or a side of over 4096.
    """

    def __init__(self, scene: Scene, width: int, height: int, *, trig: int = 0) -> None:
        _check_size(width, height)
        self.size_px = width, height
        self.layout = scene.layout
        self._trig = trig  # the sine and cosine for headings: 0 the host's, 1 our own
        self.places = _turned(scene.places, trig)
        self.view = np.zeros(VIEW_SIZE)
        _complete(scene, self.view, width, height)

    def move(self, thing: int, pos: Vector, yaw_rad: float) -> None:
        """Move the entity with the index ``thing`` to another place and heading."""
        self.places[thing, :5] = (*pos, *turn(yaw_rad, self._trig))

    def aim(self, pos: Vector, yaw_rad: float, pitch_rad: float, fov_y_deg: float, near_m: float, far_m: float) -> None:
        """Set the camera of the next picture."""
        _aim(self.view, pos, yaw_rad, pitch_rad, fov_y_deg, near_m, far_m, *self.size_px, trig=self._trig)
        self.view[ROOM:LOOK] = MOST_SPANS, self.layout.capacity, self.layout.most_corners

    def draw(self, out: NDArray[np.uint8] | None = None) -> NDArray[np.uint8]:
        """Return the camera's picture, uint8[height, width, 3], drawn into the contiguous array ``out`` if given."""
        width, height = self.size_px
        if out is None:
            picture = np.empty((height, width, 3), np.uint8)
        else:
            picture = out
        _draw(self.layout, self.view, self.places, picture)
        return picture

    def room(self) -> tuple[int, int]:
        """Return the numbers of float64 and int32 needed for drawing, if no row has unusually many spans."""
        return _memory_size(self.layout, self.size_px[1], MOST_SPANS)


def render_depth(scene: Scene, camera: Camera, width: int, height: int) -> NDArray[np.float32]:
    """Return the depth along the camera's axis in metres, float32[height, width]; ``far_m`` where there is nothing."""
    view = _perspective(camera, width, height)
    _complete(scene, view, width, height)
    out = np.empty((height, width), np.float32)
    visibility.distances(view, *_cover(scene.layout, view, _turned(scene.places)), out)
    return out


def render_top(scene: Scene, width: int, height: int, *, agent: Pose | None = None) -> NDArray[np.uint8]:
    """Return the plan from above, with -z up and a metre of sky around it, uint8[height, width, 3].

    ``agent`` adds a red arrowhead at a pose.
    """
    if agent is not None:
        scene = _with_agent(scene, agent)
    view = _view_from_above(scene.layout, width, height)
    out = np.empty((height, width, 3), np.uint8)
    _complete(scene, view, width, height)
    _draw(scene.layout, view, _turned(scene.places), out)
    return out


def visible_things(scene: Scene, camera: Camera, width: int, height: int) -> list[int]:
    """Return the indices of the visible entities; a small cube at its place stands for each, as in Miniworld."""
    count = scene.layout.thing_count
    # a row of the things' table, whose columns are in `kernel_tables`
    cube = [*CUBE_FACES, *(_QUERY_CUBE_M,) * 3, 1.0, *(1.0,) * 3, *(_QUERY_CUBE_M,) * 2, *_QUERY_BOX_M]
    places = scene.places.copy()
    places[:, 3] = np.where(np.isnan(places[:, 3]), np.nan, 0.0)  # the cubes do not turn
    cubes = np.tile(np.array(cube), (count, 1))
    view = _perspective(camera, width, height)
    turned = _turned(places)
    _complete(scene, view, width, height)
    _cover(replace(scene.layout, things=cubes), view, turned)
    return [int(index) for index in np.flatnonzero(turned[:, visibility.SAMPLES])]


def _draw(layout: SceneTables, view: F64, places: F64, out: NDArray[np.uint8]) -> None:
    """Draw into ``out``; a large picture is drawn in bands, which all cores take in turn, with the same result."""
    height, width = out.shape[:2]
    cores = min(_cores(), width * height // _BAND_PIXELS)
    if cores < 2:
        _colour_band(layout, view, places, out)
        return
    count = _BANDS_A_CORE * cores
    # all threads take their next band from this iterator
    bands = iter(list(pairwise(height * number // count for number in range(count + 1))))

    def draw_bands(view: F64, places: F64) -> None:
        for top, bottom in bands:
            view[TOP] = top
            view[BOTTOM] = bottom
            _colour_band(layout, view, places, out)

    futures = [_helpers(os.getpid()).submit(draw_bands, view.copy(), places.copy()) for _ in range(cores - 1)]
    draw_bands(view.copy(), places)
    for future in futures:
        future.result()


def _colour_band(layout: SceneTables, view: F64, places: F64, out: NDArray[np.uint8]) -> None:
    """Draw the rows of ``out`` from ``view[TOP]`` to ``view[BOTTOM]``."""
    covered = _cover(layout, view, places)
    colour(*layout.textures, *layout.packed_rooms, layout.things, places, view, *covered, out)


def _cover(layout: SceneTables, view: F64, places: F64) -> tuple[F64, I32]:
    """Compute which face covers each sample; return this thread's drawing memory, which contains the result."""
    spans = MOST_SPANS
    while True:
        view[ROOM:LOOK] = spans, layout.capacity, layout.most_corners
        memory = memory_for(*_memory_size(layout, int(view[HEIGHT]), spans))
        if visibility.cover(*layout.packed_rooms, *layout.packed_library, layout.things, places, view, *memory):
            return memory
        spans *= 2


def _complete(scene: Scene, view: F64, width: int, height: int) -> None:
    """Fill in the light, the sky, the style and the size of a view whose camera is already set."""
    view[LIGHT:SKY] = _light_numbers(scene.light)
    view[SKY:LEAST], view[LOOK] = scene.sky, scene.display
    view[TOP:ROOM] = 0.0, height, height, width  # the first row, one past the last, the height and the width


@cache
def _cores() -> int:
    """Return the number of processors that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@cache
def _helpers(process: int) -> ThreadPoolExecutor:
    """Return the pool of threads that draw bands of large pictures in a process; a forked process needs another one."""
    return ThreadPoolExecutor(_cores(), thread_name_prefix=f"bands-{process}")


def _perspective(camera: Camera, width: int, height: int) -> F64:
    """Return a camera's view of a size in pixels, without light, sky and style, which `_complete` fills in."""
    _check_size(width, height)
    view = np.zeros(VIEW_SIZE)
    _aim(view, *_camera_numbers(camera), width, height)
    return view


def _camera_numbers(camera: Camera) -> tuple[Vector, float, float, float, float, float]:
    return camera.position, camera.yaw_rad, camera.pitch_rad, camera.fov_y_deg, camera.near_m, camera.far_m


def _aim(
    view: F64,
    pos: Vector,
    yaw_rad: float,
    pitch_rad: float,
    fov_y_deg: float,
    near_m: float,
    far_m: float,
    width: int,
    height: int,
    *,
    trig: int = 0,
) -> None:
    """Write a camera into a view of a picture of a size: its position, direction, focal lengths and planes."""
    cos_yaw, sin_yaw = turn(yaw_rad, trig)
    cos_pitch, sin_pitch = turn(pitch_rad, trig)
    focal = height / 2 / half_view(fov_y_deg, trig)
    _EYE.pack_into(
        view.data,
        0,
        *pos,
        *(sin_yaw, 0.0, cos_yaw),
        *(-sin_pitch * cos_yaw, cos_pitch, sin_pitch * sin_yaw),
        *(cos_pitch * cos_yaw, sin_pitch, -cos_pitch * sin_yaw),
        *(focal, focal, width / 2, height / 2),
        *(near_m, far_m, 0.0),
    )
    view[LEAST] = 0.5 / far_m


def turn(angle_rad: float, trig: int) -> tuple[float, float]:
    """Return the cosine and sine of an angle, by the host's functions (0) or our own (1)."""
    if trig:
        return (cosine(angle_rad), sine(angle_rad))
    return (math.cos(angle_rad), math.sin(angle_rad))


def half_view(fov_y_deg: float, trig: int) -> float:
    """Return the tangent of half the camera's vertical field of view, by the host's functions (0) or our own (1)."""
    half_rad = math.radians(fov_y_deg) / 2
    if trig:
        return sine(half_rad) / cosine(half_rad)
    return math.tan(half_rad)


def _fit_plan(layout: SceneTables, width: int, height: int) -> tuple[float, float, float]:
    """Return the scale of the largest plan that fits, in pixels per metre, and the middle of the plan, x and z."""
    x0, z0, x1, z1 = layout.bounds
    scale = min(width / (x1 - x0 + 2 * _PLAN_MARGIN_M), height / (z1 - z0 + 2 * _PLAN_MARGIN_M))
    return scale, (x0 + x1) / 2, (z0 + z1) / 2


def _view_from_above(layout: SceneTables, width: int, height: int) -> F64:
    """Return the parallel view of the floor plan from above, without light, sky and style."""
    _check_size(width, height)
    scale, middle_x, middle_z = _fit_plan(layout, width, height)
    view = np.empty(VIEW_SIZE)
    view[:LIGHT] = (
        *(middle_x, 0.0, middle_z),
        *(1.0, 0.0, 0.0),
        *(0.0, 0.0, -1.0),
        *(0.0, -1.0, 0.0),
        *(scale, scale, width / 2, height / 2),
        *(-100.0, 100.0, 1.0),  # the near and the far plane, beyond any floor and ceiling; parallel
    )
    view[LEAST] = 0.5
    return view


def _light_numbers(light: Light) -> F64:
    """Return the unit vector to a light, the light's colour, and the ambient light, float64[9].

    Raises:
        WorldError: if the light's direction has no length.
    """
    x, y, z = light.towards
    length = math.sqrt(x * x + y * y + z * z)
    if length == 0.0:
        raise WorldError("the light's direction is (0, 0, 0); give it a length above 0")
    numbers = np.empty(9)
    ambient = (part + _GLOBAL_AMBIENT for part in light.ambient)
    numbers[:] = (x / length, y / length, z / length, *light.colour, *ambient)
    return numbers


def _turned(places: F64, trig: int = 0) -> F64:
    """Return the places of entities (x, y, z, yaw) as rows x, y, z, cosine and sine of the yaw.

    A sixth column is reserved for the number of samples that each entity covers.
    """
    turned = np.empty((len(places), 6))
    turned[:, :3] = places[:, :3]
    for row, yaw in enumerate(places[:, 3].tolist()):
        turned[row, 3:5] = turn(yaw, trig)
    return turned


def _check_size(width: int, height: int) -> None:
    if not (1 <= width <= _MOST_PIXELS and 1 <= height <= _MOST_PIXELS):
        raise WorldError(f"a picture cannot be {width} x {height} pixels; each side must be 1 to {_MOST_PIXELS}")


def _memory_size(layout: SceneTables, height: int, spans: int) -> tuple[int, int]:
    """Return the numbers of float64 and int32 needed for drawing with at most ``spans`` spans per row of samples."""
    return size_of(height, spans, layout.capacity, layout.most_corners, len(layout.rooms.bounds))


def memory_for(float_count: int, whole_count: int) -> tuple[F64, I32]:
    """Return this thread's arrays to draw in, replaced by larger ones if they have fewer numbers than these."""
    arrays: tuple[F64, I32] | None = getattr(_memory, "arrays", None)
    if arrays is None or len(arrays[0]) < float_count or len(arrays[1]) < whole_count:
        arrays = np.zeros(float_count), np.zeros(whole_count, np.int32)
        _memory.arrays = arrays
    return arrays


def _with_agent(scene: Scene, agent: Pose) -> Scene:
    """Return the scene with a red arrowhead at the agent's pose, as one more thing."""
    arrow = np.array(  # a row of the things' table, whose columns are in `kernel_tables`
        [[*ARROW_FACES, *(_AGENT_RADIUS_M,) * 3, 1.0, *_AGENT_RGB, *(_AGENT_RADIUS_M,) * 2, *_AGENT_BOX_M]]
    )
    place = np.array([[agent.x, agent.y + _AGENT_HEIGHT_M, agent.z, agent.yaw_rad]])
    layout = replace(scene.layout, things=np.concatenate([scene.layout.things, arrow]))
    return replace(scene, layout=layout, places=np.concatenate([scene.places, place]))
