"""What a takeover is worth: four ways to teach, one simulated person, the same number of the person's steps.

The person demonstrates until the first budget of labelled steps. From then on they go on demonstrating (cloning),
or watch what was learnt so far: they take over (hg-dagger, intervention-weighted), or show it better afterwards
(corrections). At each budget a policy is learnt and evaluated on held-out episodes.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from minihuman.learn.policy.network import Policy
from minihuman.learn.policy.observation import ViewMode
from minihuman.learn.teaching.dataset import Lesson
from minihuman.learn.teaching.learner import LearningRequest, make_learner
from minihuman.simulation.supervisor import Supervisor, SupervisorParameters
from minihuman.worlds.hashing import hash64
from teaching_study.simulation import TeachingSimulation, begin_teaching, evaluate_taught_policy
from teaching_study.trials import (
    describe_command,
    format_interval,
    mean_interval,
    run_trials,
    write_results,
)

# What the person does once there is a policy, by the arm's name; and what learns from it.
ARMS = {
    "cloning": "cloning",
    "hg-dagger": "hg-dagger",
    "corrections": "hg-dagger",
    "intervention-weighted": "intervention-weighted",
}
MOST_EPISODES = 400  # of one budget, should the agent need no help any more


@dataclass(frozen=True, slots=True)
class TakeoverTrial:
    """A world to be taught."""

    name: str
    world: str
    actions: int  # how many of the world's the policy knows
    budgets: tuple[int, ...]  # labelled steps
    ways: tuple[str, ...] = tuple(ARMS)
    sight: ViewMode = "view"
    most_steps: int = 100
    judged: int = 200  # held-out episodes
    fitting: str = "updates=400"  # settings of every way's learner
    supervising: SupervisorParameters = field(default_factory=SupervisorParameters)


DOOR_KEY, FOUR_ROOMS = "minihuman/MiniGrid-DoorKey-8x8-v0", "minihuman/MiniGrid-FourRooms-v0"
TAKEOVER_TRIALS = {
    trial.name: trial
    for trial in (
        TakeoverTrial("DoorKey-8x8", DOOR_KEY, 6, (150, 225, 300, 450, 600)),
        TakeoverTrial("FourRooms", FOUR_ROOMS, 3, (300, 600, 900), ("cloning", "hg-dagger")),
        TakeoverTrial(
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
class TakeoverRow:
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


def run_arm(trial: TakeoverTrial, arm: str, seed: int, *, episodes: int | None = None) -> list[TakeoverRow]:
    """One way to teach, a row a budget. All ways of a seed share the first demonstrations and the policy of these.

    Args:
        trial: where.
        arm: which way.
        seed: of person, layouts and first weights.
        episodes: to judge by; the trial's own number if None.
    """
    chance = np.random.default_rng(hash64((seed, trial.world)) % 2**31)  # the same demonstrations in every arm
    dataset, sitting = begin_teaching(
        trial.world, {}, actions=trial.actions, most_steps=trial.most_steps, rng=chance, sight=trial.sight
    )
    supervisor = Supervisor(trial.supervising, chance)
    policy: Policy | None = None
    played = 0
    rows = list[TakeoverRow]()
    for budget in trial.budgets:
        until = played + MOST_EPISODES
        while dataset.labelled_steps < budget and played < until:
            layout = hash64((seed, "layout", played)) % 2**31
            played += 1
            dataset = dataset.with_more(_taught(sitting, supervisor, arm, policy, layout))
        learner = make_learner(f"{ARMS[arm]}:{trial.fitting}")
        policy = learner.learn(LearningRequest(dataset, np.random.default_rng(seed))).policy
        judged = evaluate_taught_policy(policy, dataset, episodes=episodes or trial.judged, seed=1)
        rows.append(
            TakeoverRow(
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


def _taught(
    sitting: TeachingSimulation, supervisor: Supervisor, arm: str, policy: Policy | None, layout: int
) -> list[Lesson]:
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


def to_rows(numbers: list[dict[str, Any]]) -> list[TakeoverRow]:
    """Rows from plain values."""
    return [TakeoverRow(**each) for each in numbers]


COLOURS = {"cloning": "#666666", "hg-dagger": "#1f4e79", "corrections": "#c05010", "intervention-weighted": "#3a7d44"}

FEWEST_SEEDS = 3  # of which an interval is drawn: that of two reaches from 0 to 1


def run_takeovers(
    out: Path, trials: Sequence[str], seeds: int, *, workers: int, command: str, episodes: int | None = None
) -> str:
    """Run every trial with every seed, those that are not in the folder yet; write what came of it; returns the table.

    ``OUT/rows`` has a small file a trial, way to teach and seed, ``takeovers.json`` all of it, ``takeovers.md`` the
    table, ``takeovers.png`` the figure.
    """
    jobs = {
        out / "rows" / f"{name}-{arm}-seed-{seed}.json": (_run, (name, arm, seed, episodes))
        for name in trials
        for seed in range(1, seeds + 1)
        for arm in TAKEOVER_TRIALS[name].ways
    }
    numbers = run_trials(jobs, workers=workers)
    rows = to_rows(numbers)
    text = takeover_table(rows, command)
    write_results(out, "takeovers", numbers, text, command)
    draw_takeovers(rows, out / "takeovers.png")
    return text


def _run(name: str, arm: str, seed: int, episodes: int | None) -> list[TakeoverRow]:
    return run_arm(TAKEOVER_TRIALS[name], arm, seed, episodes=episodes)


def takeover_table(rows: Sequence[TakeoverRow], command: str) -> str:
    """Success, the person's minutes and how often they took over, in Markdown."""
    lines = ["# What a takeover is worth", ""]
    for trial in dict.fromkeys(row.trial for row in rows):
        mine = [row for row in rows if row.trial == trial]
        seeds = sorted({row.seed for row in mine})
        lines += [
            f"## {trial}",
            "",
            f"Seeds: {', '.join(map(str, seeds))}. Mean and 95 % interval of Student's t over seeds.",
            "",
            (
                "| the person's steps | way to teach | success | the person's minutes | interventions | agent's steps "
                "| seeds |"
            ),
            "| --- | --- | --- | --- | --- | --- | --- |",
        ]
        for budget in sorted({row.budget for row in mine}):
            for arm in ARMS:
                chosen = [row for row in mine if row.budget == budget and row.arm == arm]
                if chosen:
                    minutes, taken, labelled, steps = (
                        float(np.mean([getattr(row, name) for row in chosen]))
                        for name in ("minutes", "interventions", "labelled_steps", "steps")
                    )
                    lines.append(
                        f"| {labelled:.0f} | {arm} | {format_interval([row.success for row in chosen])} "
                        f"| {minutes:.1f} "
                        f"| {taken:.0f} | {steps - labelled:.0f} | {len(chosen)} |"
                    )
        lines.append("")
    return "\n".join([*lines, *describe_command(command)]) + "\n"


