"""A simulated supervisor, who watches an agent, takes over, hands back, corrects, rates and compares.

The supervisor knows what an exploring expert knows: what has been seen so far; with `full_knowledge`, the shortest
path. As critic and rater it follows the planner; in a world without one it presses nothing and answers that it cannot
tell. Its settings are those of `SupervisorParameters`, of `CriticParameters` with the prefix `critic_` and of
`RaterParameters` with the prefix `rater_`:
`--player supervisor:patience_steps=6,critic_response_rate=0.5,rater_lapse=0`.
"""

import json
import math
from contextlib import closing
from dataclasses import dataclass, fields
from typing import Any, Literal

import numpy as np

from minihuman.activities.episode_clips import EpisodeClip
from minihuman.activities.preferences.events import PairAnswer
from minihuman.agents.goal_search import find_shortest_path
from minihuman.errors import SimulationError
from minihuman.experiment.plan.session_plan import EpisodePlan
from minihuman.plugins import read_settings
from minihuman.simulation.participant import KeyPress, SimulatedTeacher, WatchedStep
from minihuman.simulation.scripted import GridExplorer, press_action
from minihuman.worlds.adapters.world import World

_SHORTEST_DELAY_MS = 100.0  # from a picture to a critic's key
_MAX_LOG_ODDS = 500.0  # beyond which the exponential overflows


@dataclass(frozen=True, slots=True)
class SupervisorParameters:
    """The parameters of a supervisor. Delays are ex-Gaussian, as people's reaction times are."""

    patience_steps: int = 4  # excess steps of the agent at which it takes over
    min_control_steps: int = 4  # of its own before it hands back
    mu_ms: float = 400.0  # mean of the normal part, from noticing to the key
    sigma_ms: float = 60.0  # its standard deviation
    tau_ms: float = 180.0  # mean of the exponential part
    full_knowledge: bool = False  # plan with the whole world, not only with what was seen


class Supervisor:
    """A supervisor who watches one episode after another and decides when to take control.

    Call ``plan`` once after the reset and once after every step, the agent's or the supervisor's. The agent's excess
    steps are its steps plus the length of the path that is left now, minus the length of the path that was left when
    something new last came into sight or the supervisor handed back. Looking around a new corner costs nothing; going
    back and forth costs a step each.
    """

    def __init__(self, parameters: SupervisorParameters, rng: np.random.Generator) -> None:
        self._parameters = parameters
        self._rng = rng
        self._searcher: GridExplorer | None = None
        self._path: list[str] = []
        self._initial_path_length = 0  # when counting began
        self._n_counted = 0  # steps made since
        self._is_counting = False  # whether counting has begun in this episode
        self._due_ms: float | None = None  # when the key will go down
        self._n_own_steps = 0  # since taking over

    def begin(self, world: World) -> None:
        """Start an episode in which the agent is in control."""
        self._searcher = None
        if not self._parameters.full_knowledge:
            self._searcher = GridExplorer(world)
        self._path = []
        self._is_counting = False
        self._due_ms = None
        self._n_own_steps = 0

    def plan(self, world: World) -> list[str]:
        """Look at the world and return the next actions, as far as they are known; empty if none is known."""
        sees_more = False
        if self._searcher is None:
            self._path = find_shortest_path(world)
        else:
            n_seen_before = self._searcher.n_seen_cells
            self._path = list(self._searcher.plan())
            sees_more = self._searcher.n_seen_cells > n_seen_before
        self._n_counted += 1
        if sees_more or not self._is_counting:
            self._count_anew()
        return self._path

    @property
    def patience_steps(self) -> int:
        """Return the number of excess steps at which the supervisor takes over."""
        return self._parameters.patience_steps

    @property
    def excess_steps(self) -> int:
        """Return the number of steps that the agent has made in excess of the supervisor's path."""
        return self._n_counted + len(self._path) - self._initial_path_length

    @property
    def exceeds_patience(self) -> bool:
        """Return whether the agent's excess steps warrant a takeover and the supervisor has a plan."""
        return bool(self._path) and self.excess_steps >= self._parameters.patience_steps

    def takes_over(self, t_ms: float) -> bool:
        """Return whether the supervisor takes over at session time ``t_ms``; call this while the agent is in control.

        It decides to do so when the agent exceeds its patience, and does so after a delay if it still has a plan.
        """
        if self._due_ms is None and self.exceeds_patience:
            normal = self._rng.normal(self._parameters.mu_ms, self._parameters.sigma_ms)
            self._due_ms = t_ms + max(0.0, float(normal + self._rng.exponential(self._parameters.tau_ms)))
        if self._due_ms is None or t_ms < self._due_ms:
            return False
        self._due_ms = None
        self._n_own_steps = 0
        return bool(self._path)

    def hands_back(self) -> bool:
        """Return whether the supervisor returns control; call this after each of its own steps, and after ``plan``."""
        self._n_own_steps += 1
        if self._n_own_steps < self._parameters.min_control_steps:
            return False
        self._count_anew()
        return True

    def _count_anew(self) -> None:
        """Begin to count excess steps from the present state."""
        self._initial_path_length = len(self._path)
        self._n_counted = 0
        self._is_counting = True


