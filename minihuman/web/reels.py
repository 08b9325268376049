"""The pictures of films, drawn one at a time: a whole episode at once would keep everybody else waiting. No I/O."""

from collections import deque
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from minihuman.study.screens import FilmScreen, PairScreen, Screen
from minihuman.web.drawn import Numbered
from minihuman.web.wire import Frame


class Reels:
    """What is left to be drawn of the films on the screen.

    Args:
        number: numbers a picture, which is sent before the frame that has it.
    """

    def __init__(self, number: Numbered) -> None:
        self._number = number
        self._name = 0  # of the screen
        self._reels: tuple[Sequence[NDArray[np.uint8]], ...] = ()
        self._to_do: deque[tuple[int, int]] = deque()  # reels and places in them, the next to be seen first

    def start_from(self, screen: Screen, name: int) -> None:
        """The page was told of a screen, with the pictures that are seen first."""
        self._name, self._reels, step = name, (), 0
        match screen:
            case FilmScreen():
                self._reels, step = (screen.pictures,), screen.step
            case PairScreen():
                self._reels, step = (screen.lefts, screen.rights), screen.step
        places = [
            ((place - min(step, len(reel) - 1)) % len(reel), side, place)
            for side, reel in enumerate(self._reels)
            for place in range(len(reel))
        ]
        self._to_do = deque((side, place) for away, side, place in sorted(places) if away)

    def grow(self) -> Frame | None:
        """Draw the next picture; None if all are there."""
        if not self._to_do:
            return None
        side, place = self._to_do.popleft()
        return Frame(self._name, side, place, self._number(self._reels[side][place]))
