"""Episodes that the page computes: the states and tiles that it needs, and its steps compared with the session's.

The page runs the kernels that the session's world runs, compiled to WebAssembly, so that a key is stepped and drawn
where the participant is. The session's step decides: each key brings the digest of the page's step, and where it is not
the session's own, that is noted, and the page gets the session's state. No I/O.
"""

import hashlib
import zlib
from collections.abc import Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from minihuman.experiment.machine.events import Event, Stepped
from minihuman.experiment.machine.running_episode import RunningEpisode
from minihuman.web.messages import AtlasMessage, GridState, KeyMessage
from minihuman.worlds.adapters.world import StepResult, World
from minihuman.worlds.grid.core.digest import digest_step
from minihuman.worlds.grid.engine import GridEngine
from minihuman.worlds.grid.pictures.drawing import atlas
from minihuman.worlds.grid.pictures.tiles import GridPalette
from minihuman.worlds.source_digest import module_digest

if TYPE_CHECKING:
    from minihuman.worlds.grid.object_kinds import ObjectKind

TERMINATED, TRUNCATED = 1, 2  # in a digest


def kernels_digest() -> str:
    """The digest of the rules here: a page whose modules were built from others does not compute."""
    return module_digest("minihuman.worlds.build.exports") or ""


class PageWorld(World):
    """A world that a page may compute too: it keeps what its last step led to, which a digest is over."""

    def __init__(self, world_id: str, options: dict[str, Any] | None = None) -> None:
        super().__init__(world_id, options)
        self._keeps_steps = self.is_compiled
        self._stepped: tuple[NDArray[np.int32], NDArray[np.uint8]] | None = None

    def step(self, action: int) -> StepResult:
        """Do an action, as any world does."""
        result = super().step(action)
        if self._keeps_steps:  # a copy: an episode that has ended gives its world to the next one
            self._stepped = self.unwrapped.state.row.copy(), self.observation["image"]
        return result

    def digest(self, reward: float, *, terminated: bool, truncated: bool) -> str:
        """The digest of the last step and what came of it in the episode, 16 hexadecimal digits."""
        assert self._stepped is not None
        ends = TERMINATED if terminated else TRUNCATED if truncated else 0
        outcome = np.array([np.float64(reward).view(np.uint64), ends], np.uint64)
        return f"{int(digest_step(*self._stepped, outcome)):016x}"


class ComputedEpisode:
    """An episode that the page computes.

    Args:
        play: the session's own, in a `PageWorld` that is compiled.
        picture_px: the largest picture wanted, width and height.
    """

    def __init__(self, play: RunningEpisode, picture_px: tuple[int, int]) -> None:
        assert isinstance(play.world, PageWorld)
        self.is_elsewhere = False  # the page is, or may be
        self.sent_step = -1  # of the state that was sent last
        self._play, self._world = play, play.world
        self._differs = False  # since the last step that was the same
        env: GridEngine = play.world.unwrapped
        tile_px, palette = env.tiles(play.plan.view, picture_px, play.plan.palette)
        self.atlas = pack_atlas(tile_px, palette, env.kinds)
        self._in_view = palette == "minigrid"

    def state(self) -> GridState:
        """Where the session is."""
        env: GridEngine = self._world.unwrapped
        saved = env.save()
        self.is_elsewhere, self.sent_step = False, self._play.steps
        return GridState(
            step=self._play.steps,
            row=_run_lengths(saved.row),
            rng_state=[str(word) for word in saved.rng_state.tolist()],
            view_size=env.image_shape[0],
            full=self._play.plan.view == "full",
            in_view=self._in_view,
            atlas=self.atlas.name,
        )

    def compare(self, message: KeyMessage, events: Sequence[Event]) -> str:
        """Compare a key's step in the page with the session's; how they differ, "" if that is known or they do not."""
        stepped = next((event for event in events if isinstance(event, Stepped)), None)
        own = "" if stepped is None else self._digest(stepped)
        if message.digest == own:
            self._differs = self._differs and not own
            return ""
        self.is_elsewhere = True
        if not message.digest or self._differs:
            return ""
        self._differs = True
        if stepped is None:
            return f"key {message.key} made a step of episode {self._play.plan.episode + 1} in the page, and none here"
        where = f"step {stepped.step} of episode {stepped.episode + 1}"
        return f"{where} was computed otherwise in the page: its digest is {message.digest}, here it is {own}"

    def _digest(self, stepped: Stepped) -> str:
        return self._world.digest(stepped.reward, terminated=stepped.terminated, truncated=stepped.truncated)


def _run_lengths(row: NDArray[np.int32]) -> list[int]:
    starts = np.concatenate(([0], np.flatnonzero(np.diff(row)) + 1))
    lengths = np.diff(np.concatenate((starts, [len(row)])))
    runs: list[int] = np.stack((row[starts], lengths), axis=1).ravel().tolist()
    return runs


@lru_cache(maxsize=16)
def pack_atlas(tile_px: int, palette: GridPalette, kinds: "tuple[ObjectKind, ...]" = ()) -> AtlasMessage:
    """Draw the tiles of a size and palette once, and pack them for pages."""
    drawn = atlas(tile_px, palette, kinds)
    arrays = [array.tobytes() for array in (drawn.number, drawn.under, drawn.tiles, drawn.agents, drawn.carried)]
    content = b"".join(arrays)
    name = hashlib.sha256(content).hexdigest()[:16]
    return AtlasMessage(name, tile_px, drawn.carried.shape[1], [len(each) for each in arrays], zlib.compress(content))
