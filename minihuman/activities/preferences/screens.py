"""The screen of a comparison: two films side by side."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from minihuman.experiment.machine.screens import FilmsScreen, PageView


@dataclass(frozen=True, slots=True, eq=False)
class PairScreen(FilmsScreen):
    """A screen of two films side by side, both at the same step, between which the participant chooses."""

    drawing: ClassVar[str] = "minihuman.activities.preferences.drawing:draw_pair"
    page_view: ClassVar[PageView | None] = PageView(
        "pair",
        "minihuman.activities.preferences.page_values:build_page_values",
        "minihuman.activities.preferences:page.js",
    )
    lefts: Sequence[NDArray[np.uint8]]  # uint8[H, W, 3] each; the last stands while the other side goes on
    rights: Sequence[NDArray[np.uint8]]  # drawn when they are asked for
    step: int  # 0 for the first picture of both; one more than the last while that stands at the end
    title: str
    prompt: str  # the keys and what they say
    progress: str
    period_ns: int = 0  # from a step's pictures on the display to the next step
    replay_key: str = ""
    pair: tuple[int, int] = (0, 0)  # which one it is

    @property
    def films(self) -> tuple[Sequence[NDArray[np.uint8]], ...]:
        """Return the left and the right film, as sequences of pictures."""
        return self.lefts, self.rights

    @property
    def shown_step(self) -> int:
        """Return the step at which both films are shown."""
        return self.step

    @property
    def identity(self) -> tuple[object, ...]:
        """Return the texts and the pair's id; screens that share them differ only in the shown step."""
        return self.prompt, self.progress, self.pair

    @property
    def length(self) -> int:
        """Return the number of pictures of the longer film."""
        return max(len(self.lefts), len(self.rights))

    @property
    def left(self) -> NDArray[np.uint8]:
        """Return the present picture of the left film."""
        return self.lefts[min(self.step, len(self.lefts) - 1)]

    @property
    def right(self) -> NDArray[np.uint8]:
        """Return the present picture of the right film."""
        return self.rights[min(self.step, len(self.rights) - 1)]

    @property
    def along(self) -> float:
        """Return the share of the longer film that has been shown, from 0 to 1."""
        return min(1.0, self.step / max(1, self.length - 1))
