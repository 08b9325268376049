"""How logged people look for the goal, told from simulated people whose parameters are known, on the same worlds."""

import multiprocessing
import os
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from minihuman.data.study import Sessions
from minihuman.errors import ReportError
from minihuman.players.human_like import HumanLikePlayer
from minihuman.players.person import Person
from minihuman.power.bare import best_ways, play_bare, playable
from minihuman.power.traces import Trace, counts_of, trace_of
from minihuman.statistics.examples import Examples, learn
from minihuman.study.plan import SessionPlan

SOUGHT = ("lapse", "astray", "misjudge", "forget")
LEAST = 40  # simulated people that anything can be told from
_WIDER = "spread=1.5"  # than the default population, so that whoever is unusual is not out of reach
_STRANGE = 0.01

Numbers = NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Logged:
    """Somebody's plan and what they did."""

    participant: str
    plan: SessionPlan
    traces: tuple[Trace, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Known:
    """Simulated people with their parameters: (n, 4) logarithms of ``SOUGHT``, and of each what they did."""

    parameters: Numbers
    traces: tuple[tuple[Trace, ...], ...]


@dataclass(frozen=True, slots=True)
class FittedSearch:
    """One participant's parameters of looking for the goal, and how well half of the episodes tells the other half."""

    participant: str
    values: dict[str, float]
    intervals: dict[str, tuple[float, float]]  # 95 %
    held_out: tuple[
        float, float, float
    ]  # log excess steps of episodes 2, 4, ...: as it was, as foretold, the population's
    strange: bool  # does what next to none of the simulated people does


@dataclass(frozen=True, slots=True)
class SearchFit:
    """All of a study, and what share of the differences between simulated people its episodes tell."""

    people: tuple[FittedSearch, ...]
    told: dict[str, float]
    simulated: int


def fit_search(sessions: Sessions, *, people: int, seed: int, processes: int | None = None) -> SearchFit:
    """Fit everybody; ``people`` simulated ones play for each group of plans with the same blocks.

    Raises:
        LogError: if there is no such folder.
        ReportError: if there are too few simulated people, or nobody played what they can play.
    """
    if people < LEAST:
        raise ReportError(f"--search is {people}; {LEAST} simulated people are the least, or 0 for none")
    alike: dict[tuple[str, ...], list[Logged]] = {}
    for counted in sessions:
        plan = counted.session.plan
        chosen = [episode for episode in counted.episodes if episode.plan.pace == "on_key"]
        best = best_ways([episode.plan for episode in chosen])
        traces = tuple(trace_of(episode, known) for episode, known in zip(chosen, best, strict=True))
        if sum(len(trace.actions) for trace in traces):
            blocks = tuple(dict.fromkeys(episode.block_name for episode in playable(plan)))
            alike.setdefault(blocks, []).append(Logged(plan.participant.id, plan, traces))
    if not alike:
        raise ReportError(f"{sessions.source}: nobody played anything that simulated people could play too")
    found = [_fit_alike(logged, people=people, seed=seed, processes=processes) for logged in alike.values()]
    return SearchFit(
        tuple(one for fitted, _ in found for one in fitted),
        {name: float(np.mean([told[name] for _, told in found])) for name in (*SOUGHT, "held out")},
        people,
    )


def simulate_known(plans: Sequence[SessionPlan], *, people: int, seed: int, processes: int | None = None) -> Known:
    """Let so many people of a population that is wider than the default play the plans in turn, on all cores."""
    workers = min(processes or os.cpu_count() or 1, people)
    shares = [part.tolist() for part in np.array_split(range(people), workers)]
    work = partial(_play_share, tuple(plans), seed)
    if workers == 1:
        played = [work(shares[0])]
    else:
        with ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn")) as pool:
            played = list(pool.map(work, shares))
    everybody = [one for share in played for one in share]
    return Known(np.array([parameters for parameters, _ in everybody]), tuple(traces for _, traces in everybody))


def parameters_of(person: Person) -> list[float]:
    """The logarithms of ``SOUGHT``."""
    return [float(np.log(max(getattr(person, name), 1e-6))) for name in SOUGHT]


def _play_share(
    plans: tuple[SessionPlan, ...], seed: int, places: Sequence[int]
) -> list[tuple[list[float], tuple[Trace, ...]]]:
    played = []
    for place in places:
        player = HumanLikePlayer(_WIDER, np.random.default_rng([seed, place]))
        played.append((parameters_of(player.person), play_bare(plans[place % len(plans)], player, {})))
    return played


def _fit_alike(
    logged: Sequence[Logged], *, people: int, seed: int, processes: int | None
) -> tuple[list[FittedSearch], dict[str, float]]:
    known = simulate_known([one.plan for one in logged], people=people, seed=seed, processes=processes)
    counts = np.array([counts_of(traces) for traces in known.traces])
    learnt = {name: learn(counts, known.parameters[:, place]) for place, name in enumerate(SOUGHT)}
    halves = np.array([counts_of(traces[::2]) for traces in known.traces])
    others = np.array([_excess(traces[1::2]) for traces in known.traces])
    told_of = ~np.isnan(others)
    foretold = learn(halves[told_of], others[told_of]) if told_of.sum() >= LEAST // 2 else None
    middle = float(np.nanmean(others)) if told_of.any() else float("nan")
    far = _far(counts)
    fitted = [_fitted(one, learnt, foretold, middle, far) for one in logged]
    told = {name: one.told for name, one in learnt.items()}
    return fitted, told | {"held out": float("nan") if foretold is None else foretold.told}


def _fitted(
    one: Logged,
    learnt: dict[str, Examples],
    foretold: Examples | None,
    middle: float,
    far: "_Far",
) -> FittedSearch:
    counts = counts_of(one.traces)
    at = {name: float(examples.predict(counts)[0]) for name, examples in learnt.items()}
    bounds = {name: learnt[name].interval(value) for name, value in at.items()}
    half = counts_of(one.traces[::2]) if one.traces[::2] else counts
    guess = float("nan") if foretold is None else float(foretold.predict(half)[0])
    return FittedSearch(
        participant=one.participant,
        values={name: float(np.exp(value)) for name, value in at.items()},
        intervals={name: (float(np.exp(low)), float(np.exp(high))) for name, (low, high) in bounds.items()},
        held_out=(_excess(one.traces[1::2]), guess, middle),
        strange=far.p(counts) < _STRANGE,
    )


def _excess(traces: Sequence[Trace]) -> float:
    values = np.array([trace.log_excess for trace in traces])
    return float(np.nanmean(values)) if np.isfinite(values).any() else float("nan")


@dataclass(frozen=True, slots=True, eq=False)
class _Far:
    """How far from the middle of simulated people somebody is, in all that is counted."""

    middle: Numbers
    inverse: Numbers

    def p(self, counts: Numbers) -> float:
        """The share of such people that are as far, were what is counted normal."""
        apart = counts - self.middle
        return float(stats.chi2.sf(apart @ self.inverse @ apart, len(apart)))


def _far(counts: Numbers) -> _Far:
    return _Far(counts.mean(axis=0), np.linalg.pinv(np.cov(counts.T)).astype(np.float64))


def lines(fit: SearchFit) -> list[str]:
    """The people, the middle of them as a player, what the episodes tell, and how well half tells the other half."""
    said = []
    for one in fit.people:
        each = ", ".join(
            f"{name} {one.values[name]:.3g} [{one.intervals[name][0]:.2g}, {one.intervals[name][1]:.2g}]"
            for name in SOUGHT
        )
        said.append(
            f"{one.participant}  {each}" + ("  (does what hardly any simulated person does)" if one.strange else "")
        )
    middle = {name: float(np.median([one.values[name] for one in fit.people])) for name in SOUGHT}
    said.append("human-like:" + ",".join(f"{name}={value:.3g}" for name, value in middle.items()))
    told = ", ".join(f"{name} {max(fit.told[name], 0):.0%}" for name in SOUGHT)
    said.append(
        f"Of how {fit.simulated} simulated people differ, such episodes tell {told}; the rest is the population's."
    )
    return [*said, *_foretold(fit)]


def _foretold(fit: SearchFit) -> list[str]:
    rows = np.array([one.held_out for one in fit.people])
    rows = rows[np.isfinite(rows).all(axis=1)]
    if not len(rows):
        return ["No way is known in these worlds, so nothing was foretold."]
    own, others = (float(np.sqrt(((rows[:, 0] - rows[:, place]) ** 2).mean())) for place in (1, 2))
    return [
        f"Log excess steps of every second episode, told from the others of the same person: off by {own:.2f};",
        f"told from the population alone: {others:.2f} ({len(rows)} people, root mean square).",
    ]
