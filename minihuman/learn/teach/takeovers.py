"""What a takeover is worth: four ways to teach, one simulated person, the same number of the person's steps.

The person demonstrates until the first budget of labelled steps. From then on they go on demonstrating (cloning), or
watch what was learnt so far: they take over (hg-dagger, intervention-weighted), or show it better afterwards
(corrections). At each budget a policy is learnt and judged on held-out episodes.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from minihuman.learn.agent.network import Policy
from minihuman.learn.agent.observe import Eyesight, Sight
from minihuman.learn.teach.dataset import Dataset, Lesson
from minihuman.learn.teach.judging import judge
from minihuman.learn.teach.port import make_learner
from minihuman.learn.teach.sitting import Sitting
from minihuman.players.supervisor import Supervising, Supervisor
from minihuman.worlds.adapt.world import World
from minihuman.worlds.hashing import hash64

# What the person does once there is a policy, by the arm's name; and what learns from it.
ARMS = {
    "cloning": "cloning",
    "hg-dagger": "hg-dagger",
    "corrections": "hg-dagger",
    "intervention-weighted": "intervention-weighted",
}
MOST_EPISODES = 400  # of one budget, should the agent need no help any more


@dataclass(frozen=True, slots=True)
class Trial:
    """A world to be taught."""

    name: str
    world: str
    actions: int  # how many of the world's the policy knows
    budgets: tuple[int, ...]  # labelled steps
    ways: tuple[str, ...] = tuple(ARMS)
    sight: Sight = "view"
    most_steps: int = 100
    judged: int = 200  # held-out episodes
    fitting: str = "updates=400"  # settings of every way's learner
    supervising: Supervising = field(default_factory=Supervising)


DOOR_KEY, FOUR_ROOMS = "minihuman/MiniGrid-DoorKey-8x8-v0", "minihuman/MiniGrid-FourRooms-v0"
TRIALS = {
    trial.name: trial
    for trial in (
        Trial("DoorKey-8x8", DOOR_KEY, 6, (150, 225, 300, 450, 600)),
        Trial("FourRooms", FOUR_ROOMS, 3, (300, 600, 900), ("cloning", "hg-dagger")),
        Trial(
            "FourRooms-remembered",
            FOUR_ROOMS,
            3,
            (300, 600, 900, 1200, 1500),
            sight="remembered",
            judged=1_000,  # 200 of them were more than half of cloning's spread over seeds
            fitting="updates=800,batch_size=32,warm_up=200,averaged=0.99",
        ),
    )
}


@dataclass(frozen=True, slots=True)
class Row:
    """A policy of one arm at one budget."""

    trial: str
    arm: str
    seed: int
    budget: int
    labelled_steps: int
    steps: int  # of everybody
    episodes: int
    minutes: float  # of the person's time
    interventions: int
    success: float


def run_arm(trial: Trial, arm: str, seed: int, *, episodes: int | None = None) -> list[Row]:
    """One way to teach, a row a budget. All ways of a seed share the first demonstrations and the policy of these.

    Args:
        trial: where.
        arm: which way.
        seed: of person, layouts and first weights.
        episodes: to judge by; the trial's own number if None.
    """
    world = World(trial.world)
    world.reset(0)
    eyesight = Eyesight(missions=False, sight=trial.sight)
    chance = np.random.default_rng(hash64((seed, trial.world)) % 2**31)  # the same demonstrations in every arm
    sitting = Sitting(world, eyesight, trial.most_steps, chance)
    supervisor = Supervisor(trial.supervising, chance)
    names, space = world.action_names[: trial.actions], eyesight.space(world.unwrapped)
    dataset = Dataset(trial.world, {}, names, trial.most_steps, eyesight, space)
    policy: Policy | None = None
    played = 0
    rows = list[Row]()
    for budget in trial.budgets:
        until = played + MOST_EPISODES
        while dataset.labelled_steps < budget and played < until:
            layout = hash64((seed, "layout", played)) % 2**31
            played += 1
            dataset = dataset.with_more(_taught(sitting, supervisor, arm, policy, layout))
        learner = make_learner(f"{ARMS[arm]}:{trial.fitting}")
        policy = learner.learn(dataset, None, np.random.default_rng(seed), float("inf")).policy
        judged = judge(policy, dataset, episodes=episodes or trial.judged, seed=1)
        rows.append(
            Row(
                trial=trial.name,
                arm=arm,
                seed=seed,
                budget=budget,
                labelled_steps=dataset.labelled_steps,
                steps=dataset.steps,
                episodes=played,
                minutes=round(sitting.t_ms / 60_000, 3),
                interventions=sum(_interventions(lesson) for lesson in dataset.lessons),
                success=judged.rate,
            )
        )
    return rows


def _taught(sitting: Sitting, supervisor: Supervisor, arm: str, policy: Policy | None, layout: int) -> list[Lesson]:
    """What one more episode gives."""
    if policy is None or arm == "cloning":
        return [sitting.watch(None, layout, supervisor)]
    if arm != "corrections":
        return [sitting.watch(policy, layout, supervisor)]
    shown = sitting.watch(policy, layout, None)
    corrected = sitting.correct(shown, supervisor)
    return [shown] if corrected is None else [shown, corrected]


def _interventions(lesson: Lesson) -> int:
    """How often the person took over, or showed it better."""
    if lesson.corrects is not None:
        return 1
    if lesson.is_demonstration:
        return 0
    before = np.concatenate(([False], lesson.by_person[:-1]))
    return int((lesson.by_person & ~before).sum())


def as_rows(numbers: list[dict[str, Any]]) -> list[Row]:
    """Rows from plain values."""
    return [Row(**each) for each in numbers]
