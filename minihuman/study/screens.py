"""Screens: what a participant should see now, as values. Windows draw them; the session only names them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class TextScreen:
    """Words to read: consent, instruction, keyboard check, feedback, rest, pause, questions, the end."""

    title: str
    body: str
    prompt: str  # what to press to go on, "" when nothing does
    progress: str = ""  # "episode 3 of 10"
    keys: tuple[tuple[str, bool], ...] = ()  # keyboard check: key name, already pressed


@dataclass(frozen=True, slots=True, eq=False)
class PlayScreen:
    """The world's picture, with the mission above and the progress line below."""

    picture: NDArray[np.uint8]  # uint8[H, W, 3]
    mission: str
    progress: str
    legend: tuple[tuple[str, str], ...] = ()  # key, action name; empty unless keys are shown
    episode: int = 0
    step: int = 0


Screen = TextScreen | PlayScreen
