"""Fit a simulated participant's reaction times to logged people, and measure how well the fit predicts held-out
episodes.
"""

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import stats

from minihuman.dataset.sessions import StudySessions
from minihuman.errors import ReportError
from minihuman.simulation.human_like import ParticipantParameters
from minihuman.statistics.reaction_times import (
    PARAMETER_NAMES,
    ReactionTimeFit,
    ReactionTimes,
    fit_reaction_times,
    log_density,
)


@dataclass(frozen=True, slots=True)
class FittedParticipant:
    """One participant's fit, and its gain on every second episode, which it has not seen."""

    participant: str
    fitted: ReactionTimeFit
    gain: float  # bits per held-out press over a log-normal fitted to the same episodes
    held_out: int  # presses


def fit_participants(sessions: StudySessions) -> Iterator[FittedParticipant]:
    """Fit every participant with enough presses in included episodes; the floor is the population's median.

    Raises:
        LogError: if there is no such folder.
        ReportError: if no participant has enough.
    """
    found = False
    for session in sessions.rows(with_shortest=False):
        steps = session.rows["steps"].to_pandas()
        if steps.empty:
            continue
        counting = {(facts["episode"], facts["attempt"]) for facts in session.facts}
        counts = [one in counting for one in zip(steps["episode"], steps["attempt"], strict=True)]
        times, episodes = select_reaction_times(steps.assign(response_ms=steps["response_ms"].where(counts)))
        odd = episodes % 2 == 1
        whole, half = (
            fit_reaction_times(times, floor_ms=ParticipantParameters().floor_ms),
            fit_reaction_times(times[odd], floor_ms=ParticipantParameters().floor_ms),
        )
        if whole is None or half is None:
            continue
        found = True
        yield FittedParticipant(
            str(steps["participant"].iloc[0]), whole, _gain(half, times[odd], times[~odd]), int((~odd).sum())
        )
    if not found:
        raise ReportError(f"{sessions.source}: no participant has enough key presses for a fit; record more episodes")


def select_reaction_times(steps: pd.DataFrame) -> tuple[ReactionTimes, NDArray[np.int64]]:
    """Select the reaction times to fit, with their episodes.

    Excluded are an episode's first press and a press after an ineffective one.
    """
    before = steps.shift(1)
    told = (steps["episode"] == before["episode"]) & (steps["attempt"] == before["attempt"])
    told &= before["visible_effect"].astype("boolean").fillna(False).astype(bool) & steps["response_ms"].notna()
    kept = steps[told]
    times = ReactionTimes(
        kept["response_ms"].to_numpy(float),
        (steps["key"].astype(str) == before["key"].astype(str))[told].to_numpy(bool),
        np.flatnonzero(told.to_numpy(bool)).astype(np.int64),
    )
    return times, kept["episode"].to_numpy(np.int64)


def _gain(fitted: ReactionTimeFit, seen: ReactionTimes, unseen: ReactionTimes) -> float:
    plain = stats.norm(np.log(seen.ms).mean(), np.log(seen.ms).std())
    base = plain.logpdf(np.log(unseen.ms)) - np.log(unseen.ms)
    told = log_density(unseen, fitted.values, floor_ms=ParticipantParameters().floor_ms)
    above = unseen.ms > ParticipantParameters().floor_ms + 0.5  # a chance and a density cannot be compared
    return float((told - base)[above].mean() / np.log(2)) if above.any() else float("nan")


def describe_fits(found: list[FittedParticipant]) -> Iterator[str]:
    """Describe each participant's fit, the median participant, and the gain on held-out episodes."""
    for one in found:
        said = ", ".join(f"{name} {one.fitted.values[name]:.3g}" for name in PARAMETER_NAMES)
        yield f"{one.participant}  {said}  ({one.fitted.n} presses; held out: {one.gain:+.2f} bits per press)"
    middle = {name: float(np.median([one.fitted.values[name] for one in found])) for name in PARAMETER_NAMES}
    yield "human-like:" + ",".join(f"{name}={value:.4g}" for name, value in middle.items())
    gain = np.mean([one.gain for one in found])
    yield f"On held-out episodes the fit predicts {gain:+.2f} bits per press better than a log-normal."


def write_fits(found: list[FittedParticipant], path: Path) -> Path:
    """Write all values and intervals as CSV."""
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(("participant", "parameter", "value", "low", "high", "presses", "held_out_bits"))
        for one in found:
            for name in PARAMETER_NAMES:
                values = one.fitted.values[name], *one.fitted.intervals[name]
                table.writerow((one.participant, name, *values, one.fitted.n, one.gain))
    return path