def draw_takeovers(rows: Sequence[TakeoverRow], path: Path) -> None:
    """Success over the person's steps and over the person's minutes, a row of panels a world."""
    from matplotlib.figure import Figure

    trials = list(dict.fromkeys(row.trial for row in rows))
    figure = Figure(figsize=(8, 3 * len(trials)), layout="constrained")
    axes = figure.subplots(len(trials), 2, squeeze=False, sharey=True)
    for panels, trial in zip(axes, trials, strict=True):
        for ax, over, words in zip(panels, ("labelled_steps", "minutes"), ("steps", "minutes"), strict=True):
            for arm in ARMS:
                mine = [row for row in rows if row.trial == trial and row.arm == arm]
                budgets = sorted({row.budget for row in mine})
                at = [[row for row in mine if row.budget == budget] for budget in budgets]
                if not at:
                    continue
                x = [float(np.mean([getattr(row, over) for row in some])) for some in at]
                means, lows, highs = zip(*[mean_interval([row.success for row in some]) for some in at], strict=True)
                ax.plot(x, means, marker="o", color=COLOURS[arm], label=arm)
                if min(len(some) for some in at) >= FEWEST_SEEDS:
                    ax.fill_between(x, lows, highs, color=COLOURS[arm], alpha=0.15, linewidth=0)
            ax.set_xlabel(f"the person's {words}")
            ax.set_ylim(0, 1)
            ax.set_title(trial, fontsize=10)
            ax.grid(color="0.9")
        panels[0].set_ylabel("success, held-out episodes")
    axes[0][0].legend(fontsize=8, loc="lower right")
    figure.savefig(path, dpi=110)
