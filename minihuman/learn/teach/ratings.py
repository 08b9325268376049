"""What ratings are worth: an agent that is rated for a quarter of an hour, and what it has learnt by then."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from minihuman.learn.agent.network import Policy
from minihuman.learn.agent.observe import Eyesight
from minihuman.learn.teach.dataset import Dataset, Lesson, Rating
from minihuman.learn.teach.judging import judge
from minihuman.learn.teach.port import make_learner, new_policy
from minihuman.learn.teach.sitting import AGENT_STEP_MS, Sitting
from minihuman.players.critic import Critic, Criticising
from minihuman.players.port import way_of
from minihuman.worlds.adapt.world import World
from minihuman.worlds.hashing import hash64

EMPTY, FOUR_ROOMS = "minihuman/MiniGrid-Empty-8x8-v0", "minihuman/MiniGrid-FourRooms-v0"
LEARNERS = ("tamer", "deep-coach")


@dataclass(frozen=True, slots=True)
class RatedTrial:
    """A world in which an agent is rated."""

    name: str
    world: str
    options: dict[str, Any] = field(default_factory=dict)
    actions: int = 3
    most_steps: int = 60
    minutes: float = 15.0  # of the person's time
    marks: tuple[float, ...] = (5.0, 10.0, 15.0)  # minutes at which the policy is judged


# Start and goal are always the same; the gaps in the walls and where the agent looks at first are drawn anew.
EASY = {"agent_pos": (2, 2), "goal_pos": (7, 7)}  # corners of one room
GAP = {"agent_pos": (4, 4), "goal_pos": (13, 4)}  # one room apart
RATED = {
    trial.name: trial
    for trial in (
        RatedTrial("Empty-8x8", EMPTY),
        RatedTrial("FourRooms-easy", FOUR_ROOMS, EASY),
        RatedTrial("FourRooms-gap", FOUR_ROOMS, GAP),
    )
}


@dataclass(frozen=True, slots=True)
class RatedRow:
    """A policy after so many minutes."""

    trial: str
    learner: str
    seed: int
    minutes: float
    episodes: int
    steps: int
    ratings: int
    delay_ms: float  # the critic's mean
    found_ms: float | None  # what the learner made of it
    success: float


def run_rated(
    trial: RatedTrial, learner: str, seed: int, *, criticising: Criticising | None = None, episodes: int = 100
) -> Iterator[RatedRow]:
    """One agent and one critic; the agent learns between episodes."""
    rng = np.random.default_rng(hash64((seed, trial.name, learner)) % 2**31)
    criticising = criticising or Criticising()
    critic = Critic(criticising, rng)
    world = World(trial.world, trial.options)
    world.reset(0)
    eyesight = Eyesight(missions=False)
    names, space = world.action_names[: trial.actions], eyesight.space(world.unwrapped)
    dataset = Dataset(trial.world, trial.options, names, trial.most_steps, eyesight, space)
    sitting = Sitting(world, eyesight, trial.most_steps, rng)
    policy, found = new_policy(dataset, rng), None
    played, marks = 0, list(trial.marks)
    while marks:
        layout = hash64((seed, "layout", played)) % 2**31
        shown, ratings = rated_episode(sitting, critic, policy, layout)
        dataset, played = dataset.with_more([shown], ratings), played + 1
        if dataset.ratings:
            learned = make_learner(learner).learn(dataset, policy, np.random.default_rng(seed), float("inf"))
            policy, found = learned.policy, learned.notes["delay_ms"]
        if sitting.t_ms / 60_000 >= marks[0]:
            judged = judge(policy, dataset, episodes=episodes, seed=1)
            yield RatedRow(
                trial.name,
                learner,
                seed,
                marks.pop(0),
                played,
                dataset.steps,
                len(dataset.ratings),
                criticising.delay_ms,
                found,
                judged.rate,
            )


def rated_episode(sitting: Sitting, critic: Critic, policy: Policy, layout: int) -> tuple[Lesson, list[Rating]]:
    """The agent plays an episode, and the critic presses now and then."""
    shown = sitting.watch(policy, layout, None)
    world = sitting.world
    world.reset(layout)
    left, ratings = len(way_of(world)), []
    for step, action in enumerate(shown.actions):
        came = world.step(int(action))
        now = 0 if came.terminated else len(way_of(world))
        last = step + 1 == len(shown.actions)
        outcome_ms = shown.shown_ns[step] / 1e6 + AGENT_STEP_MS if last else shown.shown_ns[step + 1] / 1e6
        pressed = critic.press(left - now, outcome_ms)
        if pressed is not None:
            ratings.append(Rating(int(pressed[0] * 1e6), pressed[1], shown.name))
        left = now
    return shown, ratings
