"""What a minute of a person's time teaches: five ways to teach beside each other, judged after the same minutes.

Demonstrations (cloning), takeovers (HG-DAgger; intervention-weighted regression), ratings (TAMER) and comparisons of
stretches (preferences), each with a simulated person of its kind. Everything that a person waits for counts as their
time: the agent's steps that they watch, replays, the pauses between episodes. What a learner computes does not.
"""

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from minihuman.learn.policy.network import Policy
from minihuman.learn.teaching.dataset import Comparison, Dataset
from minihuman.learn.teaching.learner import LearningRequest, make_fresh_policy, make_learner
from minihuman.learn.teaching.preference_learner import (
    PreferenceSettings,
    RewardFitting,
    RewardModel,
    fit_reward,
    optimise_policy,
)
from minihuman.simulation.supervisor import (
    Critic,
    CriticParameters,
    Rater,
    RaterParameters,
    Supervisor,
    SupervisorParameters,
)
from minihuman.worlds.hashing import hash64
from teaching_study.feedback import (
    EASY,
    EMPTY,
    FOUR_ROOMS,
    compute_gains,
    compute_truths,
    rated_episode,
    select_disputed_pairs,
)
from teaching_study.simulation import REPLAY_STEP_MS, TeachingSimulation, begin_teaching, evaluate_taught_policy
from teaching_study.trials import describe_command, format_interval, run_trials, write_results

WAYS = ("cloning", "hg-dagger", "intervention-weighted", "tamer", "preferences")
MARKS_MIN = (5.0, 15.0, 30.0, 60.0)  # minutes of the person's time
LEARN_MIN = (2.5, 5.0, 10.0, 15.0, 22.5, 30.0, 45.0, 60.0)  # after which what plays is learnt anew
STRETCH_STEPS = 6  # of each side of a comparison
ANSWER_MS = 3000.0  # that a person takes for an answer, after both stretches were shown side by side
REWARD, PREFERENCES = RewardFitting(), PreferenceSettings()
FITTING = "updates=400"  # settings of the learners of demonstrations and takeovers
SHOWN_STEPS = 600  # that a policy plays before each round of comparisons; nobody watches all of them


@dataclass(frozen=True, slots=True)
class MinutesTrial:
    """A world to be taught."""

    name: str
    world: str
    actions: int  # how many of the world's the policy knows
    options: dict[str, Any] = field(default_factory=dict)
    most_steps: int = 60
    marks: tuple[float, ...] = MARKS_MIN
    seeds: int = 5  # at most


MINUTES_TRIALS = {
    trial.name: trial
    for trial in (
        MinutesTrial("FourRooms-easy", FOUR_ROOMS, 3, EASY),
        MinutesTrial("Empty-8x8", EMPTY, 3, seeds=3),
    )
}


@dataclass(frozen=True, slots=True)
class MinutesRow:
    """A policy of one way to teach after so many minutes."""

    trial: str
    way: str
    seed: int
    minutes: float
    episodes: int
    given: int  # what the person gave: steps of their own, ratings, or comparisons
    success: float
    cpu_s: float  # of playing, learning and judging, from the beginning on


def run_way(trial: MinutesTrial, way: str, seed: int, *, episodes: int = 200) -> Iterator[MinutesRow]:
    """One way to teach, a row a mark.

    Args:
        trial: where.
        way: one of ``WAYS``.
        seed: of person, layouts and first weights.
        episodes: held-out episodes to judge by.
    """
    began = time.process_time()
    rng = np.random.default_rng(hash64((seed, trial.name, "minutes")) % 2**31)
    dataset, sitting = begin_teaching(
        trial.world, trial.options, actions=trial.actions, most_steps=trial.most_steps, rng=rng
    )
    teach = {"tamer": _rate, "preferences": _compare}.get(way, _steer)
    stops = sorted({*trial.marks, *(stop for stop in LEARN_MIN if stop < trial.marks[-1])})
    for policy, taught in teach(way, sitting, dataset, [stop * 60_000 for stop in stops], seed, rng):
        stop = stops.pop(0)
        if stop not in trial.marks:
            continue
        judged = evaluate_taught_policy(policy, taught, episodes=episodes, seed=1)
        count = len(taught.comparisons or taught.ratings) or taught.labelled_steps
        spent = round(time.process_time() - began, 1)
        yield MinutesRow(trial.name, way, seed, stop, sitting.episodes, count, judged.rate, spent)


Taught = Iterator[tuple[Policy, Dataset]]


def _steer(
    way: str, sitting: TeachingSimulation, dataset: Dataset, stops_ms: Sequence[float], seed: int, rng: Any
) -> Taught:
    """Show whole episodes, or take over from what was learnt so far."""
    supervisor, policy = Supervisor(SupervisorParameters(), rng), None
    for stop_ms in stops_ms:
        while sitting.t_ms < stop_ms:
            layout = hash64((seed, "layout", sitting.episodes)) % 2**31
            watched = None if way == "cloning" else policy
            dataset = dataset.with_more([sitting.watch(watched, layout, supervisor)])
        policy = make_learner(f"{way}:{FITTING}").learn(LearningRequest(dataset, np.random.default_rng(seed))).policy
        yield policy, dataset


