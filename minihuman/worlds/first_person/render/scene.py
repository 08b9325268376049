"""The scene: what the renderer draws. Rooms of flat surfaces, things standing in them, light, sky and a camera.

Lengths are metres, x right, y up, z towards the reader on a floor plan; yaw 0 looks along +x and grows
counter-clockwise seen from above. Nothing here knows rules, randomness or pixels.

A world makes its scene once an episode and draws it as often as it likes:

    scene = lay_out(rooms, looks, light=..., sky=...)              # layout.py
    scene = scene.at(places)                                       # where the things stand now
    picture = render(scene, camera, width=80, height=60)           # draw.py: uint8[60, 80, 3]
    depth = render_depth(scene, camera, width=80, height=60)       # draw.py: float32[60, 80], metres
    plan = render_top(scene, width=80, height=60, agent=pose)      # draw.py: uint8[60, 80, 3]
    seen = visible_things(scene, camera, width=80, height=60)      # draw.py: indices of the looks
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError

if TYPE_CHECKING:
    from minihuman.worlds.first_person.render.layout import Layout

Rgb = tuple[float, float, float]  # 0 to 1
Vector = tuple[float, float, float]  # x, y, z
NEAR_M, FAR_M = 0.04, 100.0  # how near and far an eye sees


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """A flat convex piece of floor, wall or ceiling, seen only from the side where its corners run counter-clockwise.

    ``texture_m`` says, for each corner, how many metres right and up from the texture's origin it lies: (x, z) on a
    floor, (distance along the wall, height) on a wall. The texture repeats at its own size.
    """

    corners: NDArray[np.float64]  # (n, 3)
    texture_m: NDArray[np.float64]  # (n, 2)
    texture: str  # with its variant: "brick_wall_1"

    def __post_init__(self) -> None:
        if self.corners.shape[0] < 3 or self.corners.shape[1:] != (3,):
            raise WorldError(f"a surface has 3 or more corners of x, y, z, not an array of shape {self.corners.shape}")
        if self.texture_m.shape != (len(self.corners), 2):
            raise WorldError(f"{len(self.corners)} corners need as many texture places, not {self.texture_m.shape}")


@dataclass(frozen=True, slots=True, eq=False)
class Opening:
    """A hole in a room's wall, through which room number ``into`` is seen; corners run as a surface's there would."""

    corners: NDArray[np.float64]  # (4, 3)
    into: int


@dataclass(frozen=True, slots=True, eq=False)
class SceneRoom:
    """One convex room. The outline runs counter-clockwise seen from above; without a roof one sees over its walls."""

    outline: NDArray[np.float64]  # (n, 2) x, z
    surfaces: Sequence[Surface]
    openings: Sequence[Opening] = ()
    roofed: bool = True


@dataclass(frozen=True, slots=True)
class BoxLook:
    """A plain box, its base at the thing's place."""

    size: Vector
    colour: Rgb


@dataclass(frozen=True, slots=True)
class MeshLook:
    """A mesh of the asset set, scaled to a height, its base at the thing's place."""

    mesh: str  # "duckie", "key_red"
    height_m: float
    tint: Rgb = (1.0, 1.0, 1.0)  # times its own colours


@dataclass(frozen=True, slots=True)
class FrameLook:
    """A black-edged frame that shows textures side by side; the middle of its back is at the thing's place.

    A picture has one texture, a text one a letter; ``None`` is a blank.
    """

    textures: tuple[str | None, ...]
    width_m: float
    height_m: float
    depth_m: float = 0.05


@dataclass(frozen=True, slots=True)
class ShadowLook:
    """The shade on the ground around a thing that stands there: half of the light, a quarter at its rim."""

    radius_m: float


Look = BoxLook | MeshLook | FrameLook | ShadowLook


@dataclass(frozen=True, slots=True)
class Light:
    """A far-away light like the sun's, and what reaches every surface.

    ``towards`` points from the world to the light, at any length. Miniworld means a lamp at ``light_pos``, but hands
    OpenGL three numbers where four belong: what it gets is the direction ``light_pos + (1, 1, 1)``, and that is what a
    world gives here. A fifth of white is added to ``ambient``, as OpenGL does.
    """

    towards: Vector = (1.0, 3.5, 1.0)
    colour: Rgb = (0.7, 0.7, 0.7)
    ambient: Rgb = (0.45, 0.45, 0.45)


@dataclass(frozen=True, slots=True)
class Camera:
    """An eye. Positive pitch looks up; ``fov_y_deg`` is the whole vertical angle."""

    position: Vector
    yaw_rad: float
    pitch_rad: float = 0.0
    fov_y_deg: float = 60.0
    near_m: float = NEAR_M
    far_m: float = FAR_M

    def __post_init__(self) -> None:
        if not 0 < self.near_m < self.far_m:
            raise WorldError(f"near {self.near_m} m and far {self.far_m} m are not above 0 and in this order")
        if not 0 < self.fov_y_deg < 180:
            raise WorldError(f"a field of view of {self.fov_y_deg}° sees nothing; it is between 0 and 180")
        if not all(map(math.isfinite, (*self.position, self.yaw_rad, self.pitch_rad))):
            raise WorldError(f"a camera cannot stand at {self.position} with yaw {self.yaw_rad}")


@dataclass(frozen=True, slots=True, eq=False)
class Scene:
    """Everything there is to see at one moment, made by ``layout.lay_out`` once an episode.

    Only the places change from step to step: a row for each look, x, y, z and yaw_rad; a row of NaN hides the thing.
    """

    layout: "Layout"  # rooms and looks as flat arrays
    places: NDArray[np.float64]  # (looks, 4)
    light: Light = Light()
    sky: Rgb = (0.25, 0.82, 1.0)

    def __post_init__(self) -> None:
        if self.places.shape != (self.layout.thing_count, 4):
            raise WorldError(
                f"{self.layout.thing_count} things need as many places (x, y, z, yaw), not {self.places.shape}"
            )

    def at(self, places: NDArray[np.float64]) -> "Scene":
        """The same scene with its things elsewhere; what was laid out is shared."""
        return Scene(self.layout, places, self.light, self.sky)
