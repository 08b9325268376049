"""What every world of ours offers on ``env.unwrapped``, beside Gymnasium's own five-tuple API."""

import abc
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from minihuman.worlds.pose import Map, Pose

View = Literal["partial", "full"]
Palette = Literal["classic", "colour-safe"]


@dataclass(frozen=True, slots=True)
class Bounds:
    """How many steps success takes from here; None where nobody can tell.

    No way is shorter than ``at_least``; a way of ``feasible`` steps is known. In the grid they are equal.
    """

    at_least: int | None = None
    feasible: int | None = None


UNKNOWN = Bounds()


PICTURES = 2  # goes up when first-person worlds are drawn otherwise; a log says by which its pictures were
CLAUSES = 2  # goes up when more worlds tell what is done of their instruction; a log says by which it was recorded


class NativeWorld(abc.ABC):
    """A world that knows its pose, its map and its exact state. Mixed into a ``gymnasium.Env``."""

    drawn: ClassVar[bool] = False  # whether observations are pictures that a later version may draw otherwise

    action_names: tuple[str, ...]  # one a discrete action, snake case: "left", "move_forward"
    # Where compiling takes long, calls that each compile a piece of it, so that processes can share them.
    compile_apart: ClassVar[tuple[Callable[[], None], ...]] = ()

    def __init_subclass__(cls, **kwargs: Any) -> None:
        """What leads to success, and how soon, is known of a world's own rules: with new ones it is known no more.

        So a class that judges, steps or advances anew, and gives no `way` or no `bounds`, has none.
        """
        super().__init_subclass__(**kwargs)
        if {"judge", "step", "advance"} & vars(cls).keys():
            for name in {"way", "bounds"} - vars(cls).keys():
                setattr(cls, name, vars(NativeWorld)[name])

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
    def scene_hash(self) -> int:
        """A uint64 over the same but the number of steps taken: what two ways that meet have in common."""

    @abc.abstractmethod
    def advance(self, action: int) -> tuple[float, bool, bool]:
        """A step without its observation: reward, terminated, truncated.

        Raises:
            WorldError: as ``step``.
        """

    def clauses(self) -> tuple[tuple[str, int], ...]:
        """What the episode's instruction says, clause by clause, each with the step that did it; 0 for none yet."""
        return ()

    def way(self) -> Sequence[int] | None:
        """Actions that lead to success from here, turns counted; empty if there are none, None if it cannot tell.

        Raises:
            WorldError: if it would take too long to tell.
        """
        return None

    def bounds(self) -> Bounds:
        """How many steps success takes from here."""
        return Bounds(feasible=len(self.way() or ()) or None)

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
