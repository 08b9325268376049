"""The screen of an episode under review."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from minihuman.experiment.machine.screens import FilmsScreen, PageView


@dataclass(frozen=True, slots=True, eq=False)
class FilmScreen(FilmsScreen):
    """A screen that shows one picture of an episode, through which the participant steps."""

    drawing: ClassVar[str] = "minihuman.activities.correction.drawing:draw_film"
    page_view: ClassVar[PageView | None] = PageView(
        "film",
        "minihuman.activities.correction.page_values:build_page_values",
        "minihuman.activities.correction:page.js",
    )
    pictures: Sequence[NDArray[np.uint8]]  # uint8[H, W, 3] each, drawn when it is asked for
    step: int
    prompt: str  # the keys and what they do
    progress: str
    back: str  # the keys to the step before and the next one
    forward: str
    film: tuple[int, int]  # which one it is

    @property
    def films(self) -> tuple[Sequence[NDArray[np.uint8]], ...]:
        """Return the episode's film, as a tuple of one."""
        return (self.pictures,)

    @property
    def shown_step(self) -> int:
        """Return the step whose picture is shown."""
        return self.step

    @property
    def identity(self) -> tuple[object, ...]:
        """Return the texts and the reviewed episode's id; screens that share them differ only in the shown step."""
        return self.prompt, self.progress, self.film
