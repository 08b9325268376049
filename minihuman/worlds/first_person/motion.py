"""Continuous actions of first-person worlds: their space, and how they are read. `motion_kernels` moves the body."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.first_person.rules import ACTIONS, MOVE_BACK

CONTROLS = ("discrete", "discrete-strafe", "continuous", "continuous-strafe")
STRAFES = ("strafe_left", "strafe_right")
RESOLUTION = 1024  # of a continuous action: a component is a whole number of these parts
NO_USE = "rest"  # the value 0 of "use": the hands do nothing

_ELEMENT_NAMES = ("move_back", "move_forward", "turn_right", "turn_left", *STRAFES)  # to the ends of each component


@dataclass(frozen=True, slots=True)
class Command:
    """The motion and the use of the hands that a continuous action stands for.

    Args:
        ahead: -1 to 1 of the longest step.
        turn: to the left, -1 to 1 of the widest turn.
        right: -1 to 1 of the longest step.
        use: the name of the action of the hands, one of the world's actions that are no moves; "" for none.
    """

    ahead: float
    turn: float
    right: float = 0.0
    use: str = ""

    @property
    def components(self) -> NDArray[np.float64]:
        """Return the components in the order of `motion_kernels`, float64[COMMAND_SIZE]."""
        return np.array((self.ahead, self.turn, self.right))


class ContinuousControl:
    """The action space of a world with continuous motion, and how its actions are read.

    The space is a Box of speed, turn and, with strafing, strafe, each from -1 to 1. In a world with other actions than
    moves, it is a Dict of that Box ("move") and the number of another action ("use"), 0 for none.

    Args:
        action_names: the names of the world's discrete actions, out of `rules.ACTIONS`.
        strafes: whether the body can move sideways.
    """

    def __init__(self, action_names: Sequence[str], *, strafes: bool) -> None:
        self.uses = tuple(name for name in action_names if ACTIONS.index(name) > MOVE_BACK)
        self.n_axes = 3 if strafes else 2
        box = gymnasium.spaces.Box(-1.0, 1.0, (self.n_axes,), np.float32)
        self.space: gymnasium.Space[Any] = box
        if self.uses:
            self.space = gymnasium.spaces.Dict({"move": box, "use": gymnasium.spaces.Discrete(1 + len(self.uses))})
        self.element_names = _ELEMENT_NAMES[: 2 * self.n_axes] + self.uses

    def read(self, action: Any) -> Command:
        """Return the command that an action stands for, with components rounded to 1/`RESOLUTION`.

        Raises:
            WorldError: if the action is not in the space.
        """
        move, use = action, 0
        if self.uses and isinstance(action, Mapping) and action.keys() == {"move", "use"}:
            move, use = action["move"], action["use"]
        components = np.asarray(move, np.float64) if isinstance(move, np.ndarray | list | tuple) else np.zeros(0)
        box = self.space["move"] if isinstance(self.space, gymnasium.spaces.Dict) else self.space
        is_inside = components.shape == box.shape and bool((np.abs(components) <= 1.0).all())
        if not is_inside or use not in range(1 + len(self.uses)):
            raise WorldError(f"action is {action!r}; it must be in {self.space}")
        ahead, turn, *sideways = (np.round(components * RESOLUTION) / RESOLUTION).tolist()
        return Command(ahead, turn, sideways[0] if sideways else 0.0, ("", *self.uses)[int(use)])

    def read_all(self, actions: Any, count: int) -> tuple[NDArray[np.float64], NDArray[np.int64]] | None:
        """Return the rounded components of a batch's actions, float64[count, axes], and the values of "use", int64.

        Return None if any action is not in the space, which `read` then names.
        """
        moves = actions
        uses: Any = np.zeros(count, np.int64)
        if self.uses:
            if not isinstance(actions, Mapping) or actions.keys() != {"move", "use"}:
                return None
            moves = actions["move"]
            uses = np.asarray(actions["use"])
        components = np.asarray(moves)
        has_form = components.shape == (count, self.n_axes) and components.dtype.kind in "fiu"
        if not has_form or uses.shape != (count,) or uses.dtype.kind not in "iu":
            return None
        if not (np.abs(components) <= 1.0).all() or not ((uses >= 0) & (uses <= len(self.uses))).all():
            return None
        return np.round(components.astype(np.float64) * RESOLUTION) / RESOLUTION, uses.astype(np.int64)
