"""Contract tests of simulated participants and agents.

A simulated participant presses valid keys at increasing times, and the same keys from the same random stream. An agent
gives probabilities of the world's actions, does not change the world, and gives the same advice again.
"""

import math
from collections.abc import Callable
from contextlib import closing
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minihuman.agents.agent import BaseAgent, make_agent
from minihuman.display.windows.window import VirtualClock
from minihuman.errors import MinihumanError, PlayerFailedError, SimulationError
from minihuman.experiment.keys import BUTTON_NAMES
from minihuman.experiment.machine.events import KeyPressed, SessionEnded
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.plan.session_plan import EpisodePlan
from minihuman.log.record.recorder import MemoryRecorder
from minihuman.runtime.session_loop import run_session
from minihuman.runtime.simulated_window import SimulatedWindow
from minihuman.simulation.participant import KeyPress, NoPress, SimulatedParticipant, make_participant
from minihuman.testing.checks import ContractError, build_short_study, require
from minihuman.worlds.adapters.world import World

WORLD = "minihuman/MiniGrid-Empty-5x5-v0"
MAX_WAIT_MS = 60_000.0
TimedKeys = list[tuple[int, str]]  # the time of each press in ns, and the key


def check_participant(
    make: str | Callable[[np.random.Generator], SimulatedParticipant],
    world: str = WORLD,
    options: dict[str, Any] | None = None,
    *,
    episodes: int = 2,
    max_steps: int = 40,
    seed: int = 0,
) -> None:
    """Run a simulated participant in a short session twice, from the same random stream, and compare the keys.

    Args:
        make: the player as `minihuman simulate` names it ("human-like:lapse=0.1"), or a function that makes one from a
            random generator.
        world: the id of the world that is played.
        options: the options of the world.
        episodes: the number of episodes.
        max_steps: the step limit of an episode.
        seed: the seed of the player's random generator.

    Raises:
        ContractError: if a guarantee is broken; the message says which.
        SimulationError: if the player cannot play this world.
    """
    first, again = (_record_keys(_make_player(make, seed), world, options or {}, episodes, max_steps) for _ in range(2))
    require(bool(first), "the player pressed no key")
    require(first == again, "from the same chance the player pressed other keys; it draws from something else than rng")


def _make_player(make: str | Callable[[np.random.Generator], SimulatedParticipant], seed: int) -> SimulatedParticipant:
    """Return the player that ``make`` names or makes, with a random generator of this seed, after checking its type."""
    rng = np.random.default_rng(seed)
    player = make_participant(make, rng) if isinstance(make, str) else make(rng)
    require(
        isinstance(player, SimulatedParticipant),
        f"{type(player).__name__} is not a minihuman.simulation.participant.SimulatedParticipant",
    )
    return player


def _record_keys(
    player: SimulatedParticipant, world: str, options: dict[str, Any], episodes: int, max_steps: int
) -> TimedKeys:
    """Run a session with a simulated participant; return the time and key of each press.

    Raises:
        ContractError: if the participant breaks a guarantee, or the session does not come to its end.
        SimulationError: if the participant cannot play this world.
    """
    protocol = build_short_study(world, options, episodes=episodes, max_steps=max_steps)
    clock = VirtualClock()
    recorder = MemoryRecorder()
    session = SessionMachine(expand_protocol(protocol, enrol_participant(protocol, 0)), World, {}, picture_px=None)
    try:
        run_session(session, SimulatedWindow(_WatchedParticipant(player), session, clock), recorder, clock)
    except PlayerFailedError as error:
        if isinstance(error.__cause__, ContractError | SimulationError):
            raise error.__cause__ from None
        require(False, f"the player failed ({error}); in a study its session would end as player_failed")
    if session.failure is not None:
        raise session.failure
    ends = [event for event in recorder.events if isinstance(event, SessionEnded)]
    require(bool(ends) and ends[-1].reason == "complete", "the session did not come to its end with this player")
    return [(event.t_ns, event.key) for event in recorder.events if isinstance(event, KeyPressed)]


class _WatchedParticipant(SimulatedParticipant):
    """A simulated participant whose key presses are checked, and which must not change the world."""

    def __init__(self, player: SimulatedParticipant) -> None:
        self._player = player

    def begin(self, plan: EpisodePlan, pool: tuple[str, ...], world: World) -> None:
        """Let the player begin an episode, and check that the world is unchanged."""
        hash_before = world.state_hash()
        self._player.begin(plan, pool, world)
        require(world.state_hash() == hash_before, "begin() changed the world; a player only looks at it")

    def press(self, world: World) -> KeyPress | NoPress:
        """Return the player's next key press or `NoPress`, after checking that it is valid and the world unchanged."""
        hash_before = world.state_hash()
        press = self._player.press(world)
        require(press is not None, "press() gave no answer; in a study its session would end as player_failed")
        require(world.state_hash() == hash_before, "press() changed the world; a player only looks at it")
        if isinstance(press, NoPress):
            return press
        require(isinstance(press, KeyPress), f"press() gave a {type(press).__name__}, not a KeyPress")
        assert press is not None
        require(press.key in BUTTON_NAMES, f"press() gave the key {press.key!r}, which no keyboard has")
        is_finite = isinstance(press.delay_ms, int | float) and math.isfinite(press.delay_ms)
        require(
            is_finite and 0 <= press.delay_ms <= MAX_WAIT_MS,
            f"press() waits {press.delay_ms!r} ms; a delay is 0 to {MAX_WAIT_MS:.0f}",
        )
        return press


