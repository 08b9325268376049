"""Draw: a scene and a camera in, a picture, distances, a plan or what is in sight out."""

import math
import threading
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.first_person.render import kernel
from minihuman.worlds.first_person.render.assets import join, pack, unit_cube
from minihuman.worlds.first_person.render.layout import Layout
from minihuman.worlds.first_person.render.project import FAR, PARALLEL, VIEW_SIZE
from minihuman.worlds.first_person.render.scene import Camera, Light, Scene
from minihuman.worlds.first_person.render.shade import resolve
from minihuman.worlds.first_person.render.tables import F64, I64, Drawn, Things
from minihuman.worlds.pose import Pose

_GLOBAL_AMBIENT = 0.2  # OpenGL adds this much white to every light
_AGENT_RGB = (1.0, 0.0, 0.0)
_AGENT_RADIUS_M = 0.4
_AGENT_HEIGHT_M = 1.6
_PLAN_MARGIN_M = 1.0
_QUERY_CUBE_M = 0.2

_memory = threading.local()  # arrays to draw into, kept from picture to picture; they hold nothing from one to the next


def render(scene: Scene, camera: Camera, width: int, height: int) -> NDArray[np.uint8]:
    """What the camera sees, uint8[height, width, 3].

    Raises:
        WorldError: if the picture has no pixels or is over 4096 a side.
    """
    return _picture(scene, _perspective(camera, width, height), width, height)


def render_depth(scene: Scene, camera: Camera, width: int, height: int) -> NDArray[np.float32]:
    """How far things are along the camera's axis, float32[height, width], metres; ``far_m`` where there is nothing."""
    view = _perspective(camera, width, height)
    drawn, _ = _cover(scene, view, width, height)
    out = np.empty((height, width), np.float32)
    kernel.distances(drawn, view, out)
    return out


def render_top(scene: Scene, width: int, height: int, *, agent: Pose | None = None) -> NDArray[np.uint8]:
    """The floor plan from above, -z up the page, a metre of sky around it, uint8[height, width, 3].

    ``agent`` adds a red arrowhead where someone stands.
    """
    if agent is not None:
        scene = _with_agent(scene, agent)
    return _picture(scene, _from_above(scene.layout, width, height), width, height)


def plan_scale(scene: Scene, width: int, height: int) -> tuple[float, float, float]:
    """Pixels a metre in ``render_top``, and the pixel (column, row, as floats) where x = 0 and z = 0."""
    scale, middle_x, middle_z = _fit(scene.layout, width, height)
    return scale, width / 2 - middle_x * scale, height / 2 - middle_z * scale


def visible_things(scene: Scene, camera: Camera, width: int, height: int) -> list[int]:
    """The indices of the things that can be seen: a small cube at a thing's place stands for it, as in Miniworld."""
    count = scene.layout.thing_count
    cubes = Things(
        np.tile(np.array([[0, len(unit_cube())]], np.int32), (count, 1)),
        np.full((count, 3), _QUERY_CUBE_M),
        np.ones(count),
        np.ones((count, 3)),
        np.full((count, 2), _QUERY_CUBE_M),
    )
    places = scene.places.copy()
    places[:, 3] = np.where(np.isnan(places[:, 3]), np.nan, 0.0)
    shown = replace(scene, layout=replace(scene.layout, things=cubes), places=places)
    _, claimed = _cover(shown, _perspective(camera, width, height), width, height)
    return [int(index) for index in np.flatnonzero(claimed)]


def _cover(scene: Scene, view: F64, width: int, height: int) -> tuple[Drawn, I64]:
    """Draw without colours: which face covers each sample, and how many samples each thing got."""
    layout, drawn = scene.layout, _room_to_draw(scene.layout, width, height)
    claimed = np.empty(layout.thing_count, np.int64)
    kernel.draw(
        layout.faces,
        layout.rooms,
        layout.library,
        layout.things,
        _turned(scene.places),
        view,
        _light(scene.light),
        drawn,
        claimed,
    )
    return drawn, claimed


def _picture(scene: Scene, view: F64, width: int, height: int) -> NDArray[np.uint8]:
    drawn, _ = _cover(scene, view, width, height)
    out = np.empty((height, width, 3), np.uint8)
    least = 0.5 if view[PARALLEL] else 0.5 / view[FAR]  # of 1 / distance: beyond a face's edge it may reach nonsense
    sky = np.array(scene.sky, np.float64)
    resolve(drawn.owner, drawn.planes, drawn.kind, scene.layout.textures, sky, least, out)
    return out


