"""What comparisons are worth: a policy plays, a simulated rater compares stretches of it, the policy learns; again.

Beside it the same policy is trained as long on the true reward: by how many steps each step shortens the way.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from minihuman.learn.agent.network import Policy
from minihuman.learn.agent.observe import Eyesight, Observation, Sight
from minihuman.learn.teach.dataset import NOBODY_ASKED, Comparison, Dataset, Lesson
from minihuman.learn.teach.judging import judge
from minihuman.learn.teach.pairing import Pair, Pairing, disputed, draw_pairs
from minihuman.learn.teach.port import new_policy
from minihuman.learn.teach.preferences import PreferenceSettings, optimise
from minihuman.learn.teach.reward_model import RewardFitting, RewardModel, agreement, fit_reward
from minihuman.learn.teach.sitting import Sitting
from minihuman.players.port import way_of
from minihuman.players.rater import Judging, Rater
from minihuman.worlds.adapt.world import World
from minihuman.worlds.hashing import hash64

WANDERING = (0.2, 0.5, 1.0)  # shares of a player's actions that are random, one after the other


@dataclass(frozen=True, slots=True)
class ComparedTrial:
    """A world in which stretches are compared."""

    name: str
    world: str
    actions: int  # how many of the world's the policy knows
    steps: int = 8  # of a stretch: fewer than the shortest way has, or what succeeds is never compared
    sight: Sight = "view"
    most_steps: int = 60
    rounds: tuple[int, ...] = (50, 50, 50, 50)  # comparisons in each
    shown: int = 600  # steps that the policy plays before each round
    held_out: int = 100  # pairs of each round that nobody is asked about
    judging: Judging = field(default_factory=Judging)
    settings: PreferenceSettings = field(default_factory=PreferenceSettings)
    fitting: RewardFitting = field(default_factory=RewardFitting)


COMPARED = {
    trial.name: trial
    for trial in (
        ComparedTrial("Empty-8x8", "minihuman/MiniGrid-Empty-8x8-v0", 3),
        ComparedTrial(
            "Empty-6x6",
            "minihuman/MiniGrid-Empty-6x6-v0",
            3,
            steps=6,
            sight="whole",
            settings=PreferenceSettings(steps=2048),
        ),
        ComparedTrial("DoorKey-5x5", "minihuman/MiniGrid-DoorKey-5x5-v0", 6, steps=6),
    )
}


@dataclass(frozen=True, slots=True)
class ComparedRow:
    """What came of one rater's answers by the end of a round."""

    trial: str
    pairing: str
    seed: int
    comparisons: int
    agreement: float  # with the true order of pairs of the same episodes that nobody was asked about
    agreement_elsewhere: float  # with that of pairs of stretches of players that go astray
    success_learnt: float  # of the policy trained on the learnt reward
    success_true: float  # of the one trained on the true reward for as many steps
    return_learnt: float  # the world's own return, of the same policies
    return_true: float


def run_compared(trial: ComparedTrial, pairing: Pairing, seed: int, *, episodes: int = 200) -> list[ComparedRow]:
    """A row a round."""
    rng = np.random.default_rng(hash64((seed, trial.name, "compared")) % 2**31)
    dataset, sitting = _nothing_yet(trial, rng)
    rater = Rater(trial.judging, rng)
    astray, gained = wander(trial, np.random.default_rng(seed))
    chance = np.random.default_rng(seed)  # of what nobody is asked about
    elsewhere = draw_pairs(astray.lessons, 4 * trial.held_out, steps=trial.steps, rng=chance)
    held_out = list[Pair]()
    learnt = truly = new_policy(dataset, rng)
    model: RewardModel | None = None
    gains: dict[str, list[int]] = {}
    rows = list[ComparedRow]()
    for count in trial.rounds:
        shown = [play(sitting, learnt, int(rng.integers(2**31))) for _ in range(2)]
        while sum(len(lesson.actions) for lesson, _ in shown) < trial.shown:
            shown.append(play(sitting, learnt, int(rng.integers(2**31))))
        dataset = dataset.with_more([lesson for lesson, _ in shown])
        gains |= {lesson.name: each for lesson, each in shown}
        asked = disputed(
            model if pairing == "disputed" else None,
            dataset,
            count,
            steps=trial.steps,
            among=len(dataset.lessons),
            rng=rng,
        )
        others = draw_pairs(dataset.lessons[-len(shown) :], trial.held_out, steps=trial.steps, rng=chance)
        held_out += [pair for pair in others if pair not in asked and pair[::-1] not in asked]
        answers = [rater.answer(0.0, truth) for truth in _truths(gains, asked)]
        dataset = dataset.with_more(
            comparisons=[Comparison(*pair, said) for pair, said in zip(asked, answers, strict=True)]
        )
        model, _ = fit_reward(dataset, trial.fitting, rng)
        known = model
        learnt = optimise(
            dataset,
            lambda seen, action, _, known=known: known.reward(seen, action),  # type: ignore[misc]
            trial.settings,
            start=learnt,
            seed=seed + len(rows),
        )
        truly = optimise(dataset, Progress(), trial.settings, start=truly, seed=seed + len(rows))
        by_learnt, by_truth = (judge(policy, dataset, episodes=episodes, seed=1) for policy in (learnt, truly))
        rows.append(
            ComparedRow(
                trial.name,
                pairing,
                seed,
                len(dataset.comparisons),
                agreement(model, dataset, held_out, _truths(gains, held_out)),
                agreement(model, astray, elsewhere, _truths(gained, elsewhere)),
                by_learnt.rate,
                by_truth.rate,
                by_learnt.mean_return,
                by_truth.mean_return,
            )
        )
    return rows


