"""Shapes as signed distances, so that every edge is smooth at every size.

A shape is an array of distances to its edge in tile widths (negative inside) over a tile's pixel centres; u points
right and v down, both 0 to 1 across the tile.
"""

import numpy as np
from numpy.typing import NDArray

Plane = NDArray[np.float64]  # (px, px)


class Canvas:
    """A tile being painted: colour in floats 0 to 255, and how opaque each pixel is."""

    def __init__(self, size_px: int) -> None:
        centres = (np.arange(size_px) + 0.5) / size_px
        self.size_px = size_px
        self.v, self.u = np.meshgrid(centres, centres, indexing="ij")
        self.rgb = np.zeros((size_px, size_px, 3))
        self.alpha = np.zeros((size_px, size_px))

    def fill(self, shape: Plane, colour: tuple[float, float, float], opacity: float = 1.0) -> None:
        """Lay a colour over the inside of a shape."""
        cover = np.clip(0.5 - shape * self.size_px, 0.0, 1.0) * opacity
        alpha = cover + self.alpha * (1 - cover)
        share = np.divide(cover, alpha, out=np.zeros_like(cover), where=alpha > 0)[..., None]
        self.rgb = self.rgb * (1 - share) + np.asarray(colour) * share
        self.alpha = alpha

    def everywhere(self) -> Plane:
        """The whole tile."""
        return np.full_like(self.u, -1.0)

    def disc(self, u: float, v: float, radius: float) -> Plane:
        """A disc."""
        return np.hypot(self.u - u, self.v - v) - radius

    def box(self, left: float, top: float, right: float, bottom: float, corner: float = 0.0) -> Plane:
        """A rectangle with rounded corners."""
        du = np.abs(self.u - (left + right) / 2) - (right - left) / 2 + corner
        dv = np.abs(self.v - (top + bottom) / 2) - (bottom - top) / 2 + corner
        return np.hypot(np.maximum(du, 0), np.maximum(dv, 0)) + np.minimum(np.maximum(du, dv), 0) - corner

    def bar(self, u0: float, v0: float, u1: float, v1: float, radius: float) -> Plane:
        """A line with round ends."""
        along = np.clip(
            ((self.u - u0) * (u1 - u0) + (self.v - v0) * (v1 - v0)) / ((u1 - u0) ** 2 + (v1 - v0) ** 2), 0, 1
        )
        return np.hypot(self.u - u0 - along * (u1 - u0), self.v - v0 - along * (v1 - v0)) - radius

    def polygon(self, *corners: tuple[float, float], rounding: float = 0.0) -> Plane:
        """A polygon (any, not crossing itself), its corners given in order, grown and rounded by ``rounding``."""
        distance = np.full_like(self.u, np.inf)
        inside = np.zeros(self.u.shape, bool)
        for (u0, v0), (u1, v1) in zip(corners, corners[1:] + corners[:1], strict=True):
            distance = np.minimum(distance, self.bar(u0, v0, u1, v1, 0.0))
            if v0 != v1:
                crosses = (self.v < v0) != (self.v < v1)
                inside ^= crosses & (self.u < u0 + (self.v - v0) / (v1 - v0) * (u1 - u0))
        return np.where(inside, -distance, distance) - rounding
