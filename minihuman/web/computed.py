"""Episodes that the page computes: the states and arrays that the page needs, and the comparison of its steps.

The page runs the same kernels as the session's world, compiled to WebAssembly, so that each key is stepped and drawn in
the participant's browser. The session's step is authoritative: each key message carries the digest of the page's step.
If that digest differs from the session's, the difference is noted and the page is sent the session's state. No I/O.
"""

import hashlib
import zlib
from collections.abc import Mapping
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from minihuman.experiment.machine.events import Stepped
from minihuman.experiment.machine.running_episode import RunningEpisode
from minihuman.experiment.plan.session_plan import EpisodePlan
from minihuman.web.messages import (
    ArraysMessage,
    FirstPersonPosition,
    FirstPersonState,
    GridPosition,
    GridState,
    KeyMessage,
    TickMessage,
    WorldPosition,
    WorldState,
)
from minihuman.worlds.adapters.page_world import PageWorld as PageWorld
from minihuman.worlds.first_person.page_scene import PageLook, describe, locate
from minihuman.worlds.grid.engine import GridEngine
from minihuman.worlds.grid.pictures.drawing import atlas
from minihuman.worlds.grid.pictures.tiles import GridPalette

if TYPE_CHECKING:
    from minihuman.worlds.first_person.env import FirstPersonEnv
    from minihuman.worlds.grid.object_kinds import ObjectKind

MOST_UNKNOWN = 50  # consecutive steps without a digest, as after a reload without a network


def can_compute(play: RunningEpisode) -> bool:
    """Return whether a page can compute an episode: compiled kernels alone must step its world and draw its view."""
    world = play.world
    if not isinstance(world, PageWorld) or not world.is_compiled:
        return False
    return isinstance(world.unwrapped, GridEngine) or play.plan.view != "full"


class ComputedEpisode:
    """An episode that the page computes.

    Args:
        play: the session's running episode, in a compiled `PageWorld`.
        picture_px: the largest picture wanted, as width and height.
    """

    def __init__(self, play: RunningEpisode, picture_px: tuple[int, int]) -> None:
        assert isinstance(play.world, PageWorld)
        self.play = play
        self.is_elsewhere = False  # whether the page's state differs, or may differ, from the session's
        self.sent_step = -1  # the step of the state that was sent last
        self._world = play.world
        self._world.keep_steps()
        self._env = play.world.unwrapped
        self._differs = False  # whether a step has differed since the last equal one
        self._n_unknown = 0  # steps without a digest since the last equal one
        describe_world: Any = _describe_first_person
        if isinstance(self._env, GridEngine):
            describe_world = _describe_grid
        self._fixed, self.arrays, self._look = describe_world(self._env, play.plan, picture_px)

    def state(self) -> WorldState:
        """Return the session's world state, to be sent to a page that has the episode's ``arrays``.

        The page is then taken to be at the session's step.
        """
        state: WorldState = msgspec.structs.replace(self._fixed, **msgspec.structs.asdict(self.position()))
        return state

    def position(self) -> WorldPosition:
        """Return the session's position, to be sent to a page that has an earlier state of the episode.

        The page is then taken to be at the session's step.
        """
        self.is_elsewhere = False
        self.sent_step = self.play.steps
        if self._look is None:
            saved = self._env.save()
            row = _encode_run_lengths(saved.row)
            return GridPosition(self.play.steps, row, list(map(str, saved.rng_state.tolist())))
        things, numbers, rng_state = locate(self._env, self._look)
        return FirstPersonPosition(
            self.play.steps, things.tobytes(), numbers.tobytes(), list(map(str, rng_state.tolist()))
        )

    def compare(self, message: KeyMessage | TickMessage, stepped: Stepped | None) -> str:
        """Compare the page's step for a message with the session's.

        Args:
            message: the page's message, with the digest of the page's step, if it made one.
            stepped: the session's step for the message; None if it made none.

        Returns:
            A description of the difference if the steps differ and the last compared ones did not; otherwise "".
        """
        digest = ""
        if stepped is not None:
            digest = self._world.digest(stepped.reward, terminated=stepped.terminated, truncated=stepped.truncated)
        if message.digest == digest:
            if digest:
                self._differs = False
                self._n_unknown = 0
            return ""
        self.is_elsewhere = True
        if not message.digest:
            self._n_unknown += 1
            if self._n_unknown == MOST_UNKNOWN:
                return f"the page said nothing of {MOST_UNKNOWN} steps in a row that it was to compute"
            return ""
        if self._differs:
            return ""
        self._differs = True
        if stepped is None:
            cause = "time"
            if isinstance(message, KeyMessage):
                cause = f"key {message.key}"
            return f"{cause} made a step of episode {self.play.plan.episode + 1} in the page, and none here"
        step_name = f"step {stepped.step} of episode {stepped.episode + 1}"
        return f"{step_name} was computed otherwise in the page: its digest is {message.digest}, here it is {digest}"