class Progress:
    """The true reward: by how many steps each step shortens the way."""

    def __init__(self) -> None:
        self._left: int | None = None

    def __call__(self, seen: Observation, action: int, world: Any) -> float:
        """Of the step that was just made; 0 for the first of an episode, whose way nobody looked at before."""
        state = world.state
        now = len(world.way() or ()) if state.step < state.max_steps else 0
        left, self._left = self._left, now
        return 0.0 if left is None or state.step == 1 else float(left - now)


def play(sitting: Sitting, policy: Policy, layout: int) -> tuple[Lesson, list[int]]:
    """An episode of a policy, and by how much each of its steps shortened the way."""
    shown = sitting.watch(policy, layout, None)
    return shown, gains_of(sitting.world, shown)


def gains_of(world: World, shown: Lesson) -> list[int]:
    """By how much each step of an episode shortened the way; it is played again for that."""
    world.reset(shown.seed)
    left, gained = len(way_of(world)), []
    for action in shown.actions:
        came = world.step(int(action))
        now = 0 if came.terminated else len(way_of(world))
        gained.append(left - now)
        left = now
    return gained


def wander(
    trial: ComparedTrial, rng: np.random.Generator, *, steps: int = 1500
) -> tuple[Dataset, dict[str, list[int]]]:
    """Episodes of a player that goes astray, more and less; and what each step gained, by the lesson's name."""
    dataset, sitting = _nothing_yet(trial, rng)
    world = sitting.world
    lessons, gains = list[Lesson](), dict[str, list[int]]()
    while sum(len(lesson.actions) for lesson in lessons) < steps:
        astray = WANDERING[len(lessons) % len(WANDERING)]
        layout = int(rng.integers(2**31))
        sitting.begin(layout)
        ended = False
        while not ended:
            seen = sitting.looker.see(world.unwrapped, world.observation)
            wise = way_of(world)[0]
            action = int(rng.integers(trial.actions)) if rng.random() < astray else world.action_names.index(wise)
            ended = sitting.step(seen, action, False, NOBODY_ASKED, None)
        lessons.append(sitting.lesson(layout))
        gains[lessons[-1].name] = gains_of(world, lessons[-1])
    return dataset.with_more(lessons), gains


def _nothing_yet(trial: ComparedTrial, rng: np.random.Generator) -> tuple[Dataset, Sitting]:
    world = World(trial.world)
    world.reset(0)
    eyesight = Eyesight(missions=False, sight=trial.sight)
    names, space = world.action_names[: trial.actions], eyesight.space(world.unwrapped)
    dataset = Dataset(trial.world, {}, names, trial.most_steps, eyesight, space)
    return dataset, Sitting(world, eyesight, trial.most_steps, rng)


def _truths(gains: dict[str, list[int]], pairs: Sequence[Pair]) -> list[float]:
    """How much better the right side of each pair is than its left."""
    worths = [[sum(gains[side.lesson][side.first : side.last + 1]) for side in pair] for pair in pairs]
    return [float(right - left) for left, right in worths]
