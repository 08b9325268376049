"""What ratings and comparisons are worth: an agent that is rated for a quarter of an hour, and one whose fragments are
compared.

Beside the comparisons the same policy is trained as long on the true reward: by how many steps each step shortens
the shortest path.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from minihuman.agents.goal_search import find_shortest_path
from minihuman.errors import LearnError
from minihuman.learn.policy.network import Policy
from minihuman.learn.policy.observation import Observation, ViewMode
from minihuman.learn.teaching.dataset import NO_QUERY, Comparison, Dataset, Lesson, LessonFragment, LessonRating
from minihuman.learn.teaching.learner import LearningRequest, collect_steps, make_fresh_policy, make_learner
from minihuman.learn.teaching.preference_learner import (
    Pair,
    PreferenceSettings,
    RewardFitting,
    RewardModel,
    compute_disagreement,
    fit_reward,
    get_first_rows,
    optimise_policy,
)
from minihuman.simulation.supervisor import Critic, CriticParameters, Rater, RaterParameters
from minihuman.worlds.adapters.world import World
from minihuman.worlds.hashing import hash64
from teaching_study.simulation import AGENT_STEP_MS, TeachingSimulation, begin_teaching, evaluate_taught_policy
from teaching_study.trials import describe_command, format_interval, run_trials, write_results

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
    trial: RatedTrial, learner: str, seed: int, *, criticising: CriticParameters | None = None, episodes: int = 100
) -> Iterator[RatedRow]:
    """One agent and one critic; the agent learns between episodes."""
    rng = np.random.default_rng(hash64((seed, trial.name, learner)) % 2**31)
    criticising = criticising or CriticParameters()
    critic = Critic(criticising, rng)
    dataset, sitting = begin_teaching(
        trial.world, trial.options, actions=trial.actions, most_steps=trial.most_steps, rng=rng
    )
    policy, found = make_fresh_policy(dataset, rng), None
    played, marks = 0, list(trial.marks)
    while marks:
        layout = hash64((seed, "layout", played)) % 2**31
        shown, ratings = rated_episode(sitting, critic, policy, layout)
        dataset, played = dataset.with_more([shown], ratings), played + 1
        if dataset.ratings:
            learned = make_learner(learner).learn(LearningRequest(dataset, np.random.default_rng(seed), policy))
            policy, found = learned.policy, learned.notes["delay_ms"]
        if sitting.t_ms / 60_000 >= marks[0]:
            judged = evaluate_taught_policy(policy, dataset, episodes=episodes, seed=1)
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


def rated_episode(
    sitting: TeachingSimulation, critic: Critic, policy: Policy, layout: int
) -> tuple[Lesson, list[LessonRating]]:
    """The agent plays an episode, and the critic presses now and then."""
    shown = sitting.watch(policy, layout, None)
    world = sitting.world
    world.reset(layout)
    left, ratings = len(find_shortest_path(world)), []
    for step, action in enumerate(shown.actions):
        came = world.step(int(action))
        now = 0 if came.terminated else len(find_shortest_path(world))
        last = step + 1 == len(shown.actions)
        outcome_ms = shown.shown_ns[step] / 1e6 + AGENT_STEP_MS if last else shown.shown_ns[step + 1] / 1e6
        pressed = critic.press(left - now, outcome_ms)
        if pressed is not None:
            ratings.append(LessonRating(int(pressed[0] * 1e6), pressed[1], shown.name))
        left = now
    return shown, ratings


WANDERING = (0.2, 0.5, 1.0)  # shares of a player's actions that are random, one after the other


@dataclass(frozen=True, slots=True)
class ComparedTrial:
    """A world in which stretches are compared."""

    name: str
    world: str
    actions: int  # how many of the world's the policy knows
    steps: int = 8  # of a stretch: fewer than the shortest way has, or what succeeds is never compared
    sight: ViewMode = "view"
    most_steps: int = 60
    rounds: tuple[int, ...] = (50, 50, 50, 50)  # comparisons in each
    shown: int = 600  # steps that the policy plays before each round
    held_out: int = 100  # pairs of each round that nobody is asked about
    judging: RaterParameters = field(default_factory=RaterParameters)
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


def run_compared(trial: ComparedTrial, pairing: "Pairing", seed: int, *, episodes: int = 200) -> list[ComparedRow]:
    """A row a round."""
    rng = np.random.default_rng(hash64((seed, trial.name, "compared")) % 2**31)
    dataset, sitting = begin_teaching(
        trial.world, {}, actions=trial.actions, most_steps=trial.most_steps, rng=rng, sight=trial.sight
    )
    rater = Rater(trial.judging, rng)
    astray, gained = play_wandering(trial, np.random.default_rng(seed))
    chance = np.random.default_rng(seed)  # of what nobody is asked about
    elsewhere = draw_pairs(astray.lessons, 4 * trial.held_out, steps=trial.steps, rng=chance)
    held_out = list[Pair]()
    learnt = truly = make_fresh_policy(dataset, rng)
    model: RewardModel | None = None
    gains: dict[str, list[int]] = {}
    rows = list[ComparedRow]()
    for count in trial.rounds:
        shown = [play_policy(sitting, learnt, int(rng.integers(2**31))) for _ in range(2)]
        while sum(len(lesson.actions) for lesson, _ in shown) < trial.shown:
            shown.append(play_policy(sitting, learnt, int(rng.integers(2**31))))
        dataset = dataset.with_more([lesson for lesson, _ in shown])
        gains |= {lesson.name: each for lesson, each in shown}
        asked = select_disputed_pairs(
            model if pairing == "disputed" else None,
            dataset,
            count,
            steps=trial.steps,
            among=len(dataset.lessons),
            rng=rng,
        )
        others = draw_pairs(dataset.lessons[-len(shown) :], trial.held_out, steps=trial.steps, rng=chance)
        held_out += [pair for pair in others if pair not in asked and pair[::-1] not in asked]
        answers = [rater.answer(0.0, truth) for truth in compute_truths(gains, asked)]
        dataset = dataset.with_more(
            comparisons=[Comparison(*pair, said) for pair, said in zip(asked, answers, strict=True)]
        )
        model, _ = fit_reward(dataset, trial.fitting, rng)
        known = model
        learnt = optimise_policy(
            dataset,
            lambda seen, action, _, known=known: known.reward(seen, action),  # type: ignore[misc]
            trial.settings,
            start=learnt,
            seed=seed + len(rows),
        )
        truly = optimise_policy(dataset, Progress(), trial.settings, start=truly, seed=seed + len(rows))
        by_learnt, by_truth = (
            evaluate_taught_policy(policy, dataset, episodes=episodes, seed=1) for policy in (learnt, truly)
        )
        rows.append(
            ComparedRow(
                trial.name,
                pairing,
                seed,
                len(dataset.comparisons),
                compute_pair_agreement(model, dataset, held_out, compute_truths(gains, held_out)),
                compute_pair_agreement(model, astray, elsewhere, compute_truths(gained, elsewhere)),
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
        now = len(world.shortest_path() or ()) if state.step < state.max_steps else 0
        left, self._left = self._left, now
        return 0.0 if left is None or state.step == 1 else float(left - now)


def play_policy(sitting: TeachingSimulation, policy: Policy, layout: int) -> tuple[Lesson, list[int]]:
    """An episode of a policy, and by how much each of its steps shortened the way."""
    shown = sitting.watch(policy, layout, None)
    return shown, compute_gains(sitting.world, shown)


def compute_gains(world: World, shown: Lesson) -> list[int]:
    """By how much each step of an episode shortened the way; it is played again for that."""
    world.reset(shown.seed)
    left, gained = len(find_shortest_path(world)), []
    for action in shown.actions:
        came = world.step(int(action))
        now = 0 if came.terminated else len(find_shortest_path(world))
        gained.append(left - now)
        left = now
    return gained


def play_wandering(
    trial: ComparedTrial, rng: np.random.Generator, *, steps: int = 1500
) -> tuple[Dataset, dict[str, list[int]]]:
    """Episodes of a player that goes astray, more and less; and what each step gained, by the lesson's name."""
    dataset, sitting = begin_teaching(
        trial.world, {}, actions=trial.actions, most_steps=trial.most_steps, rng=rng, sight=trial.sight
    )
    world = sitting.world
    lessons, gains = list[Lesson](), dict[str, list[int]]()
    while sum(len(lesson.actions) for lesson in lessons) < steps:
        astray = WANDERING[len(lessons) % len(WANDERING)]
        layout = int(rng.integers(2**31))
        sitting.begin(layout)
        ended = False
        while not ended:
            seen = sitting.encoder.encode(world.unwrapped, world.observation)
            wise = find_shortest_path(world)[0]
            action = int(rng.integers(trial.actions)) if rng.random() < astray else world.action_names.index(wise)
            ended = sitting.step(seen, action, False, NO_QUERY, None)
        lessons.append(sitting.lesson(layout))
        gains[lessons[-1].name] = compute_gains(world, lessons[-1])
    return dataset.with_more(lessons), gains


