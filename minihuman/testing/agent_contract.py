"""Contract test of agents: probabilities of the world's actions, a world that stays as it is, and the same advice in
the same episode.
"""

from collections.abc import Callable
from contextlib import closing
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minihuman.agents.agent import BaseAgent, make_agent
from minihuman.errors import MinihumanError
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.plan.session_plan import EpisodePlan
from minihuman.testing.checks import build_short_study, require
from minihuman.worlds.adapters.world import World

WORLD = "minihuman/MiniGrid-Empty-5x5-v0"
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
    """Let an agent play episodes twice, each action drawn from its probabilities, and compare.

    Args:
        make: The agent's registered name, or its class.
        argument: The text after the colon of its name.
        world: The world it plays, an id.
        options: Keyword arguments of the world.
        episodes: The number of episodes.
        max_steps: The step limit of each.

    Raises:
        ContractError: if a promise is not kept; it says which.
        MinihumanError: if it cannot play this world.
    """
    protocol = build_short_study(world, options or {}, episodes=episodes, max_steps=max_steps)
    plans = expand_protocol(protocol, enrol_participant(protocol, 0)).episodes
    agent = _make(make, argument)
    with closing(World(world, options or {}, trusted=True)) as env:
        advice = [_play(agent, plan, env) for plan in plans]
        for again, of in ((_make(make, argument), "a new one"), (agent, "the same one")):
            same = [_play(again, plan, env) for plan in plans]
            require(
                all(np.array_equal(one, other) for one, other in zip(advice, same, strict=True)),
                f"{of} gave other probabilities in the same episode; nothing may be drawn or kept between episodes",
            )


def _make(make: str | Callable[[str], BaseAgent], argument: str) -> BaseAgent:
    agent = make_agent(f"{make}:{argument}") if isinstance(make, str) else make(argument)
    require(isinstance(agent, BaseAgent), f"{type(agent).__name__} is not a minihuman.ext.BaseAgent")
    return agent


def _play(agent: BaseAgent, plan: EpisodePlan, world: World) -> NDArray[np.float32]:
    """Play one episode; return the probabilities of every step, (steps, actions)."""
    rng, rows = np.random.default_rng(plan.seed), list[NDArray[np.float32]]()
    world.reset(plan.seed)
    before = world.state_hash()
    agent.begin(plan, world)
    require(world.state_hash() == before, "begin() changed the world; an agent only looks at it")
    ended = False
    while not ended and len(rows) < plan.max_steps:
        rows.append(_read_probabilities(agent, world))
        chances = rows[-1].astype(float)
        came = world.step(int(rng.choice(len(chances), p=chances / chances.sum())))
        ended = came.terminated or came.truncated
    return np.stack(rows)


def _read_probabilities(agent: BaseAgent, world: World) -> NDArray[np.float32]:
    before, n = world.state_hash(), len(world.action_names)
    try:
        found = agent.action_probabilities(world)
    except MinihumanError:
        raise
    except Exception as error:
        require(False, f"action_probabilities() raised {type(error).__name__}: {error}; {_CONSEQUENCE}")
    require(world.state_hash() == before, "action_probabilities() changed the world; an agent only looks at it")
    is_row = isinstance(found, np.ndarray) and found.shape == (n,) and found.dtype == np.float32
    what = f"{found.dtype}{list(found.shape)}" if isinstance(found, np.ndarray) else type(found).__name__
    require(is_row, f"action_probabilities() gave {what}; it gives float32[{n}], one per action of the world")
    require(bool(np.isfinite(found).all() and (found >= 0).all()), f"a probability of {found} is below 0 or no number")
    require(abs(float(found.sum()) - 1) <= TOLERANCE, f"the probabilities sum to {float(found.sum()):.4g}, not to 1")
    return found.copy()
