"""A simulated human, who finds keys by trial, searches with what was seen, forgets, errs and improves.

It is not a model of any real person: its parameters are known, so that an analysis can be tested on data whose truth is
known before the first participant. It acts only on what it was shown. Each parameter has a population median and a
spread (the standard deviation of its logarithm between people). Times follow the literature cited at each parameter.
The parameters that determine search time (`wrong_turn`, `forgetting_rate_per_s`, `judgement_sd_steps`) were fitted to
the ten people of Chevalier-Boisvert et al. (2023), whose ten episodes in first-person FourRooms gave a mean reward of
0.88, about 4 % time-outs, about 2.4 times the shortest path, and a standard deviation of 0.066 between people's means.
"""

import math
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from minihuman.agents.goal_search import GoalSearch
from minihuman.agents.search_choice import build_search
from minihuman.errors import SimulationError, WorldError
from minihuman.experiment.plan.session_plan import EpisodePlan
from minihuman.experiment.stimuli import Stimulus
from minihuman.plugins import read_settings
from minihuman.simulation.participant import KeyPress, NoPress, SimulatedParticipant
from minihuman.simulation.response_model import TrialResponder, find_stimulus
from minihuman.worlds.adapters.world import World
from minihuman.worlds.hashing import hash64

_PROBABILITIES = ("lapse", "wrong_turn", "practice", "key_forgetting", "pause", "autocorrelation")
_LONGEST_S = 60.0  # that a press may take
_PAUSE_RANGE_MS = (1500, 5000)
_MAX_DRAWN_PROBABILITY = 0.9
EARLIER_NAMES = {
    "astray": "wrong_turn",
    "detour_steps": "wrong_turn_steps",
    "misjudge": "judgement_sd_steps",
    "forget": "forgetting_rate_per_s",
    "forget_keys": "key_forgetting",
    "repeat": "repeat_factor",
    "post_error_ms": "post_error_slowing_ms",
    "orient_ms": "orientation_ms",
}


@dataclass(frozen=True, slots=True)
class ParticipantParameters:
    """The parameters of one simulated person; the defaults are the population's medians.

    Reaction times are ex-Gaussian, as choice reaction times are (Luce, 1986).
    """

    mu_ms: float = 330.0  # mean of the normal part before practice; 300 to 400 are usual (Luce, 1986)
    sigma_ms: float = 50.0  # its standard deviation
    tau_ms: float = 150.0  # mean of the exponential part
    floor_ms: float = 160.0  # minimum; simple reactions take 213 ms on average (Woods et al., 2015)
    repeat_factor: float = 0.55  # relative time of the same key again: no choice any more (Card et al., 1983)
    orientation_ms: float = 700.0  # mean time to look at a new episode's first picture
    post_error_slowing_ms: float = 50.0  # added after an ineffective press (Rabbitt, 1966)
    practice: float = 0.35  # share of time and of wrong turns that practice removes in the end
    practice_presses: float = 150.0  # 63 % of it is gone by then: exponential (Heathcote et al., 2000)
    fatigue: float = 0.04  # relative slowing per 1,000 presses
    pause: float = 0.0  # probability per press of looking away for 1.5 to 5 s more
    autocorrelation: float = 0.0  # of a press's time with the one before, given keys and practice; 0.1 to 0.4 are usual
    lapse: float = 0.015  # probability per press of a random key of the pool; practice does not reduce it
    wrong_turn: float = 0.05  # probability per press, before practice, of setting off in a wrong direction
    wrong_turn_steps: float = 4.0  # mean length of a wrong turn
    judgement_sd_steps: float = 4.0  # error in the value of a viewpoint: a limited horizon (Kryven et al., 2024)
    forgetting_rate_per_s: float = 0.002  # of each cell, or square metre, that was seen
    key_forgetting: float = 0.05  # probability that a key's meaning is forgotten between blocks

    def __post_init__(self) -> None:
        """Check that the parameters are within their ranges.

        Raises:
            SimulationError: if a parameter is out of range.
        """
        for field in fields(self):
            value = getattr(self, field.name)
            if field.name in _PROBABILITIES and not 0 <= value <= 1:
                raise SimulationError(f"{field.name} is {value}; use a probability from 0 to 1")
            if not 0 <= value < math.inf:
                raise SimulationError(f"{field.name} is {value}; use 0 or more")
        if self.wrong_turn_steps < 1:
            raise SimulationError(f"wrong_turn_steps is {self.wrong_turn_steps}; use 1 or more")
        if self.practice_presses < 1:
            raise SimulationError(f"practice_presses is {self.practice_presses}; use 1 or more")

    def practice_factor(self, presses: int) -> float:
        """Return the factor by which practice reduces times: 1 before the first press, falling to ``1 - practice``."""
        return 1 - self.practice * -math.expm1(-presses / self.practice_presses)

    def reaction_ms(
        self,
        rng: np.random.Generator,
        *,
        presses: int,
        again: bool,
        extra_ms: float = 0.0,
        state: NDArray[np.float64] | None = None,
    ) -> float:
        """Draw a reaction time in milliseconds.

        Args:
            rng: the random generator.
            presses: the number of presses so far.
            again: whether the press repeats the last key.
            extra_ms: the time to add.
            state: the state of autocorrelated times, an array of shape (2,) that starts at 0 and is updated in place;
                None draws an independent time.
        """
        if state is None or not self.autocorrelation:
            sampled_ms = rng.normal(self.mu_ms, self.sigma_ms) + rng.exponential(self.tau_ms)
        else:  # both parts keep their distribution: normal, and exponential by the normal's quantiles
            innovation_sd = math.sqrt(1 - self.autocorrelation**2)
            state[:] = self.autocorrelation * state + innovation_sd * rng.standard_normal(2)
            upper_tail = math.erfc(state[1] / math.sqrt(2)) / 2
            sampled_ms = self.mu_ms + self.sigma_ms * state[0] - self.tau_ms * math.log(upper_tail)
        if self.pause and rng.random() < self.pause:
            extra_ms += rng.uniform(*_PAUSE_RANGE_MS)
        factor = self.practice_factor(presses) * (1 + self.fatigue * presses / 1000)
        if again:
            factor *= self.repeat_factor
        reaction_ms = max(self.floor_ms, sampled_ms * factor + extra_ms)
        return float(min(reaction_ms, _LONGEST_S * 1000))


