"""A policy's observations: a picture or a grid's codes, channels first, and the one-hot mission.

This module does not import torch.
"""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from minihuman.errors import LearnError
from minihuman.worlds.colours import COLOURS
from minihuman.worlds.go_to_obj import KINDS
from minihuman.worlds.grid.core.cells import colour_of, kind_of, state_of
from minihuman.worlds.grid.core.state import CARRYING, STEP
from minihuman.worlds.grid.engine import GridEngine
from minihuman.worlds.grid.team_grid import TeamGrid

Observation = dict[str, NDArray[Any]]
Scaling = Literal["spread", "raw"]
ViewMode = Literal["view", "whole", "remembered"]
REACH = 6  # cells that are remembered on each side of the agent

# Factors that spread the object, colour and state codes of a grid cell, at most 10, 5 and 2, over 0 to 255, so that
# they differ as much as a picture's colours. "raw" leaves codes in the darkest 4 %, as in the published agent.
SPREAD = (25, 51, 127)
_CHANNELS = 3  # red, green and blue, or a cell's object, colour and state
_QUARTER_TURNS = (3, 2, 1, 0)  # by the agent's direction: the turns that bring the cells ahead of it to the top


def encode_mission(mission: str) -> NDArray[np.float32]:
    """Return a mission such as "go to the red ball" as one-hot float32[9]: six colours, then three kinds of object.

    Raises:
        LearnError: if the mission does not name exactly one known colour and one known kind of object.
    """
    words = mission.lower().split()
    numbers = np.zeros(len(COLOURS) + len(KINDS), dtype=np.float32)
    for offset, vocabulary in ((0, COLOURS), (len(COLOURS), KINDS)):
        indices = [vocabulary.index(word) for word in words if word in vocabulary]
        if len(indices) != 1:
            raise LearnError(
                f"mission {mission!r} contains {len(indices)} of the words {', '.join(vocabulary)}; it must contain "
                "exactly one"
            )
        numbers[offset + indices[0]] = 1
    return numbers


@dataclass(frozen=True, slots=True)
class ObservationEncoder:
    """The settings by which a world's observations are encoded for a policy."""

    missions: bool  # whether the mission differs between episodes and is observed
    scaling: Scaling = "spread"  # of grid codes; pictures are left as they are
    # "view": the world's own observation. "whole": the whole grid from above, turned so that the agent faces up.
    # "remembered": the same, but only cells within REACH of the agent that have been in view in this episode.
    sight: ViewMode = "view"

    def space(self, world: Any) -> spaces.Dict:
        """Return the policy's observation space in a world.

        Raises:
            LearnError: if the world has no image, or is not a grid although the sight is the whole grid.
        """
        image = make_image_space(self._image_shape(world))
        if not self.missions:
            return spaces.Dict({"image": image})
        return spaces.Dict({"image": image, "mission": spaces.Box(0, 1, (len(COLOURS) + len(KINDS),), np.float32)})

    def episode_encoder(self) -> "EpisodeEncoder":
        """Return an encoder for the episodes of one agent, which can remember cells."""
        return EpisodeEncoder(self)

    def encode(self, world: Any, raw: Any, remembered: NDArray[np.bool_] | None = None) -> Observation:
        """Encode one observation for the network; use an `episode_encoder` if cells are remembered.

        Args:
            world: the world that is observed
            raw: the world's own observation
            remembered: for each cell whether it was in view before, indexed by x * height + y; needed only for the
                sight "remembered"
        """
        if self.sight == "remembered":
            assert remembered is not None, "an EpisodeEncoder passes the remembered cells"
            image = encode_remembered_grid(world, remembered)
        elif self.sight == "whole":
            image = encode_whole_grid(world)
        elif isinstance(raw, dict):
            image = raw["image"]
        else:
            image = raw
        if image.ndim == 1:
            image = image[None, None]  # a vector is a picture of one cell with many channels
        if self.spreads(world, raw):
            image = image * np.array(SPREAD, np.uint8)
        observation: Observation = {"image": np.ascontiguousarray(np.moveaxis(image, -1, 0))}
        if self.missions:
            observation["mission"] = encode_mission(world.mission)
        return observation

    def spreads(self, world: Any, raw: Any) -> bool:
        """Return whether these settings spread the codes of a world's observation ``raw``; False without codes."""
        has_codes = isinstance(raw, dict) or isinstance(getattr(world, "team", None), TeamGrid)
        return has_codes and self.scaling == "spread"

    def _image_shape(self, world: Any) -> tuple[int, int, int]:
        """Return the shape of the encoded image in a world as channels, height and width.

        Raises:
            LearnError: if the world has no image, or is not a grid although the sight is the whole grid.
        """
        if self.sight != "view":
            if not isinstance(world, GridEngine):
                raise LearnError(
                    f"{world} is not a minihuman grid world, which --sight {self.sight} needs; use --sight view"
                )
            side = 2 * max(world.state.width, world.state.height) - 1
            if self.sight == "remembered":
                side = min(side, 2 * REACH + 1)
            return _CHANNELS, side, side
        world_space = world.observation_space
        if isinstance(world_space, spaces.Dict) and "image" in world_space.spaces:
            picture = world_space["image"]
        else:
            picture = world_space
        shape = picture.shape if isinstance(picture, spaces.Box) else ()
        if isinstance(picture, spaces.Box) and len(shape) == 1 and picture.dtype == np.float32:
            return shape[0], 1, 1
        has_planes = hasattr(world, "team")  # such as a kitchen's, with any number of channels
        has_channels = len(shape) == 3 and (shape[-1] == _CHANNELS or has_planes)
        if not has_channels:
            raise LearnError(
                f"{world} has the observation space {world_space}; choose a world whose observations contain an image "
                "with three channels, or are one vector of float32"
            )
        height, width, channels = shape
        return channels, height, width


