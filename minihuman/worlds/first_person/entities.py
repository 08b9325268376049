"""Entities: the things that can stand in a world, with their sizes and looks, and the agent.

A position is on the floor, below the middle of the entity; for a frame, it is the middle of its back, on the wall. The
extents of meshes are those of the files that Miniworld ships. They determine a thing's width once it is scaled to its
height, and the number of textures to draw one from; so they affect which moves collide and which numbers a seed yields.
The module knows no rules and draws nothing.
"""

import itertools
import math
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.colours import RGB_BY_COLOUR, Rgb, check_colour, hex_colour
from minihuman.worlds.first_person.parameters import Parameters
from minihuman.worlds.trigonometry import cosine, sine
from minihuman.worlds.upstream_names import WorldAttributeError, define_names, missing_name

# Half the width (x), the height (y), half the depth (z).
_EXTENTS: dict[str, tuple[float, float, float]] = {
    "ball": (1.284565, 2.564372, 1.285002),
    "barrel": (0.30539, 0.882287, 0.30538952),
    "barrier": (2.032784, 1.143, 0.4064),
    "building": (1.84, 3.45, 1.22),
    "cone": (10.0, 31.5229, 10.0),
    "doom_door": (0.05, 1.0, 0.5),
    "duckie": (0.8303055, 1.518421, 0.58813),
    "key": (0.401406, 2.0, 2.4187405),
    "keycard": (0.085815, 2.3173308, 0.90595853),
    "medkit": (28.1319, 51.0648, 15.62425),
    "office_chair": (14.544351, 47.314598, 13.73),
    "office_desk": (33.45795, 63.6329, 16.451252),
    "potion": (0.6400001, 2.513775, 0.6400001),
    "tree": (13.99055, 26.541735, 10.40086),
    "tree_pine": (2.1321554, 7.543869, 2.1399379),
}
_COLOURED = ("ball", "key")  # one shape, one file per colour: "ball_red"

_SEVERAL = {"cardboard": 4, "concrete": 4, "door_doom": 2, "grass": 2, "lava": 2, "marble": 2, "metal_grill": 2}
_SEVERAL |= {"water": 3, "wood": 2}
_CHARACTER_VARIANTS = 9


def mesh_extents(mesh: str) -> tuple[np.float32, np.float32, np.float32] | None:
    """Return the half width, height and half depth of a built-in mesh in its own units; None for other meshes."""
    stem = next((name for name in _COLOURED if mesh.startswith(f"{name}_")), mesh)
    if stem not in _EXTENTS:
        return None
    x, y, z = _EXTENTS[stem]
    return np.float32(x), np.float32(y), np.float32(z)


def texture_variants(texture: str) -> int:
    """Return the number of pictures from which a texture name's picture is drawn when worlds are randomised."""
    if texture.startswith("chars/"):
        return _CHARACTER_VARIANTS
    return _SEVERAL.get(texture, 1)


LATEST_CHANGE = [0]  # the number of the latest change of any entity; copies of attributes from before may be outdated
_changes = itertools.count(1)


def note_change() -> None:
    """Record that attributes of entities may have changed, so that copies of them are out of date."""
    LATEST_CHANGE[0] = next(_changes)


Position = tuple[float, float, float]  # x, y, z in metres
Length = float | np.float32  # metres; of a mesh in single precision, as Miniworld keeps it


_INSTEAD = {
    "str": "read text",
    **dict.fromkeys(("render", "draw_bound", "scale", "texs", "tex"), "draw with env.unwrapped.picture()"),
    "step": "only actions move things",
}