def _describe_grid(
    env: GridEngine, plan: EpisodePlan, picture_px: tuple[int, int]
) -> tuple[WorldState, list[ArraysMessage], None]:
    """Describe a grid world to a page; ``picture_px`` is the largest picture wanted, as width and height.

    Returns:
        The world's state with empty fields in place of those that steps change, the arrays that the page needs, and
        None, since only a first-person world has a look.
    """
    assert plan.view != "text", "no page computes it"
    tile_px, palette = env.tiles(plan.view, picture_px, plan.palette)
    tiles = pack_atlas(tile_px, palette, env.kinds)
    state = GridState(
        step=0,
        row=[],
        rng_state=[],
        view_size=env.image_shape[0],
        full=plan.view == "full",
        in_view=palette == "minigrid",
        atlas=tiles.name,
    )
    return state, [tiles], None


def _describe_first_person(
    env: "FirstPersonEnv", plan: EpisodePlan, picture_px: tuple[int, int]
) -> tuple[WorldState, list[ArraysMessage], PageLook]:
    """Describe a first-person world to a page; ``picture_px`` is the size of its picture, as width and height.

    Returns:
        The world's state with empty fields in place of those that steps change, the arrays that the page needs, and
        the world's look, with which later positions are found.
    """
    state, scene, look = describe(env, plan.palette, picture_px)
    tables = pack_arrays(scene.tables)
    textures = [_pack_texture(pixels.tobytes()) for pixels in scene.textures]
    fixed = FirstPersonState(
        step=0,
        things=b"",
        numbers=b"",
        rng_state=[],
        walls=state.walls.tobytes(),
        rooms=state.rooms.tobytes(),
        edges=state.edges.tobytes(),
        looks=state.looks,
        scene=tables.name,
        textures=[texture.name for texture in textures],
        size=picture_px,
        n_actions=len(env.kernel_actions),
        uses=list(env.use_actions),
    )
    return fixed, [tables, *textures], look


def _encode_run_lengths(row: NDArray[np.int32]) -> list[int]:
    """Encode a row as run lengths: each number is followed by the number of times that it occurs in succession."""
    starts = np.concatenate(([0], np.flatnonzero(np.diff(row)) + 1))
    runs: list[int] = np.stack((row[starts], np.diff(starts, append=len(row))), axis=1).ravel().tolist()
    return runs


@lru_cache(maxsize=16)
def pack_atlas(tile_px: int, palette: GridPalette, kinds: "tuple[ObjectKind, ...]" = ()) -> ArraysMessage:
    """Pack the pictures of a grid world's tiles for pages; the result is cached.

    Args:
        tile_px: the width and height of a tile, in pixels.
        palette: the palette in which the tiles are drawn.
        kinds: the world's own kinds of objects; empty if it has none.
    """
    tile_atlas = atlas(tile_px, palette, kinds)
    names = ("number", "under", "tiles", "agents", "carried")
    sizes = np.array([tile_px, tile_atlas.carried.shape[1]], np.int32)
    arrays = {name: getattr(tile_atlas, name) for name in names}
    return pack_arrays({"px": sizes, **arrays, "tiles": tile_atlas.tiles.view(np.uint8)})


def pack_arrays(arrays: Mapping[str, NDArray[Any]]) -> ArraysMessage:
    """Pack arrays into one message for pages; the message's name is a digest of the arrays' names and contents."""
    entries = [(name, str(array.dtype), array.nbytes) for name, array in arrays.items()]
    content = b"".join(array.tobytes() for array in arrays.values())
    digest = hashlib.sha256(repr(entries).encode() + content).hexdigest()[:16]
    return ArraysMessage(digest, entries, zlib.compress(content))


@lru_cache(maxsize=64)
def _pack_texture(pixels: bytes) -> ArraysMessage:
    return pack_arrays({"pixels": np.frombuffer(pixels, np.uint8)})