PARAMETER_SPREADS = {  # the standard deviation of each parameter's logarithm between people
    "mu_ms": 0.15,
    "sigma_ms": 0.3,
    "tau_ms": 0.4,
    "repeat_factor": 0.1,
    "orientation_ms": 0.4,
    "post_error_slowing_ms": 0.4,
    "practice": 0.25,
    "practice_presses": 0.5,
    "fatigue": 0.5,
    "lapse": 0.6,
    "wrong_turn": 0.8,
    "judgement_sd_steps": 0.5,
    "forgetting_rate_per_s": 0.8,
}


@dataclass(frozen=True, slots=True)
class ParticipantPopulation:
    """A population of simulated people.

    Fixed parameters are the same for everyone; the others vary around the median.
    """

    median: ParticipantParameters = ParticipantParameters()  # frozen
    fixed: frozenset[str] = frozenset()
    spread: float = 1.0  # times PARAMETER_SPREADS; 0 removes all variation

    @classmethod
    def parse(cls, text: str) -> "ParticipantPopulation":
        """Parse settings such as ``lapse=0.1,tau_ms=300``, which fix the parameters that they name.

        The setting ``spread=0`` fixes the other parameters at their medians too.

        Raises:
            SimulationError: if a name is not a parameter, or a value is not a number or out of its range.
        """
        defaults = {field.name: field.default for field in fields(ParticipantParameters)} | {"spread": 1.0}
        values = read_settings(text, defaults, SimulationError, owner="human-like", aliases=EARLIER_NAMES)
        spread = values.pop("spread", 1.0)
        if not 0 <= spread < math.inf:
            raise SimulationError(f"spread is {spread}; use 0 or more")
        return cls(ParticipantParameters(**values), frozenset(values), spread)

    def draw(self, rng: np.random.Generator) -> ParticipantParameters:
        """Draw the parameters of one person."""
        parameters = {}
        for name, spread in PARAMETER_SPREADS.items():
            factor = math.exp(self.spread * spread * float(rng.standard_normal()))  # the same draws whatever is fixed
            if name not in self.fixed:
                parameters[name] = getattr(self.median, name) * factor
                if name in _PROBABILITIES:
                    parameters[name] = min(parameters[name], _MAX_DRAWN_PROBABILITY)
        return replace(self.median, **parameters)