class Entity:
    """A thing with a position, a heading (``dir``, in radians, counter-clockwise from +x), a radius and a height.

    A static entity cannot be picked up and never moves.
    """

    static: bool = False
    name: str = "thing"
    radius: Length = 0.0
    height: float = 0.0
    looks: ClassVar[tuple[str, ...]] = ()  # further attributes that distinguish entities of one kind
    trig: int = 0  # the sine and cosine that turn it: 0 the host's, 1 our own, which are the same on every machine

    def __init__(self) -> None:
        self.pos: Position = (math.nan, math.nan, math.nan)  # not a number until it is placed
        self.dir: float = math.nan

    def __setattr__(self, name: str, value: Any) -> None:
        is_position_array = name == "pos" and type(value) is np.ndarray
        object.__setattr__(self, name, tuple(value.tolist()) if is_position_array else value)
        LATEST_CHANGE[0] = next(_changes)  # as `note_change`, but a call costs as much as all of this

    def randomise(self, parameters: Parameters, rng: np.random.Generator | None) -> None:
        """Draw the properties that vary between episodes; without a random stream, use the defaults."""

    @property
    def colour(self) -> str:
        """Return the entity's colour on a map, "#rrggbb"."""
        return "#808080"

    @property
    def forward(self) -> tuple[float, float]:
        """Return the unit vector of the entity's heading, (x, z)."""
        if self.trig:
            return cosine(self.dir), -sine(self.dir)
        return math.cos(self.dir), -math.sin(self.dir)

    # Miniworld's names.

    @property
    def dir_vec(self) -> NDArray[np.float64]:
        """Return the unit vector of the entity's heading in Miniworld's form, float64[3]: x, 0, z."""
        x, z = self.forward
        return np.array((x, 0.0, z))

    @property
    def right_vec(self) -> NDArray[np.float64]:
        """Return the unit vector to the entity's right, float64[3]: x, 0, z."""
        x, z = self.forward
        return np.array((-z, 0.0, x))

    @property
    def is_static(self) -> bool:
        """Return whether the entity is static."""
        return self.static

    def state(self) -> tuple[object, ...]:
        """Return everything that distinguishes this entity from others: its kind, position and looks."""
        looks = tuple(getattr(self, name) for name in self.looks)
        return self.name, *self.pos, self.dir, float(self.radius), float(self.height), self.static, *looks

    def __repr__(self) -> str:
        return f"<{self.name} at {self.pos}>"


def _refuse_name(thing: Entity, name: str) -> Any:
    raise missing_name(thing, name, _INSTEAD)


define_names(Entity, _INSTEAD, _refuse_name)


class Box(Entity):
    """A coloured box; ``size`` is the length of its sides in metres, or one length per side (x, y, z).

    Raises:
        WorldError: if the colour is unknown, or a side is not above 0.
    """

    looks = ("size", "rgb")

    def __init__(self, colour: str, size: float | tuple[float, float, float] = 0.8) -> None:
        super().__init__()
        self.colour_name = check_colour(colour)
        self.name = f"{colour} box"
        if isinstance(size, tuple):
            self.size = size
        else:
            self.size = (size, size, size)
        if min(self.size) <= 0:
            raise WorldError(f"a box's size is {self.size} m; each side must be above 0")
        width, self.height, depth = self.size
        self.radius = math.sqrt(width * width + depth * depth) / 2
        self.rgb: Rgb = RGB_BY_COLOUR[colour]

    def randomise(self, parameters: Parameters, rng: np.random.Generator | None) -> None:
        """Draw the shade of the box's colour."""
        bias = parameters.triple("obj_color_bias", rng)
        shade = [
            min(max(part + add, 0.0), 1.0) for part, add in zip(RGB_BY_COLOUR[self.colour_name], bias, strict=True)
        ]
        self.rgb = shade[0], shade[1], shade[2]

    @property
    def colour(self) -> str:
        """Return the box's colour on a map, "#rrggbb"."""
        return hex_colour(self.rgb)

    @property
    def color(self) -> str:
        """Return the name of the box's colour."""
        return self.colour_name

    @color.setter
    def color(self, colour: str) -> None:
        raise WorldAttributeError(f"color of {self!r} cannot be set; place another Box({colour!r}) in build()")

    @property
    def color_vec(self) -> NDArray[np.float64]:
        """Return the box's red, green and blue in 0 to 1, float64[3]."""
        return np.array(self.rgb)


class Mesh(Entity):
    """An entity drawn from a mesh that is scaled to a height in metres; the mesh determines its width.

    A mesh in a world's own folder is known by name only; it is measured when the entity is placed.

    Raises:
        WorldError: if the height is not above 0.
    """

    looks = ("mesh",)

    def __init__(self, mesh: str, height: float, *, static: bool = True) -> None:
        super().__init__()
        if height <= 0:
            raise WorldError(f"the height of mesh {mesh!r} is {height} m; it must be above 0")
        self.mesh = mesh
        self.name = mesh.replace("_", " ")
        self.static = static
        self.height = height
        self.radius = math.nan
        if (extents := mesh_extents(mesh)) is not None:
            self.measure(*extents)

    def measure(self, half_width: Length, own_height: Length, half_depth: Length) -> None:
        """Set the entity's radius from the extents of its mesh, which are in the mesh's own units."""
        self.radius = math.sqrt(half_width * half_width + half_depth * half_depth) * (self.height / own_height)


class ColouredMesh(Mesh):
    """A mesh that exists in the six colours and can be carried."""

    def __init__(self, kind: str, colour: str, height: float) -> None:
        super().__init__(f"{kind}_{check_colour(colour)}", height, static=False)
        self.kind = kind
        self.colour_name = colour
        self.name = f"{colour} {kind}"

    @property
    def colour(self) -> str:
        """Return the entity's colour on a map, "#rrggbb"."""
        return hex_colour(RGB_BY_COLOUR[self.colour_name])


