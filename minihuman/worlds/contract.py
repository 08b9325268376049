"""What every world of ours offers on ``env.unwrapped``, beside Gymnasium's own five-tuple API."""

import abc
from collections.abc import Callable
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.pose import Map, Pose

View = Literal["partial", "full"]
Palette = Literal["classic", "colour-safe"]


class NativeWorld(abc.ABC):
    """A world that knows its pose, its map and its exact state. Mixed into a ``gymnasium.Env``."""

    action_names: tuple[str, ...]  # one a discrete action, snake case: "left", "move_forward"
    # Where compiling takes long, calls that each compile a piece of it, so that processes can share them.
    compile_apart: ClassVar[tuple[Callable[[], None], ...]] = ()

    @abc.abstractmethod
    def pose(self) -> Pose:
        """The agent's pose now."""

    @abc.abstractmethod
    def map(self) -> Map:
        """The floor plan with the things where they stand now."""

    @abc.abstractmethod
    def state_hash(self) -> int:
        """A uint64 over everything that decides the future: equal states, equal hashes, on every machine."""

    @abc.abstractmethod
    def save(self) -> Any:
        """An exact, picklable copy of the state in mid-episode, random streams included."""

    @abc.abstractmethod
    def restore(self, saved: Any) -> None:
        """Go back to a saved state; the copy is not consumed and may be restored again."""

    @abc.abstractmethod
    def picture(
        self, *, view: View = "partial", size_px: tuple[int, int] = (640, 480), palette: Palette = "classic"
    ) -> NDArray[np.uint8]:
        """The picture a person sees, uint8[H, W, 3], drawn natively at most ``size_px`` (width, height) large.

        ``partial`` is what the agent sees, ``full`` the whole world from above. The grid answers with the largest
        whole-numbered tile size that fits; 3D fills the size. Drawing changes no state.
        """
