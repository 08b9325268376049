"""The six colours that things of every world have, by name and number: Minigrid's."""

from typing import Literal, get_args

Colour = Literal["red", "green", "blue", "purple", "yellow", "grey"]
COLOURS: tuple[str, ...] = get_args(Colour)
