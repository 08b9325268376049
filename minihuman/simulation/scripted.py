"""Simulated participants that know their keys: random, optimal, exploring, and an observer for trials.

The optimal participant follows the shortest path, as a reference for all others. The observer sees the stimulus with a
probability that increases with one of its options.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from minihuman.agents.goal_search import GoalSearch, find_shortest_path
from minihuman.agents.search_choice import build_kitchen_search
from minihuman.errors import SimulationError
from minihuman.experiment.plan.session_plan import EpisodePlan
from minihuman.plugins import read_settings
from minihuman.simulation.participant import KeyPress, SimulatedParticipant
from minihuman.worlds.adapters.world import World
from minihuman.worlds.grid.engine import GridEngine


class RandomParticipant(SimulatedParticipant):
    """A participant who presses every key with an action equally often."""

    def __init__(self, argument: str, rng: np.random.Generator) -> None:
        self._rng = rng
        self._keys: list[str] = []

    def begin(self, plan: EpisodePlan, pool: tuple[str, ...], world: World) -> None:
        """Start an episode with the keys that have an action."""
        self._keys = sorted(plan.key_map.keys)

    def press(self, world: World) -> KeyPress:
        """Press a random key 100 to 500 ms after the picture."""
        return KeyPress(self._keys[self._rng.integers(len(self._keys))], self._rng.uniform(100.0, 500.0))


DELAY_MS = 250.0


class OptimalParticipant(SimulatedParticipant):
    """A participant who follows the shortest path from reset to goal."""

    def __init__(self, argument: str, rng: np.random.Generator) -> None:
        self._key_of: dict[str, str] = {}
        self._path: list[str] = []

    def begin(self, plan: EpisodePlan, pool: tuple[str, ...], world: World) -> None:
        """Start an episode by discarding the last path."""
        self._key_of = {action: key for key, action in reversed(plan.key_map.keys.items())}
        self._path = []

    def press(self, world: World) -> KeyPress:
        """Press the key of the next action on the path.

        Raises:
            SimulationError: if there is no path, or it needs an action without a key.
        """
        if not self._path:
            self._path = find_shortest_path(world)
        if not self._path:
            raise SimulationError(
                f"{world.id}: no path leads to the goal from {world.pose()}; use the random participant"
            )
        return press_action(self._path.pop(0), self._key_of, world, DELAY_MS)


def press_action(action: str, key_of: Mapping[str, str], world: World, delay_ms: float) -> KeyPress:
    """Return the press, after ``delay_ms``, of the key that carries out an action; ``key_of`` has the keys by action.

    Raises:
        SimulationError: if the action has no key.
    """
    if action not in key_of:
        raise SimulationError(
            f"{world.id}: the path needs action {action!r}, which has no key; add it to the block's actions"
        )
    return KeyPress(key_of[action], delay_ms)


class GridExplorer:
    """The exploring expert in one episode of a grid world, which plans in action names."""

    def __init__(self, world: World) -> None:
        from minihuman.worlds.grid.babyai.exploring_expert import Explorer  # compiled: only where it is used

        env = world.unwrapped
        if not isinstance(env, GridEngine):
            raise SimulationError(
                f"{world.id} is not a grid world, which the exploring participant needs; choose another participant"
            )
        self._env = env
        self._explorer = Explorer(env.state, env.image_shape[0])

    @property
    def n_seen_cells(self) -> int:
        """Return the number of cells that have been in sight so far."""
        return int(self._explorer.memory.seen.sum())

    def plan(self) -> list[str]:
        """Return the next actions, as far as the explorer has decided on them; [] if nothing is left to try."""
        return [self._env.action_names[action] for action in self._explorer.way(self._env.state)]


class ExploringParticipant(SimulatedParticipant):
    """A participant who explores unseen cells and carries out the mission once it knows how; in kitchens it cooks."""

    def __init__(self, argument: str, rng: np.random.Generator) -> None:
        self._key_of: dict[str, str] = {}
        self._searcher: GridExplorer | GoalSearch | None = None

    def begin(self, plan: EpisodePlan, pool: tuple[str, ...], world: World) -> None:
        """Start an episode with nothing explored."""
        self._key_of = {action: key for key, action in reversed(plan.key_map.keys.items())}
        self._searcher = build_kitchen_search(world) or GridExplorer(world)

    def press(self, world: World) -> KeyPress:
        """Press the key of the next planned action.

        Raises:
            SimulationError: if nothing is left to try, or the action has no key.
        """
        assert self._searcher is not None, "begin() comes first"
        path = self._searcher.plan()
        if not path:
            raise SimulationError(
                f"{world.id}: explored the whole world without completing the mission; choose another participant"
            )
        return press_action(path[0], self._key_of, world, DELAY_MS)


DEFAULTS: Mapping[str, Any] = {"option": "size", "threshold": 0.05, "spread": 0.4, "slope": 3.5, "lapse": 0.02}
"""The option, its value at 63 % seen, the SD of its logarithm between people, the function's slope, and the lapses."""


class ObserverParticipant(SimulatedParticipant):
    """A participant who perceives a trial's ``correct`` response or guesses; ``observer:threshold=0.04,spread=0.3``."""

    def __init__(self, argument: str, rng: np.random.Generator) -> None:
        settings = {**DEFAULTS, **read_settings(argument, DEFAULTS, SimulationError, owner="observer")}
        self._settings = settings
        self._rng = rng
        self._keys: list[str] = []
        self.threshold = float(settings["threshold"] * np.exp(settings["spread"] * rng.standard_normal()))

    def begin(self, plan: EpisodePlan, pool: tuple[str, ...], world: World) -> None:
        """Start a trial and decide on the response.

        Raises:
            SimulationError: if the trial lacks the option, or has no correct response with a key.
        """
        settings = self._settings
        intensity = plan.options.get(self._settings["option"])
        correct = plan.options.get("correct")
        key = next((key for key, action in plan.key_map.keys.items() if action == correct), None)
        if not isinstance(intensity, int | float) or intensity <= 0 or key is None:
            raise SimulationError(
                f"the observer needs trials with a number above 0 in the option {settings['option']!r} and a correct "
                f"response that has a key; {plan.world} has {intensity!r} and {correct!r}; use another participant, or "
                "observer:option=NAME"
            )
        p_seen = (1 - settings["lapse"]) * -np.expm1(-((intensity / self.threshold) ** settings["slope"]))
        self._keys = [key]
        if self._rng.random() >= p_seen:  # not seen: any key
            self._keys = sorted(plan.key_map.keys)

    def press(self, world: World) -> KeyPress:
        """Press the chosen key, or a random one if the stimulus was not seen, 300 to 700 ms after the picture."""
        return KeyPress(self._keys[self._rng.integers(len(self._keys))], self._rng.uniform(300.0, 700.0))
