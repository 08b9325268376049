"""Odd in actions: their spaces, numbers and names."""

from enum import Enum, IntEnum
from typing import Any

import numpy as np
from gymnasium import spaces

from tests.worlds.odd.plain import Plain, odd


class Acting(Plain):
    """A plain environment with another action space."""

    space: Any = None

    def __init__(self, render_mode=None):
        super().__init__(render_mode)
        self.action_space = self.space


@odd(r"its action_space is nothing \(None\)")
class ActionsNone(Acting):
    pass


@odd(r"sessions do not support the action space")
class ActionsText(Acting):
    space = spaces.Text(3)


@odd(r"sessions do not support the action space")
class ActionsSequence(Acting):
    space = spaces.Sequence(spaces.Discrete(2))


@odd()
class ActionsFromOne(Acting):
    space = spaces.Discrete(3, start=1)


@odd()
class ActionsFromMinusOne(Acting):
    space = spaces.Discrete(3, start=-1)


@odd()
class ActionsSingle(Acting):
    space = spaces.Discrete(1)


@odd(noticed="no key does")
class ActionsMany(Acting):
    space = spaces.Discrete(60)


@odd(noticed="no key does .*, 33 and 20,447 more$")
class ActionsOfABoardGame(Acting):
    space = spaces.Discrete(20_481)


@odd()
class ActionsBinary(Acting):
    space = spaces.MultiBinary(2)


@odd()
class ActionsTwoDimensional(Acting):
    space = spaces.MultiDiscrete([[2, 2], [2, 2]])


@odd()
class ActionsUnbounded(Acting):
    space = spaces.Box(-np.inf, np.inf, (1,), np.float32)


@odd(noticed="keys move the first 4 of 6 parts")
class ActionsSixAxes(Acting):
    space = spaces.Box(-1, 1, (6,), np.float32)


@odd(unexportable="is no array, which imitation needs")
class ActionsNested(Acting):
    space = spaces.Dict({"turn": spaces.Discrete(3), "aim": spaces.Box(-1, 1, (1,), np.float32)})

    def move(self, action):
        super().move(action["turn"])


@odd()
class ActionsChangedInPlace(Acting):
    space = spaces.Box(-1, 1, (2,), np.float32)

    def move(self, action):
        super().move(abs(action))
        action[:] = 0


@odd(r"names 2 of its 3 actions")
class NamesTooFew(Plain):
    action_names = ("left", "right")


@odd(noticed=r"two actions are called 'go'")
class NamesTwice(Plain):
    action_names = ("go", "go", "stay")


@odd()
class NamesTooMany(Plain):
    action_names = ("left", "right", "stay", "jump")


@odd()
class NamesOfEnum(Plain):
    class Actions(IntEnum):
        left = 0
        right = 1
        stay = 2


@odd()
class NamesOfTextEnum(Plain):
    class Actions(Enum):
        left = "l"
        right = "r"


@odd()
class MeaningsNone(Plain):
    def get_keys_to_action(self):
        return {None: 0, ("w",): 1, "a": 2}


@odd(r"its code raised RuntimeError: no names yet")
class MeaningsRaise(Plain):
    def get_action_meanings(self):
        raise RuntimeError("no names yet")


@odd(noticed="states 30 frames a second")
class MovesByItself(Plain):
    metadata = {"render_modes": ["rgb_array"], "render_fps": 30}  # noqa: RUF012


@odd()
class FrameRateText(Plain):
    metadata = {"render_modes": ["rgb_array"], "render_fps": "fast"}  # noqa: RUF012