def _perspective(camera: Camera, width: int, height: int) -> F64:
    _check_size(width, height)
    cos_yaw, sin_yaw = math.cos(camera.yaw_rad), math.sin(camera.yaw_rad)
    cos_pitch, sin_pitch = math.cos(camera.pitch_rad), math.sin(camera.pitch_rad)
    focal = height / 2 / math.tan(math.radians(camera.fov_y_deg) / 2)
    view = np.empty(VIEW_SIZE)
    view[:] = (
        *camera.position,
        *(sin_yaw, 0.0, cos_yaw),
        *(-sin_pitch * cos_yaw, cos_pitch, sin_pitch * sin_yaw),
        *(cos_pitch * cos_yaw, sin_pitch, -cos_pitch * sin_yaw),
        *(focal, focal, width / 2, height / 2),
        *(camera.near_m, camera.far_m, 0.0),
    )
    return view


def _fit(layout: Layout, width: int, height: int) -> tuple[float, float, float]:
    x0, z0, x1, z1 = layout.bounds
    scale = min(width / (x1 - x0 + 2 * _PLAN_MARGIN_M), height / (z1 - z0 + 2 * _PLAN_MARGIN_M))
    return scale, (x0 + x1) / 2, (z0 + z1) / 2


def _from_above(layout: Layout, width: int, height: int) -> F64:
    _check_size(width, height)
    scale, middle_x, middle_z = _fit(layout, width, height)
    view = np.empty(VIEW_SIZE)
    view[:] = (
        *(middle_x, 0.0, middle_z),
        *(1.0, 0.0, 0.0),
        *(0.0, 0.0, -1.0),
        *(0.0, -1.0, 0.0),
        *(scale, scale, width / 2, height / 2),
        *(-100.0, 100.0, 1.0),
    )
    return view


def _light(light: Light) -> F64:
    x, y, z = light.towards
    length = math.sqrt(x * x + y * y + z * z)
    if length == 0.0:
        raise WorldError("a light towards (0, 0, 0) comes from nowhere; give it a direction")
    out = np.empty(9)
    out[:] = (x / length, y / length, z / length, *light.colour, *(part + _GLOBAL_AMBIENT for part in light.ambient))
    return out


def _turned(places: F64) -> F64:
    """Places with the cosine and sine of their yaw, by the one sine that is the same compiled or not."""
    out = np.empty((len(places), 5))
    out[:, :3] = places[:, :3]
    for row, yaw in enumerate(places[:, 3].tolist()):
        out[row, 3] = math.cos(yaw)
        out[row, 4] = math.sin(yaw)
    return out


def _check_size(width: int, height: int) -> None:
    if not (1 <= width <= 4096 and 1 <= height <= 4096):
        raise WorldError(f"a picture of {width}x{height} pixels cannot be drawn; 1 to 4096 a side can")


def _room_to_draw(layout: Layout, width: int, height: int) -> Drawn:
    drawn: Drawn | None = getattr(_memory, "drawn", None)
    if (
        drawn is None
        or drawn.owner.shape != (4 * height, width)
        or len(drawn.planes) < layout.capacity
        or drawn.screen.shape[0] < layout.most_corners
    ):
        drawn = Drawn(
            np.empty((4 * height, width), np.int32),
            np.empty((layout.capacity, 21)),
            np.empty((layout.capacity, 2), np.int32),
            np.empty(4 * height, np.int32),
            np.empty(4 * height, np.int32),
            np.empty((3, layout.most_corners, 3)),
            np.empty((layout.most_corners, 2)),
            np.empty((3, 3)),
        )
        _memory.drawn = drawn
    return drawn


def _with_agent(scene: Scene, agent: Pose) -> Scene:
    layout = scene.layout
    r = _AGENT_RADIUS_M
    arrow = np.array([[r, 0.0, 0.0], [-0.75 * r, 0.0, -0.75 * r], [-0.75 * r, 0.0, 0.75 * r]])
    first = len(layout.library.texture)
    library = join(layout.library, pack([arrow], [np.zeros((3, 2))]))
    old = layout.things
    things = Things(
        np.concatenate([old.faces, np.array([[first, first + 1]], np.int32)]),
        np.concatenate([old.scale, np.ones((1, 3))]),
        np.concatenate([old.normal_scale, np.ones(1)]),
        np.concatenate([old.tint, np.array([_AGENT_RGB])]),
        np.concatenate([old.reach, np.full((1, 2), r)]),
    )
    place = np.array([[agent.x, agent.y + _AGENT_HEIGHT_M, agent.z, agent.yaw_rad]])
    with_agent = replace(layout, library=library, things=things, capacity=layout.capacity + 1)
    return replace(scene, layout=with_agent, places=np.concatenate([scene.places, place]))
