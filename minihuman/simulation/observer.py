"""A simulated observer for trials: it sees the stimulus with a chance that grows with one of its options, else guesses.

The chance is a Weibull function of the option, with a threshold of the participant's own.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np

from minihuman.errors import SimulationError
from minihuman.experiment.plan.session_plan import EpisodePlan
from minihuman.plugins import read_settings
from minihuman.simulation.participant import KeyPress, SimulatedParticipant
from minihuman.worlds.adapters.world import World

DEFAULTS: Mapping[str, Any] = {"option": "size", "threshold": 0.05, "spread": 0.4, "slope": 3.5, "lapse": 0.02}
"""The option, its value at 63 % seen, the SD of its logarithm between people, the function's slope, and the lapses."""


class ObserverParticipant(SimulatedParticipant):
    """Knows the trial's ``correct`` response or guesses among the keys; ``observer:threshold=0.04,spread=0.3``."""

    def __init__(self, argument: str, rng: np.random.Generator) -> None:
        its = {**DEFAULTS, **read_settings(argument, DEFAULTS, SimulationError, of="observer")}
        self._settings, self._rng, self._keys = its, rng, list[str]()
        self.threshold = float(its["threshold"] * np.exp(its["spread"] * rng.standard_normal()))

    def begin(self, plan: EpisodePlan, pool: tuple[str, ...], world: World) -> None:
        """Look at the stimulus.

        Raises:
            SimulationError: if the trial has no such option, or no correct response that has a key.
        """
        its, value, correct = self._settings, plan.options.get(self._settings["option"]), plan.options.get("correct")
        key = next((key for key, action in plan.key_map.keys.items() if action == correct), None)
        if not isinstance(value, int | float) or value <= 0 or key is None:
            raise SimulationError(
                f"the observer needs trials with a number above 0 in the option {its['option']!r} and a correct "
                f"response that has a key; {plan.world} has {value!r} and {correct!r}; use another participant, or "
                "observer:option=NAME"
            )
        seen = (1 - its["lapse"]) * -np.expm1(-((value / self.threshold) ** its["slope"]))
        self._keys = [key] if self._rng.random() < seen else sorted(plan.key_map.keys)

    def press(self, world: World) -> KeyPress:
        """Press the key, 300 to 700 ms after the picture."""
        return KeyPress(self._keys[self._rng.integers(len(self._keys))], self._rng.uniform(300.0, 700.0))
