"""GoToObj, what its grid and its 3D world share: four objects at the middles of the walls, one of them the target.

The pair is the transfer experiment of "Minigrid & Miniworld" (Chevalier-Boisvert et al., 2023). The same seed lays out
the same objects at the same walls, with the same mission, in both worlds.
"""

from dataclasses import dataclass

import numpy as np

from minihuman.worlds.colours import COLOURS as COLOURS

KINDS = ("ball", "box", "key")
WALLS = ("left", "bottom", "right", "top")  # the order in which objects are listed


@dataclass(frozen=True, slots=True)
class Arrangement:
    """Four (colour, kind), one per wall in the order of ``WALLS``, and which of them is the target."""

    objects: tuple[tuple[str, str], ...]
    target: int

    @property
    def mission(self) -> str:
        """Return what to do, in words."""
        colour, kind = self.objects[self.target]
        return f"go to the {colour} {kind}"

    @property
    def matches(self) -> int:
        """Return how many of the objects the mission fits: 1 unless it is ambiguous."""
        return self.objects.count(self.objects[self.target])


def draw_arrangement(rng: np.random.Generator, *, ambiguous: bool = False) -> Arrangement:
    """Draw an arrangement: four different colours, so that a mission fits one object only.

    ``ambiguous`` draws each colour and kind on its own, as the published grid did: 15.8 % of missions then fit a
    second object.
    """
    if ambiguous:
        colour_numbers = rng.integers(len(COLOURS), size=4)
    else:
        colour_numbers = rng.permutation(len(COLOURS))[:4]
    colours = colour_numbers.tolist()
    kinds = rng.integers(len(KINDS), size=4).tolist()
    objects = tuple((COLOURS[colour], KINDS[kind]) for colour, kind in zip(colours, kinds, strict=True))
    return Arrangement(objects, int(rng.integers(4)))