def _rate(
    way: str, sitting: TeachingSimulation, dataset: Dataset, stops_ms: Sequence[float], seed: int, rng: Any
) -> Taught:
    """Press for good and bad while the agent plays; it learns between episodes."""
    critic, policy = Critic(CriticParameters(), rng), make_fresh_policy(dataset, rng)
    for stop_ms in stops_ms:
        while sitting.t_ms < stop_ms:
            layout = hash64((seed, "layout", sitting.episodes)) % 2**31
            shown, ratings = rated_episode(sitting, critic, policy, layout)
            dataset = dataset.with_more([shown], ratings)
            if dataset.ratings:
                request = LearningRequest(dataset, np.random.default_rng(seed), policy)
                policy = make_learner(way).learn(request).policy
        yield policy, dataset


def _compare(
    way: str, sitting: TeachingSimulation, dataset: Dataset, stops_ms: Sequence[float], seed: int, rng: Any
) -> Taught:
    """Say which of two stretches is better, those first on which the reward models disagree."""
    rater, policy = Rater(RaterParameters(), rng), make_fresh_policy(dataset, rng)
    model: RewardModel | None = None
    gains: dict[str, list[int]] = {}
    answer_ms, now_ms = STRETCH_STEPS * REPLAY_STEP_MS + ANSWER_MS, 0.0
    for number, stop_ms in enumerate(stops_ms):
        played = 0
        while played < SHOWN_STEPS:
            lesson = sitting.watch(policy, int(rng.integers(2**31)), None)
            dataset, played = dataset.with_more([lesson]), played + len(lesson.actions)
            gains[lesson.name] = compute_gains(sitting.world, lesson)
        count = round((stop_ms - now_ms) / answer_ms)
        asked = select_disputed_pairs(model, dataset, count, steps=STRETCH_STEPS, among=len(dataset.lessons), rng=rng)
        answers = [rater.answer(0.0, truth) for truth in compute_truths(gains, asked)]
        dataset = dataset.with_more(
            comparisons=[Comparison(*pair, said) for pair, said in zip(asked, answers, strict=True)]
        )
        now_ms = stop_ms
        model, _ = fit_reward(dataset, REWARD, rng)
        known = model
        policy = optimise_policy(
            dataset,
            lambda seen, action, _, known=known: known.reward(seen, action),  # type: ignore[misc]
            PREFERENCES,
            start=policy,
            seed=seed + number,
        )
        yield policy, dataset


def run_minutes(
    out: Path, names: Sequence[str], seeds: int, *, workers: int, command: str, episodes: int | None = None
) -> str:
    """Run every world with every seed, what is not in the folder yet; write what came of it; returns the table."""
    jobs = {
        out / "rows" / f"{name}-{way}-seed-{seed}.json": (_run, (name, way, seed, episodes or 200))
        for name in names
        for seed in range(1, min(seeds, MINUTES_TRIALS[name].seeds) + 1)
        for way in WAYS
    }
    numbers = run_trials(jobs, workers=workers)
    text = minutes_table([MinutesRow(**each) for each in numbers], command)
    write_results(out, "minutes", numbers, text, command)
    return text


def _run(name: str, way: str, seed: int, episodes: int) -> list[MinutesRow]:
    return list(run_way(MINUTES_TRIALS[name], way, seed, episodes=episodes))


def minutes_table(rows: Sequence[MinutesRow], command: str) -> str:
    """Success by world and way to teach, a column a mark, in Markdown."""
    last = {(row.trial, row.way, row.seed): row.cpu_s for row in rows}
    spent = sum(last.values())
    lines = [
        "# What a minute of a person's time teaches",
        "",
        "Success in held-out episodes after so many minutes of the person's time: mean and 95 % interval of Student's",
        "t over seeds. Given: the person's own steps, ratings, or comparisons, at the last mark.",
        f"All of it took {spent / 3600:.1f} core-hours.",
    ]
    for trial in dict.fromkeys(row.trial for row in rows):
        mine = [row for row in rows if row.trial == trial]
        marks = sorted({row.minutes for row in mine})
        lines += [
            *("", f"## {trial}", ""),
            f"Seeds: {', '.join(map(str, sorted({row.seed for row in mine})))}.",
            "",
            f"| way to teach | {' | '.join(f'{mark:g} min' for mark in marks)} | given |",
            f"| --- |{' --- |' * (len(marks) + 1)}",
        ]
        for way in dict.fromkeys(row.way for row in mine):
            theirs = {mark: [row for row in mine if (row.way, row.minutes) == (way, mark)] for mark in marks}
            cells = [format_interval([row.success for row in theirs[mark]]) for mark in marks]
            lines.append(f"| {way} | {' | '.join(cells)} | {np.mean([row.given for row in theirs[marks[-1]]]):.0f} |")
    return "\n".join([*lines, "", *describe_command(command)]) + "\n"
