"""What ratings and comparisons are worth, as tables: success by learner, and what was found on the way."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from minihuman.learn.teach.compared import COMPARED, ComparedRow, run_compared
from minihuman.learn.teach.pairing import Pairing
from minihuman.learn.teach.ratings import LEARNERS, RATED, RatedRow, run_rated
from minihuman.learn.teach.trials import ending, run_trials, said, write_results

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
            f"| {said([row.success for row in mine])} | {sum(row.success >= SOLVED for row in mine)} of {len(mine)} "
            f"| {mean_ms} of {mine[0].delay_ms:.0f} ms | {off} |"
        )
    return "\n".join([*lines, "", *ending(command)]) + "\n"


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
        cells = " | ".join(said([getattr(row, name) for row in mine]) for name in names)
        lines.append(f"| {trial} | {pairing} | {len(mine)} | {count} | {cells} | {ratio} |")
    return "\n".join([*lines, "", *ending(command)]) + "\n"


def _rated(name: str, learner: str, seed: int, episodes: int) -> list[RatedRow]:
    return list(run_rated(RATED[name], learner, seed, episodes=episodes))


def _compared(name: str, pairing: Pairing, seed: int, episodes: int) -> list[ComparedRow]:
    return run_compared(COMPARED[name], pairing, seed, episodes=episodes)
