"""The six colours that objects have in every world, with Minigrid's names and numbers.

The module also has their RGB values for each palette, as first-person worlds and plots draw them.
"""

from typing import Literal, get_args

from minihuman.errors import WorldError
from minihuman.worlds.contract import Palette

Colour = Literal["red", "green", "blue", "purple", "yellow", "grey"]
COLOURS: tuple[Colour, ...] = get_args(Colour)

Rgb = tuple[float, float, float]  # red, green, blue, 0 to 1

RGB_BY_COLOUR: dict[str, Rgb] = {  # sorted by name: worlds draw a colour by its place here
    "blue": (0.0, 0.0, 1.0),
    "green": (0.0, 1.0, 0.0),
    "grey": (0.39, 0.39, 0.39),
    "purple": (0.44, 0.15, 0.76),
    "red": (1.0, 0.0, 0.0),
    "yellow": (1.0, 1.0, 0.0),
}
COLOUR_NAMES = tuple(RGB_BY_COLOUR)

# Okabe and Ito's palette, told apart by people with any common colour blindness.
_COLOUR_SAFE: dict[str, Rgb] = {
    "blue": (0.0, 0.447, 0.698),
    "green": (0.0, 0.62, 0.451),
    "grey": (0.39, 0.39, 0.39),
    "purple": (0.8, 0.475, 0.655),
    "red": (0.835, 0.369, 0.0),
    "yellow": (0.941, 0.894, 0.259),
}


def check_colour(name: str) -> str:
    """Check that a colour exists, and return its name.

    Raises:
        WorldError: if there is no colour of this name.
    """
    if name not in RGB_BY_COLOUR:
        raise WorldError(f"unknown colour {name!r}; use one of {', '.join(RGB_BY_COLOUR)}")
    return name


def rgb_of(name: str, palette: Palette = "classic") -> Rgb:
    """Return the red, green and blue components of a colour, each from 0 to 1."""
    return (RGB_BY_COLOUR if palette == "classic" else _COLOUR_SAFE)[name]


def hex_colour(colour: Rgb) -> str:
    """Return the colour as "#rrggbb"."""
    red, green, blue = (round(255 * part) for part in colour)
    return f"#{red:02x}{green:02x}{blue:02x}"
