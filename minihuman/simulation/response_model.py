"""A simulated person's response to one trial: a race of accumulators, with values learnt from rewards.

Each response has an accumulator that drifts towards a common threshold. The first to reach it determines the response,
if it arrives before the deadline (racing Wald accumulators: Logan, Van Zandt, Verbruggen and Wagenmakers, 2014,
Psychological Review 121; Tillman, Van Zandt and Logan, 2020, Psychonomic Bulletin & Review 27). A word that names a
response, or the side on which a stimulus appears, also drives that response, whatever the task: so congruent trials
are faster. If rewards are probabilistic, values are learnt by Q-learning, and drift follows their softmax. It is not a
model of any real person: its parameters are known, so that an analysis can be tested on data whose truth is known.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from minihuman.experiment.stimuli import NO_RESPONSE, Stimulus

_LAPSE_RANGE_MS = (200, 900)  # in which a response comes that is independent of the stimulus
_INITIAL_VALUE = 0.5  # of a response whose reward is unknown


@dataclass(frozen=True, slots=True)
class ResponseParameters:
    """The parameters of one simulated person's responses; the defaults are the population's medians."""

    threshold: float = 2.0  # in units of the noise's standard deviation over a second
    drift_correct: float = 8.0  # per second, of the correct response
    drift_error: float = 1.5  # of each other response
    drift_automatic: float = 2.5  # more for the response that the stimulus names or points to
    nondecision_ms: float = 250.0
    learning_rate: float = 0.3  # of Q-learning
    inverse_temperature: float = 5.0
    lapse: float = 0.015  # probability of any response
    stop_ms: float = 220.0  # mean of the stop process's time; the same for everybody, as its standard deviation is
    stop_sd_ms: float = 30.0


_SPREADS = {  # the standard deviation of each parameter's logarithm between people
    "threshold": 0.12,
    "drift_correct": 0.15,
    "drift_error": 0.2,
    "drift_automatic": 0.3,
    "nondecision_ms": 0.12,
    "learning_rate": 0.3,
    "inverse_temperature": 0.3,
    "lapse": 0.6,
}


@dataclass(frozen=True, slots=True)
class TrialResponse:
    """A person's response in a trial."""

    response: str  # "none": it is withheld
    time_ms: float  # since the stimulus


class TrialResponder:
    """A person who responds to trials and learns from their rewards.

    Args:
        rng: the person's random generator.
        spread: the factor of the spread between people; 0 makes everyone the median person.
    """

    def __init__(self, rng: np.random.Generator, *, spread: float = 1.0) -> None:
        self._rng = rng
        self.parameters = draw_parameters(rng, spread)
        self._values: dict[tuple[int, str], float] = {}  # of a response at a choice
        self._may_withhold = False  # whether withholding has been correct in this task, and so is a response, too
        self._last: tuple[Stimulus, int, str] | None = None  # the last trial, its choice and the response to it

    def begin(self) -> None:
        """Begin the next trial by learning from the reward of the previous one, if that had no correct response."""
        if self._last is None:
            return
        stimulus, choice, response = self._last
        self._last = None
        learnt_value = self._values.get((choice, response), _INITIAL_VALUE)
        error = stimulus.last_reward - learnt_value
        self._values[choice, response] = learnt_value + self.parameters.learning_rate * error

    def respond(self, stimulus: Stimulus, responses: Sequence[str], deadline_ms: float) -> TrialResponse:
        """Return the response to a stimulus.

        Args:
            stimulus: the trial's world.
            responses: the names of the responses that have a key.
            deadline_ms: the time after which no response is made, in milliseconds; 0 for no deadline.
        """
        choice = stimulus.choice
        if self._rng.random() < self.parameters.lapse:
            response = responses[int(self._rng.integers(len(responses)))]
            arrival_ms = float(self._rng.uniform(*_LAPSE_RANGE_MS))
        else:
            response, arrival_ms = self._race(self._find_drifts(stimulus, responses, choice))
        is_stopped = self._is_stopped(stimulus, arrival_ms)
        is_late = deadline_ms != 0 and arrival_ms >= deadline_ms
        if is_stopped or is_late:
            response = NO_RESPONSE
        elif not stimulus.correct_response:
            self._last = stimulus, choice, response
        return TrialResponse(response, arrival_ms)

    def _is_stopped(self, stimulus: Stimulus, arrival_ms: float) -> bool:
        """Return whether the stop process ends before the response: an independent race (Logan and Cowan, 1984)."""
        if stimulus.stop_delay_ms is None:
            return False
        stop_ms = self._rng.normal(self.parameters.stop_ms, self.parameters.stop_sd_ms)
        return bool(stimulus.stop_delay_ms + stop_ms < arrival_ms)

    def _find_drifts(self, stimulus: Stimulus, responses: Sequence[str], choice: int) -> dict[str, float]:
        """Return the drift per second of each response's accumulator; withholding has one once it was correct.

        ``choice`` is the number of the choice whose learnt values apply if the trial has no correct response.
        """
        parameters = self.parameters
        correct = stimulus.go_response or stimulus.correct_response
        if not correct:
            return self._find_learnt_drifts(responses, choice)
        self._may_withhold |= correct == NO_RESPONSE
        drifts = dict.fromkeys(responses, parameters.drift_error)
        if self._may_withhold:
            drifts.setdefault(NO_RESPONSE, parameters.drift_error)
        if correct in drifts:
            drifts[correct] = parameters.drift_correct
        for name in stimulus.prompted_responses:
            if name in drifts:
                drifts[name] += parameters.drift_automatic
        return drifts

    def _find_learnt_drifts(self, responses: Sequence[str], choice: int) -> dict[str, float]:
        """Return each response's drift, in proportion to the softmax of the values learnt at choice number ``choice``.

        A trial without a correct response has these drifts.
        """
        parameters = self.parameters
        weights = {}
        for name in responses:
            learnt_value = self._values.get((choice, name), _INITIAL_VALUE)
            weights[name] = math.exp(parameters.inverse_temperature * learnt_value)
        total = sum(weights.values())
        return {name: parameters.drift_correct * weight / total for name, weight in weights.items()}

    def _race(self, drifts: Mapping[str, float]) -> tuple[str, float]:
        """Return the response whose accumulator arrives first, and its time in milliseconds."""
        threshold = self.parameters.threshold
        arrivals_s = {
            name: float(self._rng.wald(threshold / drift, threshold**2)) for name, drift in drifts.items() if drift > 0
        }
        first = min(arrivals_s, key=lambda name: arrivals_s[name])
        return first, self.parameters.nondecision_ms + 1000 * arrivals_s[first]


def draw_parameters(rng: np.random.Generator, spread: float = 1.0) -> ResponseParameters:
    """Draw the parameters of one person, whose variation between people is multiplied by ``spread``."""
    parameters: dict[str, Any] = {}
    for name, deviation in _SPREADS.items():
        factor = math.exp(spread * deviation * float(rng.standard_normal()))
        parameters[name] = getattr(ResponseParameters(), name) * factor
    parameters["learning_rate"] = min(parameters["learning_rate"], 1.0)
    return replace(ResponseParameters(), **parameters)


def find_stimulus(world: Any) -> Stimulus | None:
    """Return a world as a trial's stimulus; None if the world is not a trial."""
    if isinstance(world, Stimulus):
        return world
    return None