class Ball(ColouredMesh):
    """A ball of ``size`` metres in diameter, which can be carried."""

    def __init__(self, colour: str, size: float = 0.6) -> None:
        super().__init__("ball", colour, size)


class Key(ColouredMesh):
    """A key of ``size`` metres in height, which can be carried."""

    def __init__(self, colour: str, size: float = 0.35) -> None:
        super().__init__("key", colour, size)


class ImageFrame(Entity):
    """A framed picture on a wall.

    Args:
        pos: the middle of its back, on the wall, in metres
        dir: the direction that it faces, in radians
        texture: the name of the picture
        width: its width in metres
        aspect: its height divided by its width
        depth: by how much it stands out from the wall, in metres
    """

    static = True
    looks = ("texture", "width", "depth")

    def __init__(
        self, pos: Position, dir: float, texture: str, width: float, *, aspect: float, depth: float = 0.05
    ) -> None:
        super().__init__()
        self.pos = pos
        self.dir = dir
        self.texture = texture
        self.width = width
        self.depth = depth
        self.height = aspect * width
        self.name = f"picture {texture}"


class TextFrame(Entity):
    """A framed line of letters and digits on a wall; each character is as wide as it is high.

    Args:
        pos: the middle of its back, on the wall, in metres
        dir: the direction that it faces, in radians
        text: the line
        height: the height of a character in metres
        depth: by how much it stands out from the wall, in metres

    Raises:
        WorldError: if the text has other characters than letters, digits and spaces.
    """

    static = True
    looks = ("text", "variants")

    def __init__(self, pos: Position, dir: float, text: str, *, height: float = 0.15, depth: float = 0.05) -> None:
        super().__init__()
        if not all(letter == " " or (letter.isascii() and letter.isalnum()) for letter in text):
            raise WorldError(f"the sign {text!r} has a character that cannot be drawn; use A to Z, digits and spaces")
        self.pos = pos
        self.dir = dir
        self.text = text
        self.depth = depth
        self.height = height
        self.width = len(text) * height
        self.name = f"sign {text}"
        self.variants: tuple[int, ...] = (0,) * len(text)  # the number of each character's picture

    @property
    def textures(self) -> list[str | None]:
        """Return the texture of each character; None for a space."""
        return [None if letter == " " else f"chars/ch_0x{ord(letter)}" for letter in self.text]

    def randomise(self, parameters: Parameters, rng: np.random.Generator | None) -> None:
        """Draw the number of a picture for each character; without a random stream, use 0."""
        self.variants = tuple(
            0 if rng is None or texture is None else int(rng.integers(texture_variants(texture)))
            for texture in self.textures
        )


class Agent(Entity):
    """The agent; its lengths are in metres and its camera angles in degrees."""

    name = "agent"
    looks = ("cam_height", "cam_fwd_disp", "cam_pitch", "cam_fov_y")

    def __init__(self) -> None:
        super().__init__()
        self.radius = 0.4
        self.height = 1.6
        self.cam_height = 1.5  # above the floor
        self.cam_fwd_disp = 0.0  # in front of the body's middle
        self.cam_pitch = 0.0  # upwards
        self.cam_fov_y = 60.0  # how much is seen from top to bottom
        self.carrying: Entity | None = None

    @property
    def cam_pos(self) -> NDArray[np.float64]:
        """Return the position of the agent's camera, float64[3]: x, y, z."""
        up = np.array((0.0, self.cam_height, 0.0))
        eye: NDArray[np.float64] = np.array(self.pos) + self.dir_vec * self.cam_fwd_disp + up
        return eye

    @property
    def cam_dir(self) -> NDArray[np.float64]:
        """Return the unit vector of the camera's direction, float64[3]: x, y, z."""
        pitch_rad = math.radians(self.cam_pitch)
        upwards = np.array((0.0, math.sin(pitch_rad), 0.0))
        ahead: NDArray[np.float64] = self.dir_vec * math.cos(pitch_rad) + upwards
        return ahead

    def randomise(self, parameters: Parameters, rng: np.random.Generator | None) -> None:
        """Draw the position and angles of the camera."""
        self.cam_height = parameters.number("cam_height", rng)
        self.cam_fwd_disp = parameters.number("cam_fwd_disp", rng)
        self.cam_pitch = parameters.number("cam_pitch", rng)
        self.cam_fov_y = parameters.number("cam_fov_y", rng)