@dataclass(frozen=True, slots=True)
class CriticParameters:
    """The parameters of a critic. Delays are ex-Gaussian with mean ``mu_ms + tau_ms``."""

    mu_ms: float = 500.0  # mean of the normal part, from the picture to the key
    sigma_ms: float = 60.0  # its standard deviation
    tau_ms: float = 100.0  # mean of the exponential part
    response_rate: float = 0.3  # probability of a press per step
    error_rate: float = 0.05  # probability of the wrong key

    def __post_init__(self) -> None:
        """Check that the parameters are within their ranges.

        Raises:
            SimulationError: if a parameter is out of range.
        """
        for name in ("response_rate", "error_rate"):
            if not 0 <= getattr(self, name) <= 1:
                raise SimulationError(f"{name} is {getattr(self, name)}; use a probability from 0 to 1")
        for name in ("mu_ms", "sigma_ms", "tau_ms"):
            if not 0 <= getattr(self, name) < math.inf:
                raise SimulationError(f"{name} is {getattr(self, name)}; use 0 or more")

    @property
    def delay_ms(self) -> float:
        """Return the mean delay in milliseconds, which a learner has to estimate."""
        return self.mu_ms + self.tau_ms


class Critic:
    """A critic who rates steps by how much they shortened the path."""

    def __init__(self, parameters: CriticParameters, rng: np.random.Generator) -> None:
        self._parameters = parameters
        self._rng = rng

    def press(self, gained_steps: float, shown_ms: float) -> tuple[float, float] | None:
        """Return the time of a press in milliseconds and its rating (1 good, -1 bad); None for no press.

        Args:
            gained_steps: the number of steps by which the action shortened the path.
            shown_ms: the time at which the picture of the action's outcome was shown.
        """
        if self._rng.random() >= self._parameters.response_rate:
            return None
        rating = -1.0
        if gained_steps > 0:
            rating = 1.0
        if self._rng.random() < self._parameters.error_rate:
            rating = -rating
        normal_ms = self._rng.normal(self._parameters.mu_ms, self._parameters.sigma_ms)
        delay_ms = normal_ms + self._rng.exponential(self._parameters.tau_ms)
        return shown_ms + max(_SHORTEST_DELAY_MS, float(delay_ms)), rating


@dataclass(frozen=True, slots=True)
class RaterParameters:
    """The parameters of a rater; apart from lapses, P("right") is 1 / (1 + exp(-beta (right - left)))."""

    beta: float = 3.0  # sensitivity to the difference of returns (Bradley and Terry, 1952)
    lapse: float = 0.05  # probability of a random answer
    indifference: float = 0.0  # returns that differ by no more are equal

    def __post_init__(self) -> None:
        """Check that the parameters are within their ranges.

        Raises:
            SimulationError: if a parameter is out of range.
        """
        if not 0 <= self.lapse <= 1:
            raise SimulationError(f"lapse is {self.lapse}; use a probability from 0 to 1")
        for name in ("beta", "indifference"):
            if not 0 <= getattr(self, name) < math.inf:
                raise SimulationError(f"{name} is {getattr(self, name)}; use 0 or more")