def compute_truths(gains: dict[str, list[int]], pairs: Sequence[Pair]) -> list[float]:
    """How much better the right side of each pair is than its left."""
    worths = [[sum(gains[side.lesson][side.first : side.last + 1]) for side in pair] for pair in pairs]
    return [float(right - left) for left, right in worths]


Pairing = Literal["random", "disputed"]
CANDIDATES = 10  # pairs that are looked at for one that is asked about


def draw_pairs(lessons: Sequence[Lesson], count: int, *, steps: int, rng: np.random.Generator) -> list[Pair]:
    """Pairs of stretches of one length; every lesson that is long enough is as likely as another.

    Raises:
        LearnError: if there are no two stretches of that length.
    """
    long = [lesson for lesson in lessons if len(lesson.actions) >= steps]
    if sum(len(lesson.actions) - steps + 1 for lesson in long) < 2:
        raise LearnError(
            f"there are no two stretches of {steps} steps in {len(lessons)} episodes; compare shorter ones"
        )
    pairs = list[Pair]()
    while len(pairs) < count:
        left, right = (_stretch(long, steps, rng) for _ in range(2))
        if left != right:
            pairs.append((left, right))
    return pairs


def select_disputed_pairs(
    model: RewardModel | None, dataset: Dataset, count: int, *, steps: int, among: int, rng: np.random.Generator
) -> list[Pair]:
    """The pairs of ten times as many whose order the model's members disagree on most; any, without a model.

    Christiano and others (2017): the variance of what an ensemble foretells.

    Args:
        model: What was learnt from the answers so far.
        dataset: The lessons.
        count: How many pairs.
        steps: The length of a stretch.
        among: Stretches are taken from so many of the last lessons.
        rng: Draws the candidates.

    Raises:
        LearnError: if there are no two stretches of that length.
    """
    lessons = dataset.lessons[-among:]
    if model is None:
        return draw_pairs(lessons, count, steps=steps, rng=rng)
    pairs = draw_pairs(lessons, CANDIDATES * count, steps=steps, rng=rng)
    order = np.argsort(-compute_disagreement(model, dataset, pairs), kind="stable")
    return [pairs[place] for place in order[:count]]


