"""Blank pictures, until the renderer's first lands."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.first_person.render.scene import Camera, Scene


def render(scene: Scene, camera: Camera, width: int, height: int) -> NDArray[np.uint8]:
    """The sky."""
    return np.broadcast_to((255 * np.array(scene.sky)).astype(np.uint8), (height, width, 3)).copy()


def render_top(scene: Scene, width: int, height: int) -> NDArray[np.uint8]:
    """The sky."""
    return np.broadcast_to((255 * np.array(scene.sky)).astype(np.uint8), (height, width, 3)).copy()


def render_depth(scene: Scene, camera: Camera, width: int, height: int) -> NDArray[np.float32]:
    """As far as can be."""
    return np.full((height, width), camera.far_m, np.float32)


def visible_entities(scene: Scene, camera: Camera, *size: Any) -> list[int]:
    """Nothing."""
    return []