def make_image_space(shape: tuple[int, int, int]) -> spaces.Box:
    """Return the space of images of a shape (channels, height, width).

    Images are uint8, 0 to 255; an image of one pixel stands for a vector of float32 without bounds.
    """
    if shape[1:] == (1, 1):
        return spaces.Box(-np.inf, np.inf, shape, np.float32)
    return spaces.Box(0, 255, shape, np.uint8)


def get_image_shape(space: spaces.Dict) -> tuple[int, int, int]:
    """Return the channels, height and width of the image in an observation space."""
    shape = space["image"].shape
    assert shape is not None
    return shape[0], shape[1], shape[2]


class EpisodeEncoder:
    """An encoder for the observations of one agent, which remembers cells during an episode if its settings ask for it.

    Call `encode` once per step. An episode begins when the world has made no step yet.
    """

    def __init__(self, eyesight: ObservationEncoder) -> None:
        self._eyesight = eyesight
        self._memory: Any = None

    def encode(self, world: Any, raw: Any) -> Observation:
        """Encode the world's present observation ``raw``.

        Raises:
            LearnError: if the mission is observed but names no known colour or object.
        """
        if self._eyesight.sight != "remembered":
            return self._eyesight.encode(world, raw)
        row = world.state.row
        if self._memory is None or row[STEP] == 0:
            from minihuman.worlds.grid.belief_state import ExploredGrid  # compiled: only where it is used

            self._memory = ExploredGrid(row, world.image_shape[0])
        self._memory.look(row)
        return self._eyesight.encode(world, raw, self._memory.seen)

    def save(self) -> NDArray[np.bool_] | None:
        """Return a copy of the remembered cells; None if no cells are remembered."""
        if self._memory is None:
            return None
        cells: NDArray[np.bool_] = self._memory.seen.copy()
        return cells

    def restore(self, saved: NDArray[np.bool_] | None) -> None:
        """Restore the remembered cells that `save` returned in the same episode."""
        if saved is not None:
            self._memory.seen[:] = saved


def encode_whole_grid(world: GridEngine) -> NDArray[np.uint8]:
    """Return the codes of a whole grid, centred on the agent and turned so that the agent faces up.

    The array is uint8[2 n - 1, 2 n - 1, 3], where n is the longer side of the grid. It is indexed [x, y], like
    Minigrid's views, and is 0 (unseen) outside the grid.
    """
    return _cut_surroundings(world, max(world.state.width, world.state.height) - 1, _codes(world.state.cells))


def encode_remembered_grid(world: GridEngine, explored_cells: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Return the codes of the cells that were seen, up to ``REACH`` cells from the agent on each side.

    The array is centred and turned like that of `encode_whole_grid`. The agent's cell shows the object it carries.

    Args:
        world: the world.
        explored_cells: for each cell whether it was seen, indexed by x * height + y.
    """
    state = world.state
    codes = _codes(state.cells) * explored_cells.reshape(state.width, state.height, 1)
    codes[state.position] = _codes(state.row[CARRYING])
    return _cut_surroundings(world, min(REACH, max(state.width, state.height) - 1), codes)


def _codes(cells: Any) -> NDArray[np.uint8]:
    """Return the kind, colour and state of packed cells as uint8[..., 3]."""
    return np.stack((kind_of(cells), colour_of(cells), state_of(cells)), axis=-1).astype(np.uint8)


def _cut_surroundings(world: GridEngine, reach: int, codes: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the codes of the cells around the agent, turned so that it faces up; cells outside the grid are 0.

    Args:
        world: the world.
        reach: the number of cells on each side of the agent.
        codes: the codes of all cells, uint8[width, height, 3].
    """
    state = world.state
    canvas = np.zeros((state.width + 2 * reach, state.height + 2 * reach, 3), np.uint8)
    canvas[reach : reach + state.width, reach : reach + state.height] = codes
    side = 2 * reach + 1
    x, y = state.position
    surroundings = canvas[x : x + side, y : y + side]
    return np.rot90(surroundings, _QUARTER_TURNS[state.direction])