def _stretch(lessons: Sequence[Lesson], steps: int, rng: np.random.Generator) -> LessonFragment:
    lesson = lessons[int(rng.integers(len(lessons)))]
    first = int(rng.integers(len(lesson.actions) - steps + 1))
    return LessonFragment(lesson.name, first, first + steps - 1)


def compute_pair_agreement(
    model: RewardModel, dataset: Dataset, pairs: Sequence[tuple[LessonFragment, LessonFragment]], truth: Sequence[float]
) -> float:
    """The share of pairs that the model puts in the order of the truth (right minus left; ties are left out)."""
    steps, first = collect_steps(dataset.lessons), get_first_rows(dataset)
    rewards = model.rewards(steps.observations, steps.actions)
    said = [_sum(rewards, first, right) - _sum(rewards, first, left) for left, right in pairs]
    right = [(one > 0) == (true > 0) for one, true in zip(said, truth, strict=True) if true != 0]
    return float(np.mean(right))


def _sum(rewards: NDArray[np.float64], first: dict[str, int], side: LessonFragment) -> float:
    start = first[side.lesson]
    return float(rewards[start + side.first : start + side.last + 1].sum())


PAIRINGS: tuple[Pairing, ...] = ("random", "disputed")
SOLVED = 0.9  # success


def run_ratings(out: Path, trials: Sequence[str], seeds: int, *, workers: int, command: str, episodes: int) -> str:
    """Run every rating trial that is not in the folder yet; write ``ratings.json`` and ``.md``; returns the table."""
    jobs = {
        out / "rows" / f"{name}-{learner}-seed-{seed}.json": (_rated, (name, learner, seed, episodes))
        for name in trials
        for learner in LEARNERS
        for seed in range(1, seeds + 1)
    }
    rows = run_trials(jobs, workers=workers)
    text = rating_table([RatedRow(**row) for row in rows], command)
    write_results(out, "ratings", rows, text, command)
    return text