class Rater:
    """A rater who compares pairs of returns."""

    def __init__(self, parameters: RaterParameters, rng: np.random.Generator) -> None:
        self._parameters = parameters
        self._rng = rng

    def answer(self, left: float, right: float) -> Literal["left", "right", "equal"]:
        """Return which of two true returns the rater judges to be better, subject to noise.

        Apart from lapses, it is "equal" if they differ by no more than the rater's indifference.
        """
        difference = right - left
        if self._rng.random() < self._parameters.lapse:
            right_probability = 0.5
        elif abs(difference) <= self._parameters.indifference:
            return "equal"
        else:
            log_odds = max(-_MAX_LOG_ODDS, min(_MAX_LOG_ODDS, self._parameters.beta * difference))
            right_probability = 1 / (1 + math.exp(-log_odds))
        if self._rng.random() < right_probability:
            return "right"
        return "left"


REPEAT_MS = 250.0  # between keys while in control
COMPARISON_MS = 1_000.0  # from the end of a pair to the answer
PARAMETERS_BY_PREFIX: dict[str, type[SupervisorParameters | CriticParameters | RaterParameters]] = {
    "": SupervisorParameters,
    "critic_": CriticParameters,
    "rater_": RaterParameters,
}  # by the prefix of the settings' names


EARLIER_NAMES = {
    "least_steps": "min_control_steps",
    "knows_all": "full_knowledge",
    "critic_rate": "critic_response_rate",
    "critic_mistakes": "critic_error_rate",
    "rater_equal_within": "rater_indifference",
}


