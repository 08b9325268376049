"""What can stand in a world: where it is, how wide and high, and what it looks like. No rules, no pictures.

A position is on the floor, under the middle of the thing; of a frame it is the middle of its back, on the wall.
"""

import math
from typing import ClassVar

import numpy as np

from minihuman.errors import WorldError
from minihuman.worlds.first_person.colours import COLOURS, Rgb, check_colour, hex_colour
from minihuman.worlds.first_person.extents import mesh_extents, texture_variants
from minihuman.worlds.first_person.parameters import Parameters

Position = tuple[float, float, float]  # x, y, z in metres
Length = float | np.float32  # metres; of a mesh in single precision, as Miniworld keeps it


class Entity:
    """A thing with a place, a heading (``dir``, radians, 0 = +x, counter-clockwise), a radius and a height.

    A static one cannot be picked up and never moves.
    """

    static: bool = False
    name: str = "thing"
    radius: Length = 0.0
    height: float = 0.0
    looks: ClassVar[tuple[str, ...]] = ()  # the attributes, beside these, that tell two of a kind apart

    def __init__(self) -> None:
        self.pos: Position = (math.nan, math.nan, math.nan)  # not a number until it is placed
        self.dir: float = math.nan

    def randomise(self, parameters: Parameters, rng: np.random.Generator | None) -> None:
        """Draw what varies from episode to episode; without a stream, take the defaults."""

    @property
    def colour(self) -> str:
        """The colour it has on a map, "#rrggbb"."""
        return "#808080"

    @property
    def forward(self) -> tuple[float, float]:
        """Where it heads, as a step of length 1 in (x, z)."""
        return math.cos(self.dir), -math.sin(self.dir)

    def state(self) -> tuple[object, ...]:
        """Everything that tells this thing from another: its kind, place and looks."""
        looks = tuple(getattr(self, name) for name in self.looks)
        return self.name, *self.pos, self.dir, float(self.radius), float(self.height), self.static, *looks

    def __repr__(self) -> str:
        return f"<{self.name} at {self.pos}>"


class Box(Entity):
    """A coloured box, ``size`` metres along each side, or one size a side (x, y, z)."""

    looks = ("size", "rgb")

    def __init__(self, colour: str, size: float | tuple[float, float, float] = 0.8) -> None:
        super().__init__()
        self.colour_name = check_colour(colour)
        self.name = f"{colour} box"
        self.size = size if isinstance(size, tuple) else (size, size, size)
        if min(self.size) <= 0:
            raise WorldError(f"a box of {self.size} m has no room inside; its sides are above 0")
        width, self.height, depth = self.size
        self.radius = math.sqrt(width * width + depth * depth) / 2
        self.rgb: Rgb = COLOURS[colour]

    def randomise(self, parameters: Parameters, rng: np.random.Generator | None) -> None:
        """Draw the shade of the colour."""
        bias = parameters.triple("obj_color_bias", rng)
        shade = [min(max(part + add, 0.0), 1.0) for part, add in zip(COLOURS[self.colour_name], bias, strict=True)]
        self.rgb = shade[0], shade[1], shade[2]

    @property
    def colour(self) -> str:
        """The colour it has on a map, "#rrggbb"."""
        return hex_colour(self.rgb)


class Mesh(Entity):
    """A thing drawn from a mesh scaled to a height in metres; the mesh decides how wide it is.

    A mesh of a world's own folder is known by name only; it is measured when the thing is placed.
    """

    looks = ("mesh",)

    def __init__(self, mesh: str, height: float, *, static: bool = True) -> None:
        super().__init__()
        if height <= 0:
            raise WorldError(f"the mesh {mesh!r} cannot be {height} m high; its height is above 0")
        self.mesh = mesh
        self.name = mesh.replace("_", " ")
        self.static = static
        self.height = height
        self.radius = math.nan
        if (extents := mesh_extents(mesh)) is not None:
            self.measure(*extents)

    def measure(self, half_width: Length, own_height: Length, half_depth: Length) -> None:
        """Make it as wide as its mesh says, given the mesh's size in its own units."""
        self.radius = math.sqrt(half_width * half_width + half_depth * half_depth) * (self.height / own_height)


class ColouredMesh(Mesh):
    """A mesh that comes in the six colours and can be carried."""

    def __init__(self, kind: str, colour: str, height: float) -> None:
        super().__init__(f"{kind}_{check_colour(colour)}", height, static=False)
        self.kind = kind
        self.colour_name = colour
        self.name = f"{colour} {kind}"

    @property
    def colour(self) -> str:
        """The colour it has on a map, "#rrggbb"."""
        return hex_colour(COLOURS[self.colour_name])


class Ball(ColouredMesh):
    """A ball that can be carried, ``size`` metres across."""

    def __init__(self, colour: str, size: float = 0.6) -> None:
        super().__init__("ball", colour, size)


class Key(ColouredMesh):
    """A key that can be carried, ``size`` metres high."""

    def __init__(self, colour: str, size: float = 0.35) -> None:
        super().__init__("key", colour, size)


class ImageFrame(Entity):
    """A framed picture on a wall, facing ``dir``; ``aspect`` is the picture's height over its width."""

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
    """A line of letters and digits on a wall, facing ``dir``, each as wide as it is high."""

    static = True
    looks = ("text", "variants")

    def __init__(self, pos: Position, dir: float, text: str, *, height: float = 0.15, depth: float = 0.05) -> None:
        super().__init__()
        if not all(letter == " " or (letter.isascii() and letter.isalnum()) for letter in text):
            raise WorldError(
                f"the sign {text!r} has a character we cannot draw; letters A to Z, digits and spaces can be"
            )
        self.pos = pos
        self.dir = dir
        self.text = text
        self.depth = depth
        self.height = height
        self.width = len(text) * height
        self.name = f"sign {text}"
        self.variants: tuple[int, ...] = (0,) * len(text)  # which picture of each character

    @property
    def textures(self) -> list[str | None]:
        """The texture of each character, None for a space."""
        return [None if letter == " " else f"chars/ch_0x{ord(letter)}" for letter in self.text]

    def randomise(self, parameters: Parameters, rng: np.random.Generator | None) -> None:
        """Draw a picture for each character."""
        self.variants = tuple(
            0 if rng is None or texture is None else int(rng.integers(texture_variants(texture)))
            for texture in self.textures
        )