def run_comparisons(
    out: Path,
    trials: Sequence[str],
    pairings: Sequence[Pairing],
    seeds: int,
    *,
    workers: int,
    command: str,
    episodes: int,
) -> str:
    """Run every comparison trial that is not in the folder yet; write ``comparisons.json`` and ``.md``."""
    jobs = {
        out / "rows" / f"{name}-{pairing}-seed-{seed}.json": (_compared, (name, pairing, seed, episodes))
        for name in trials
        for pairing in pairings
        for seed in range(1, seeds + 1)
    }
    rows = run_trials(jobs, workers=workers)
    text = comparison_table([ComparedRow(**row) for row in rows], command)
    write_results(out, "comparisons", rows, text, command)
    return text


def rating_table(rows: Sequence[RatedRow], command: str) -> str:
    """Success by world, learner and minutes, and the delay that was found, in Markdown."""
    lines = [
        "# What ratings are worth",
        "",
        f"Mean and 95 % interval of Student's t over seeds; solved: success of {SOLVED} or more in held-out episodes.",
        "",
        "| world | learner | the person's minutes | presses | success | solved | delay found, of | farthest off |",
        "| --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for trial, learner, minutes in dict.fromkeys((row.trial, row.learner, row.minutes) for row in rows):
        mine = [row for row in rows if (row.trial, row.learner, row.minutes) == (trial, learner, minutes)]
        found = [row.found_ms for row in mine if row.found_ms is not None]
        off = f"{max(abs(each - mine[0].delay_ms) for each in found):.0f} ms" if found else "-"
        mean_ms = f"{np.mean(found):.0f}" if found else "none"
        lines.append(
            f"| {trial} | {learner} | {minutes:g} | {np.mean([row.ratings for row in mine]):.0f} "
            f"| {format_interval([row.success for row in mine])} "
            f"| {sum(row.success >= SOLVED for row in mine)} of {len(mine)} "
            f"| {mean_ms} of {mine[0].delay_ms:.0f} ms | {off} |"
        )
    return "\n".join([*lines, "", *describe_command(command)]) + "\n"


def comparison_table(rows: Sequence[ComparedRow], command: str) -> str:
    """Agreement and success by world, pairing and number of comparisons, in Markdown."""
    lines = [
        "# What comparisons are worth",
        "",
        "Mean and 95 % interval of Student's t over seeds. Agreement is with the true order of pairs that nobody was",
        "asked about: of the episodes that were compared, and of players that go astray.",
        "",
        "| world | pairs | seeds | comparisons | agreement | elsewhere | success | on true reward | ratio of returns |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    for trial, pairing, count in dict.fromkeys((row.trial, row.pairing, row.comparisons) for row in rows):
        mine = [row for row in rows if (row.trial, row.pairing, row.comparisons) == (trial, pairing, count)]
        learnt, true = (sum(getattr(row, name) for row in mine) for name in ("return_learnt", "return_true"))
        ratio = f"{learnt / true:.2f}" if true else "-"
        names = ("agreement", "agreement_elsewhere", "success_learnt", "success_true")
        cells = " | ".join(format_interval([getattr(row, name) for row in mine]) for name in names)
        lines.append(f"| {trial} | {pairing} | {len(mine)} | {count} | {cells} | {ratio} |")
    return "\n".join([*lines, "", *describe_command(command)]) + "\n"


def _rated(name: str, learner: str, seed: int, episodes: int) -> list[RatedRow]:
    return list(run_rated(RATED[name], learner, seed, episodes=episodes))


def _compared(name: str, pairing: "Pairing", seed: int, episodes: int) -> list[ComparedRow]:
    return run_compared(COMPARED[name], pairing, seed, episodes=episodes)
