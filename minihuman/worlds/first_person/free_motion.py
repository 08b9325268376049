"""FreeMotion: the part of a first-person world that moves its body by other than the eight actions."""

import abc
from typing import Any

import gymnasium

from minihuman.errors import WorldError
from minihuman.worlds.first_person.motion import (
    CONTROLS,
    RESOLUTION,
    STRAFES,
    Command,
    ContinuousControl,
)
from minihuman.worlds.first_person.rules import ACT, ACTIONS
from minihuman.worlds.first_person.state import FlatState, WorldState, move_body
from minihuman.worlds.options import check_number, check_one_of

_FARTHEST = 1e5  # the longest way and the widest turn of `move`, in metres and radians
_FASTEST_CHANGE = 2.0  # the greatest acceleration, from full speed back to full speed ahead


class FreeMotion(abc.ABC):
    """A mixin of every first-person world that adds steps sideways, continuous actions and moves for authors."""

    action_names: tuple[str, ...]
    action_space: gymnasium.Space[Any]
    kernel_actions: tuple[str, ...]  # those of `rules.ACTIONS` that the world has
    control: str
    acceleration: float
    velocity: tuple[float, float]  # with acceleration: ahead and to the right, as shares of the largest
    action_element_names: tuple[str, ...]  # of continuous actions
    action_resolution: int
    _continuous: ContinuousControl | None

    @property
    @abc.abstractmethod
    def stage(self) -> WorldState:
        """Return the state of the episode."""

    @abc.abstractmethod
    def flat_state(self) -> FlatState:
        """Return the present state in the arrays of the kernels."""

    def move(self, dx: float, dz: float, dyaw: float = 0.0) -> bool:
        """Turn the agent to the left by ``dyaw`` radians, then move it by ``dx`` and ``dz`` metres.

        It slides along walls and things in its way. What it carries is turned and moved with it, and must fit, too.

        Returns:
            Whether the agent turned or moved.

        Raises:
            WorldError: if a number is not finite or beyond 100 000, or before the first reset.
        """
        for name, number in (("dx", dx), ("dz", dz), ("dyaw", dyaw)):
            check_number(name, number, -_FARTHEST, _FARTHEST)
        return self._move_body(float(dx), float(dz), float(dyaw))

    def _set_actions(self, actions: tuple[str, ...], control: str, acceleration: float) -> None:
        """Set the action space and the names of its actions.

        Raises:
            WorldError: if an action or the control is unknown, or the acceleration has no motion to change.
        """
        if not actions:
            raise WorldError(f"the list of actions is empty; give one or more of {', '.join(ACTIONS)}")
        if unknown := set(actions) - set(ACTIONS):
            raise WorldError(f"unknown actions {', '.join(sorted(unknown))}; use {', '.join(ACTIONS)}")
        check_one_of("control", control, CONTROLS)
        check_number("acceleration", acceleration, 0, _FASTEST_CHANGE)
        is_continuous = control.startswith("continuous")
        if acceleration and not is_continuous:
            raise WorldError(f'acceleration is {acceleration}, but control is {control!r}; make it "continuous"')
        self.kernel_actions = actions
        self.control = control
        self.acceleration = acceleration
        self._continuous = None
        if is_continuous:
            self._continuous = ContinuousControl(actions, strafes=control == "continuous-strafe")
            self.action_names = actions
            self.action_space = self._continuous.space
            self.action_element_names = self._continuous.element_names
            self.action_resolution = RESOLUTION
            return
        self.action_names = (*actions, *STRAFES) if control == "discrete-strafe" else actions
        self.action_space = gymnasium.spaces.Discrete(len(self.action_names))

    @property
    def use_actions(self) -> tuple[int, ...]:
        """Return the kernels' numbers of the actions that the component "use" of continuous actions does.

        They are in the order of its values from 1; () if there is no such component.
        """
        if self._continuous is None:
            return ()
        return tuple(self._kernel_action(name) for name in self._continuous.uses)

    def _stand_still(self) -> None:
        """Set the velocity to 0 at the beginning of an episode, if the agent accelerates."""
        if self.acceleration:
            vars(self)["velocity"] = (0.0, 0.0)

    def _is_free(self, number: int) -> bool:
        """Return whether an action is continuous or a step sideways, which `_act_freely` does, not the kernels."""
        return self._continuous is not None or number >= len(self.kernel_actions)

    def _act_freely(self, action: Any, name: str) -> str:
        """Do a step sideways or a continuous action; return the action name from which its reward is computed."""
        if self._continuous is None:
            command = Command(0.0, 0.0, -1.0 if name == STRAFES[0] else 1.0)
        else:
            command = self._continuous.read(action)
            name = command.use or "move_forward"
        self._move_by_command(command)
        if command.use:
            self._use_hands(command.use)
        return name

    def _move_body(self, dx: float, dz: float, dyaw: float) -> bool:
        """Turn the agent to the left by radians, then move it by metres; return whether it turned or moved."""
        return move_body(self.stage, dx, dz, dyaw)

    def _move_by_command(self, command: Command) -> None:
        """Do the motion of a continuous action."""
        self.flat_state().move(self, command.components)  # type: ignore[arg-type]  # a world

    def _use_hands(self, name: str) -> None:
        """Do an action that does not move the agent, such as "pickup", by its name."""
        self.flat_state().step(self, self._kernel_action(name), ACT)  # type: ignore[arg-type]  # a world

    def _kernel_action(self, name: str) -> int:
        """Return the number by which kernels know an action; -1 for a move that is none of the world's actions."""
        if name in self.kernel_actions:
            return self.kernel_actions.index(name)
        return -1
