"""Blank pictures, until the renderer's first lands."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.first_person.render.scene import Camera, Scene


class _Layout:
    thing_count = 0

    def __init__(self, looks: Any) -> None:
        self.thing_count = len(looks)


def lay_out(rooms: Any, looks: Any, **light: Any) -> Scene:
    """Nothing."""
    layout: Any = _Layout(looks)
    return Scene(layout, np.zeros((len(looks), 4)), **light)


def render(scene: Scene, camera: Camera, width: int, height: int) -> NDArray[np.uint8]:
    """The sky."""
    return np.broadcast_to((255 * np.array(scene.sky)).astype(np.uint8), (height, width, 3)).copy()


def render_top(scene: Scene, width: int, height: int, *, agent: Any) -> NDArray[np.uint8]:
    """The sky."""
    return np.broadcast_to((255 * np.array(scene.sky)).astype(np.uint8), (height, width, 3)).copy()


def render_depth(scene: Scene, camera: Camera, width: int, height: int) -> NDArray[np.float32]:
    """As far as can be."""
    return np.full((height, width), camera.far_m, np.float32)


def visible_things(scene: Scene, camera: Camera, *size: Any) -> list[int]:
    """Nothing."""
    return []