class SupervisorParticipant(SimulatedTeacher):
    """A supervisor, critic and rater who acts by key presses."""

    def __init__(self, argument: str, rng: np.random.Generator) -> None:
        settings = _parse_settings(argument)
        self._supervisor = Supervisor(SupervisorParameters(**settings[""]), rng)
        self._critic = Critic(CriticParameters(**settings["critic_"]), rng)
        self._rater = Rater(RaterParameters(**settings["rater_"]), rng)
        self._key_of: dict[str, str] = {}
        self._own_step: int | None = None  # the step that its own key led to
        self._last_judged: tuple[int, int | None] | None = None  # the last step that it saw as critic; steps left then

    def begin(self, plan: EpisodePlan, pool: tuple[str, ...], world: World) -> None:
        """Start an episode."""
        self._key_of = {action: key for key, action in reversed(plan.key_map.keys.items())}
        self._supervisor.begin(world)
        self._own_step = None
        self._last_judged = None

    def press(self, world: World) -> KeyPress:
        """Press the key of the next planned action.

        Raises:
            SimulationError: if there is no plan, or the action has no key.
        """
        return self._press_next(world, self._supervisor.plan(world))

    def watch(self, world: World, watched: WatchedStep) -> KeyPress | None:
        """Return the key press that takes over, plays, hands back or rates; None to wait."""
        if watched.good:
            return self._rate_step(world, watched)
        path = self._supervisor.plan(world)
        if watched.who == "agent":
            takes_over = bool(watched.hand_back) and self._supervisor.takes_over(watched.t_ms)
            if not takes_over:
                return None
            return self._press_next(world, path)
        if watched.hand_back and watched.step == self._own_step and self._supervisor.hands_back():
            return KeyPress(watched.hand_back, REPEAT_MS)
        self._own_step = watched.step + 1
        return self._press_next(world, path)

    def correct(self, episode: EpisodeClip) -> int | None:
        """Return the step from which to correct an episode; None if there is nothing to correct.

        It is the step at which the supervisor would have taken over, minus the steps of its patience.
        """
        with closing(World(episode.world, json.loads(episode.options))) as world:
            world.reset(episode.seed)
            self._supervisor.begin(world)
            for step in range(len(episode.actions) + 1):
                self._supervisor.plan(world)
                if self._supervisor.exceeds_patience:
                    return max(0, step - self._supervisor.patience_steps)
                if step < len(episode.actions):
                    world.step(episode.actions[step])
        return None

    def prefer(self, left: EpisodeClip, right: EpisodeClip) -> tuple[PairAnswer, float]:
        """Judge which clip shortened the path by more steps; return the answer and its delay in milliseconds.

        The answer is "cannot_tell" in a world without a planner.
        """
        left_gain = _count_gained_steps(left)
        right_gain = _count_gained_steps(right)
        if left_gain is None or right_gain is None:
            return "cannot_tell", COMPARISON_MS
        return self._rater.answer(left_gain, right_gain), COMPARISON_MS

    def _rate_step(self, world: World, watched: WatchedStep) -> KeyPress | None:
        """Return the key press that rates the last step; None for no rating.

        A step is not rated if the state before it was not seen, as when a press was still due.
        """
        last_judged = self._last_judged
        steps_left: int | None = 0
        if not watched.reached:
            steps_left = _count_steps_left(world)
        self._last_judged = watched.step, steps_left
        if last_judged is None or steps_left is None:
            return None
        last_step, last_steps_left = last_judged
        if last_step + 1 != watched.step or last_steps_left is None:
            return None
        press = self._critic.press(last_steps_left - steps_left, watched.t_ms)
        if press is None:
            return None
        t_ms, rating = press
        key = watched.good if rating > 0 else watched.bad
        return KeyPress(key, t_ms - watched.t_ms)

    def _press_next(self, world: World, path: list[str]) -> KeyPress:
        """Return a press of the key for the first action of a path, with the time between repeated presses.

        Raises:
            SimulationError: if the path is empty, or the action has no key.
        """
        if not path:
            raise SimulationError(
                f"{world.id}: the supervisor found no plan in what it has seen; show it the whole world with "
                "full_knowledge=1"
            )
        return press_action(path[0], self._key_of, world, REPEAT_MS)


def _count_steps_left(world: World) -> int | None:
    """Return the number of steps on the shortest path to the goal; None in a world without a planner."""
    path = world.shortest_path()
    if path is None:
        return None
    return len(path)


def _count_gained_steps(clip: EpisodeClip) -> int | None:
    """Return the number of steps by which a clip shortened the path; None in a world without a planner."""
    with closing(World(clip.world, json.loads(clip.options))) as world:
        world.reset(clip.seed)
        steps_before: int | None = None
        is_reached = False
        for step, action in enumerate(clip.actions):
            if step == clip.first:
                steps_before = _count_steps_left(world)
            change = world.step(action)
            is_reached = change.terminated and change.reward > 0
        steps_after: int | None = 0
        if not is_reached:
            steps_after = _count_steps_left(world)
    if steps_before is None or steps_after is None:
        return None
    return steps_before - steps_after


def _parse_settings(argument: str) -> dict[str, dict[str, Any]]:
    """Parse the settings of a supervisor, such as "patience_steps=6,rater_lapse=0".

    Return the settings of each role by the role's prefix, with the names of its parameters.

    Raises:
        SimulationError: if a name is not a setting, or a value is not valid.
    """
    roles_by_setting = {
        prefix + field.name: (prefix, field) for prefix, role in PARAMETERS_BY_PREFIX.items() for field in fields(role)
    }
    defaults = {name: field.default for name, (_, field) in roles_by_setting.items()}
    settings = read_settings(argument, defaults, SimulationError, owner="supervisor", aliases=EARLIER_NAMES)
    settings_by_prefix: dict[str, dict[str, Any]] = {prefix: {} for prefix in PARAMETERS_BY_PREFIX}
    for name, setting in settings.items():
        prefix, field = roles_by_setting[name]
        settings_by_prefix[prefix][field.name] = setting
    return settings_by_prefix
