"""Clips of episodes, recreated from seeds and actions, for comparisons and corrections."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import MinihumanError
from minihuman.experiment.machine.inputs import ActivityInput
from minihuman.experiment.machine.running_episode import EMPTY_IMAGE, catch_world_errors
from minihuman.experiment.plan.session_plan import ShownView
from minihuman.worlds.contract import Palette

if TYPE_CHECKING:
    from minihuman.worlds.adapters.world import World


@dataclass(frozen=True, slots=True)
class EpisodeClip:
    """A sequence of an episode's steps; its world, options, seed and actions recreate its pictures."""

    episode: int  # of the session it was played in, 0 for the first
    attempt: int  # 1, or more where the episode was begun again
    first: int  # the step whose picture is the first; 0 is the reset
    world: str
    options: str  # JSON
    seed: int
    actions: tuple[int, ...]  # the world's, from the reset to the clip's last step

    @property
    def last(self) -> int:
        """Return the step that the last picture shows."""
        return len(self.actions)


@dataclass(frozen=True, slots=True)
class ClipOffered(ActivityInput):
    """A clip from the session host; ``stretch`` is None if there is no further clip."""

    stretch: EpisodeClip | None


ImageArray = NDArray[np.uint8]


class EpisodeFilm(Sequence[ImageArray]):
    """The pictures of a clip, one per step, each an array uint8[height, width, 3] that is drawn when it is read.

    Args:
        world: a world that was made for the episode; other code may use it between two reads.
        seed: the seed of the episode's reset.
        actions: the numbers of the world's actions from the reset on.
        view: the part of the world that is shown.
        palette: the world's colours.
        picture_px: the largest picture wanted, as width and height in pixels; None draws empty pictures.
        first: the step that the first picture shows; 0 is the reset.
    """

    def __init__(
        self,
        world: "World",
        seed: int,
        actions: Sequence[int],
        *,
        view: ShownView,
        palette: Palette,
        picture_px: tuple[int, int] | None,
        first: int = 0,
    ) -> None:
        self._world = world
        self._seed = seed
        self._actions = tuple(actions)
        self._view: ShownView = view
        self._palette: Palette = palette
        self._picture_px = picture_px
        self._first = first
        self._saved: list[Any] = []  # the world's state at each picture; empty if it cannot be saved
        with catch_world_errors():
            self._replay_to(first)
            self.first_hash = world.state_hash()
            self._save_world()
            for action in self._actions[first:]:
                world.advance(action)
                self._save_world()
            self.last_hash = world.state_hash()

    def __len__(self) -> int:
        """Return the number of pictures: one for the first step and one for each later step."""
        return len(self._actions) + 1 - self._first

    @overload
    def __getitem__(self, step: int) -> ImageArray: ...
    @overload
    def __getitem__(self, step: slice) -> Sequence[ImageArray]: ...
    def __getitem__(self, step: int | slice) -> ImageArray | Sequence[ImageArray]:
        """Draw and return the picture at an index, or the pictures of a slice; they are empty without a picture size.

        Raises:
            IndexError: if there is no picture at the index.
        """
        if isinstance(step, slice):
            return [self[index] for index in range(*step.indices(len(self)))]
        if not -len(self) <= step < len(self):
            raise IndexError(step)
        if self._picture_px is None:
            return EMPTY_IMAGE
        with catch_world_errors():
            self._go_to(step % len(self))
            return self._world.frame(self._view, self._picture_px, self._palette).copy()

    def _go_to(self, step: int) -> None:
        """Bring the world to the state of the picture at an index, from the saved states if there are any."""
        if len(self._saved) == len(self):
            self._world.restore(self._saved[step])
        else:
            self._replay_to(self._first + step)

    def _replay_to(self, step: int) -> None:
        """Reset the world and repeat the episode's actions up to a step, counted from the reset."""
        self._world.reset(self._seed)
        for action in self._actions[:step]:
            self._world.advance(action)

    def _save_world(self) -> None:
        """Save the world's present state, if pictures are drawn, so that its picture can be drawn later.

        If the world cannot be saved, drop all saved states; `_go_to` then replays the episode for each picture.
        """
        if self._picture_px is None:
            return
        try:
            self._saved.append(self._world.save())
        except MinihumanError:
            self._saved = []
