"""Batches of grid worlds whose observations are pictures: tiles, or the agent's first-person view in 3D.

The states are stepped together in one kernel; the pictures are drawn one after another.
"""

from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode, VectorObservationWrapper
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.grid.batch import GridBatch, Observation
from minihuman.worlds.grid.batch_names import GridBatchSnapshot
from minihuman.worlds.grid.engine import GridEngine
from minihuman.worlds.options import check_one_of, check_whole

Draw = Callable[[GridEngine, int], NDArray[np.uint8]]  # draws a world, whose number in the batch is the int


class PictureBatch(VectorObservationWrapper):
    """A batch whose observation's "image" contains a picture of each world, uint8[n, H, W, 3].

    Args:
        batch: the batch of worlds
        draw: a function that draws one of the worlds
        shape: the height and width of the pictures, and 3
    """

    def __init__(self, batch: GridBatch, draw: Draw, shape: tuple[int, int, int]) -> None:
        if batch.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP:
            raise WorldError(
                "a batch of pictures does not draw what was last seen of an episode; use autoreset_mode 'NextStep' or "
                "'Disabled', or vectorization_mode='sync'"
            )
        super().__init__(batch)
        self._batch = batch
        self._draw = draw
        image = gymnasium.spaces.Box(0, 255, shape, np.uint8)
        self.single_observation_space = gymnasium.spaces.Dict(
            {**batch.single_observation_space.spaces, "image": image}  # type: ignore[attr-defined]
        )
        self.observation_space = batch_space(self.single_observation_space, batch.num_envs)

    def get_attr(self, name: str) -> tuple[Any, ...]:
        """Return an attribute of each world, as `GridBatch.get_attr`."""
        return self._batch.get_attr(name)

    def call(self, name: str, *args: Any, **kwargs: Any) -> tuple[Any, ...]:
        """Call a method of each world, as `GridBatch.call`."""
        return self._batch.call(name, *args, **kwargs)

    def set_attr(self, name: str, values: Any) -> None:
        """Set an attribute of each world, as `GridBatch.set_attr`."""
        self._batch.set_attr(name, values)

    def save(self) -> GridBatchSnapshot:
        """Return an exact copy of the state of every world, as `GridBatch.save`."""
        return self._batch.save()

    def restore(self, saved: GridBatchSnapshot) -> None:
        """Restore a saved state, as `GridBatch.restore`."""
        self._batch.restore(saved)

    def observations(self, observations: Observation) -> Observation:
        """Return the observations with a picture of each world as "image"."""
        worlds = enumerate(self._batch.worlds_in_turn())
        return {**observations, "image": np.stack([self._draw(world, i) for i, world in worlds])}


def make_grid_batch(
    family: str, *, view: str = "grid", pixels: str | None = None, tile_px: int = 8, **options: Any
) -> GridBatch | PictureBatch:
    """Make a batch of a family's worlds, for ``gymnasium.make_vec``.

    Args:
        family: one of ``env.FAMILIES``, or a level
        view: "grid", or "first_person" for pictures of the agent's view from inside
        pixels: "partial" for pictures of the agent's view in tiles, "full" for those of the whole world, or None
        tile_px: the width and height of a tile in pixels
        options: the keyword arguments of `GridBatch` and, for a first-person view, ``obs_width`` and ``obs_height``

    Raises:
        WorldError: if ``view`` or ``pixels`` has another value.
    """
    check_one_of("view", view, ("grid", "first_person"))
    check_one_of("pixels", pixels, (None, "partial", "full"))
    if view == "first_person":
        return _make_first_person_batch(family, options)
    batch = GridBatch(family, **options)
    if pixels is None:
        return batch
    check_whole("tile_px", tile_px, 1, 256)
    first = next(batch.worlds_in_turn())
    columns, rows = first.image_shape[:2] if pixels == "partial" else (first.width, first.height)

    def draw(world: GridEngine, i: int) -> NDArray[np.uint8]:
        return world.frame(view="partial" if pixels == "partial" else "full", tile_px=tile_px)

    return PictureBatch(batch, draw, (rows * tile_px, columns * tile_px, 3))


def _make_first_person_batch(family: str, options: dict[str, Any]) -> PictureBatch:
    """Make a batch whose pictures are the agents' views from inside."""
    from minihuman.worlds.inside.env import GridFromInside  # here, as the renderer takes a second to load

    size = {name: options.pop(name) for name in ("obs_width", "obs_height") if name in options}
    batch = GridBatch(family, **options)
    first = next(batch.worlds_in_turn())
    views = [GridFromInside(first, **size) for _ in range(batch.num_envs)]  # each keeps the scene of its world
    width, height = views[0].size_px

    def draw(world: GridEngine, i: int) -> NDArray[np.uint8]:
        return views[i].picture(size_px=(width, height))

    return PictureBatch(batch, draw, (height, width, 3))