class HumanLikeParticipant(SimulatedParticipant):
    """A simulated participant with the parameters of one drawn person.

    The participant knows a key once it has seen the key's effect.
    """

    def __init__(self, argument: str, rng: np.random.Generator) -> None:
        population = ParticipantPopulation.parse(argument)
        (trial_rng,) = rng.spawn(1)  # trials have a generator of their own, so that draws in other worlds do not change
        self._responder = TrialResponder(trial_rng, spread=population.spread)
        self.person = population.draw(rng)
        self._rng = rng
        self._presses = 0
        self._has_given_up = False  # whether a search took too long in this episode
        self._pool: tuple[str, ...] = ()
        self._plan: EpisodePlan | None = None
        self._understood: dict[str, str] = {}  # key -> action
        self._fruitless: dict[str, int] = {}  # key -> number of presses without a visible effect
        self._search: GoalSearch | None = None
        self._detour: list[str] = []
        self._last: tuple[str, int] | None = None  # the last key, and what was seen when it was pressed
        self._last_reaction_ms = 0.0  # how long the last press took
        self._reaction_state = np.zeros(2)  # of the autocorrelated reaction times
        self._no_effect = False  # whether the last press had no visible effect

    def begin(self, plan: EpisodePlan, pool: tuple[str, ...], world: World) -> None:
        """Start an episode; keys whose actions are known stay known if the key map is the same, but for forgetting."""
        last_plan = self._plan
        self._plan = plan
        self._pool = pool
        if last_plan is None or _map_action_positions(plan) != _map_action_positions(last_plan):
            self._understood = {}
            self._fruitless = {}
        elif plan.block != last_plan.block:
            remembered = [key for key in self._understood if self._rng.random() >= self.person.key_forgetting]
            self._understood = {key: plan.key_map.keys[key] for key in remembered}
            self._fruitless = {}
        if plan.show_keys:
            self._understood = dict(plan.key_map.keys)
        self._detour = []
        self._last = None
        self._has_given_up = False
        self._no_effect = False
        if find_stimulus(world.unwrapped) is not None:
            self._responder.begin()
            return
        sd_actions = self.person.judgement_sd_steps  # of a judgement's error
        self._search = build_search(world, plan.view, lambda count: self._rng.normal(0.0, sd_actions, count), self._rng)

    def press(self, world: World) -> KeyPress | NoPress:
        """Look at the world, learn from the last key and return the next one; in a trial, return the response.

        Raises:
            SimulationError: if the world has no planner.
        """
        if (stimulus := find_stimulus(world.unwrapped)) is not None:
            return self._respond(stimulus)
        assert self._search is not None, "begin() comes first"
        view_hash = hash64([repr(world.pose()), world.observation])
        extra_ms = 0.0
        if self._no_effect:
            extra_ms = self.person.post_error_slowing_ms
        if self._last is None:
            extra_ms = float(self._rng.exponential(self.person.orientation_ms))
        else:
            self._learn(*self._last, view_hash)
            # what is seen is forgotten at a constant rate: 1 - exp(-rate * time), for the time since the last press
            self._search.forget(-math.expm1(-self.person.forgetting_rate_per_s * self._last_reaction_ms / 1000))
        key = self._choose_key(self._search)
        again = self._last is not None and key == self._last[0]
        self._last_reaction_ms = self.person.reaction_ms(
            self._rng, presses=self._presses, again=again, extra_ms=extra_ms, state=self._reaction_state
        )
        self._last = key, view_hash
        self._presses += 1
        return KeyPress(key, self._last_reaction_ms)

    def _respond(self, stimulus: Stimulus) -> KeyPress | NoPress:
        """Return the response to a trial, whose keys are known from its instructions."""
        assert self._plan is not None, "begin() comes first"
        keys = {action: key for key, action in self._plan.key_map.keys.items()}
        responses = [action for action in self._plan.actions if action in keys]
        response = self._responder.respond(stimulus, responses, self._plan.response_deadline_ms)
        if response.response in keys:
            return KeyPress(keys[response.response], response.time_ms)
        return NoPress()

    def _learn(self, key: str, previous_hash: int, view_hash: int) -> None:
        """Learn from the effect of the last key: equal hashes of the views before and after it show no effect."""
        assert self._plan is not None
        assert self._search is not None
        action = self._plan.key_map.keys.get(key)
        self._no_effect = view_hash == previous_hash or action is None
        if self._no_effect:
            self._fruitless[key] = self._fruitless.get(key, 0) + 1
        if action is not None:
            self._search.observe_action(action, no_effect=self._no_effect)
            if not self._no_effect:
                self._understood[key] = action

    def _choose_key(self, search: GoalSearch) -> str:
        """Return the key of the next planned action, an untried key if that is unknown, or one of a lapse or detour."""
        path = self._plan_path(search)
        if self._rng.random() < self.person.lapse:
            return self._draw_key(self._pool)
        if not self._detour and self._understood:
            self._detour = self._draw_detour()
        if self._detour:
            return self._detour.pop()
        for key, action in self._understood.items():
            if path[:1] == [action]:
                return key
        return self._choose_untried()

    def _draw_detour(self) -> list[str]:
        """Return the keys of a wrong turn, if the person makes one now; otherwise an empty list."""
        wrong_turn_probability = self.person.wrong_turn * self.person.practice_factor(self._presses)
        if self._rng.random() >= wrong_turn_probability:
            return []
        length = int(self._rng.geometric(1 / self.person.wrong_turn_steps))
        return [self._draw_key(sorted(self._understood)) for _ in range(length)]

    def _plan_path(self, search: GoalSearch) -> list[str]:
        """Return the planned actions; after a search that took too long, none for the rest of the episode."""
        if not self._has_given_up:
            try:
                return search.plan()
            except WorldError:
                self._has_given_up = True
        return []

    def _choose_untried(self) -> str:
        """Return a key whose effect is unknown, at random among those pressed least often without effect."""
        unknown = [key for key in self._pool if key not in self._understood] or list(self._pool)
        fewest = min(self._fruitless.get(key, 0) for key in unknown)
        return self._draw_key([key for key in unknown if self._fruitless.get(key, 0) == fewest])

    def _draw_key(self, keys: list[str] | tuple[str, ...]) -> str:
        return keys[int(self._rng.integers(len(keys)))]


def _map_action_positions(plan: EpisodePlan) -> dict[str, int]:
    """Return the position of each key's action in the list of the block's actions, by key.

    What a participant knows of the keys carries over to a block with equal positions.
    """
    return {key: plan.actions.index(action) for key, action in plan.key_map.keys.items() if action in plan.actions}
