"""The screen of an episode that is reviewed: one film."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from minihuman.experiment.machine.screens import FilmsScreen, PageView


@dataclass(frozen=True, slots=True, eq=False)
class FilmScreen(FilmsScreen):
    """One picture of an episode that is gone through step by step."""

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
        """The episode's film."""
        return (self.pictures,)

    @property
    def shown_step(self) -> int:
        """The step that is looked at."""
        return self.step

    @property
    def identity(self) -> tuple[object, ...]:
        """The words, and which episode it is."""
        return self.prompt, self.progress, self.film