TOLERANCE = 1e-3  # of a sum of probabilities
_CONSEQUENCE = "in a study the person would have to play on, or the episode would end as agent_failed"


def check_agent(
    make: str | Callable[[str], BaseAgent],
    argument: str = "",
    world: str = WORLD,
    options: dict[str, Any] | None = None,
    *,
    episodes: int = 2,
    max_steps: int = 40,
) -> None:
    """Let an agent play the same episodes three times, drawing each action from its probabilities, and compare these.

    Args:
        make: the agent's registered name, or its class.
        argument: the text after the colon of its name.
        world: the id of the world that is played.
        options: the options of the world.
        episodes: the number of episodes.
        max_steps: the step limit of an episode.

    Raises:
        ContractError: if a guarantee is broken; the message says which.
        MinihumanError: if the agent cannot play this world.
    """
    protocol = build_short_study(world, options or {}, episodes=episodes, max_steps=max_steps)
    plans = expand_protocol(protocol, enrol_participant(protocol, 0)).episodes
    agent = _make_agent(make, argument)
    with closing(World(world, options or {}, trusted=True)) as env:
        advice = [_play_episode(agent, plan, env) for plan in plans]
        for name, repeating_agent in (("a new one", _make_agent(make, argument)), ("the same one", agent)):
            repeated_advice = [_play_episode(repeating_agent, plan, env) for plan in plans]
            require(
                all(map(np.array_equal, advice, repeated_advice)),
                f"{name} gave other probabilities in the same episode; nothing may be drawn or kept between episodes",
            )


def _make_agent(make: str | Callable[[str], BaseAgent], argument: str) -> BaseAgent:
    if isinstance(make, str):
        agent = make_agent(f"{make}:{argument}")
    else:
        agent = make(argument)
    require(isinstance(agent, BaseAgent), f"{type(agent).__name__} is not a minihuman.ext.BaseAgent")
    return agent


def _play_episode(agent: BaseAgent, plan: EpisodePlan, world: World) -> NDArray[np.float32]:
    """Play an episode with actions drawn from an agent's probabilities; return these, float32[steps, actions]."""
    rng = np.random.default_rng(plan.seed)
    rows: list[NDArray[np.float32]] = []
    world.reset(plan.seed)
    hash_before = world.state_hash()
    agent.begin(plan, world)
    require(world.state_hash() == hash_before, "begin() changed the world; an agent only looks at it")
    is_over = False
    while not is_over and len(rows) < plan.max_steps:
        rows.append(_read_probabilities(agent, world))
        probabilities = rows[-1].astype(float)
        transition = world.step(int(rng.choice(len(probabilities), p=probabilities / probabilities.sum())))
        is_over = transition.terminated or transition.truncated
    return np.stack(rows)


def _read_probabilities(agent: BaseAgent, world: World) -> NDArray[np.float32]:
    """Return an agent's action probabilities in a world's present state, after checking them, float32[actions]."""
    hash_before = world.state_hash()
    n_actions = len(world.action_names)
    try:
        probabilities = agent.action_probabilities(world)
    except MinihumanError:
        raise
    except Exception as error:
        require(False, f"action_probabilities() raised {type(error).__name__}: {error}; {_CONSEQUENCE}")
    require(world.state_hash() == hash_before, "action_probabilities() changed the world; an agent only looks at it")
    if isinstance(probabilities, np.ndarray):
        form = f"{probabilities.dtype}{list(probabilities.shape)}"
    else:
        form = type(probabilities).__name__
    expected_form = f"float32[{n_actions}]"
    is_expected = form == expected_form
    require(is_expected, f"action_probabilities() gave {form}; it gives {expected_form}, one per action of the world")
    require(
        bool(np.isfinite(probabilities).all() and (probabilities >= 0).all()),
        f"a probability of {probabilities} is below 0 or no number",
    )
    require(
        abs(float(probabilities.sum()) - 1) <= TOLERANCE,
        f"the probabilities sum to {float(probabilities.sum()):.4g}, not to 1",
    )
    return probabilities.copy()
