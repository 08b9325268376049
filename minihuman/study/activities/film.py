"""An episode as pictures: made again from seed and actions, each picture drawn when it is looked at."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import MinihumanError
from minihuman.study.play import NO_PICTURE, world_calls
from minihuman.worlds.contract import Palette, View

if TYPE_CHECKING:
    from minihuman.worlds.adapt.world import World

Picture = NDArray[np.uint8]


class Film(Sequence[Picture]):
    """Pictures of a step and of each one after it, uint8[H, W, 3].

    Args:
        world: one made for the episode; others may use it between two looks.
        seed: of its reset.
        actions: the world's.
        view: how much of the world is seen.
        palette: its colours.
        picture_px: the largest picture wanted, width and height; None draws none.
        first: the step whose picture is the first; 0 is the reset.
    """

    def __init__(
        self,
        world: "World",
        seed: int,
        actions: Sequence[int],
        *,
        view: View,
        palette: Palette,
        picture_px: tuple[int, int] | None,
        first: int = 0,
    ) -> None:
        self._world = world
        self._seed = seed
        self._actions = tuple(actions)
        self._view: View = view
        self._palette: Palette = palette
        self._picture_px = picture_px
        self._first = first
        self._saved: list[Any] = []  # the world at each picture; none where it cannot be saved
        with world_calls():
            self._lead_to(first)
            self.first_hash = world.state_hash()
            self._save()
            for action in self._actions[first:]:
                world.advance(action)
                self._save()
            self.last_hash = world.state_hash()

    def __len__(self) -> int:
        """One more than the steps from the first picture on."""
        return len(self._actions) + 1 - self._first

    @overload
    def __getitem__(self, step: int) -> Picture: ...
    @overload
    def __getitem__(self, step: slice) -> Sequence[Picture]: ...
    def __getitem__(self, step: int | slice) -> Picture | Sequence[Picture]:
        """A picture, drawn now."""
        if isinstance(step, slice):
            return [self[one] for one in range(*step.indices(len(self)))]
        if not -len(self) <= step < len(self):
            raise IndexError(step)
        if self._picture_px is None:
            return NO_PICTURE
        with world_calls():
            self._go_to(step % len(self))
            return self._world.frame(self._view, self._picture_px, self._palette).copy()

    def _go_to(self, step: int) -> None:
        if len(self._saved) == len(self):
            self._world.restore(self._saved[step])
        else:
            self._lead_to(self._first + step)

    def _lead_to(self, step: int) -> None:
        self._world.reset(self._seed)
        for action in self._actions[:step]:
            self._world.advance(action)

    def _save(self) -> None:
        if self._picture_px is None:
            return
        try:
            self._saved.append(self._world.save())
        except MinihumanError:  # a guest's world: it is reset and led there each time
            self._saved = []
