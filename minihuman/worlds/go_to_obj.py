"""The part of GoToObj that its grid and first-person versions share: four objects, of which one is the target.

The objects are at the middles of the four walls. The pair of worlds is the transfer experiment of "Minigrid &
Miniworld" (Chevalier-Boisvert et al., 2023). The same seed gives the same objects at the same walls, and the same
mission, in both worlds.
"""

from dataclasses import dataclass

import numpy as np

from minihuman.worlds.colours import COLOURS as COLOURS

KINDS = ("ball", "box", "key")
WALLS = ("left", "bottom", "right", "top")  # the order in which objects are listed


@dataclass(frozen=True, slots=True)
class Arrangement:
    """Four objects as (colour, kind), one per wall in the order of ``WALLS``, and the index of the target."""

    objects: tuple[tuple[str, str], ...]
    target: int

    @property
    def mission(self) -> str:
        """Return the instruction, such as "go to the red ball"."""
        colour, kind = self.objects[self.target]
        return f"go to the {colour} {kind}"

    @property
    def matches(self) -> int:
        """Return the number of objects that the mission describes: 1 unless the mission is ambiguous."""
        return self.objects.count(self.objects[self.target])


def draw_arrangement(rng: np.random.Generator, *, ambiguous: bool = False) -> Arrangement:
    """Draw an arrangement of four objects in four different colours, so that the mission describes only one of them.

    With ``ambiguous``, each colour and kind is drawn independently, as in the published grid; 15.8 % of missions then
    describe a second object too.
    """
    if ambiguous:
        colour_numbers = rng.integers(len(COLOURS), size=4)
    else:
        colour_numbers = rng.permutation(len(COLOURS))[:4]
    colours = colour_numbers.tolist()
    kinds = rng.integers(len(KINDS), size=4).tolist()
    objects = tuple((COLOURS[colour], KINDS[kind]) for colour, kind in zip(colours, kinds, strict=True))
    return Arrangement(objects, int(rng.integers(4)))
