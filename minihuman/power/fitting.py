"""A simulated person's times fitted to logged people, and how well they predict episodes that were held out."""

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import stats

from minihuman.data.study import Sessions
from minihuman.errors import ReportError
from minihuman.players.person import Person
from minihuman.power.search_fit import SOUGHT, SearchFit
from minihuman.statistics.reaction_times import NAMES, Fitted, Times, fit, log_density


@dataclass(frozen=True, slots=True)
class FittedPerson:
    """One participant's fit, and what it tells of every other episode, which it has not seen."""

    participant: str
    fitted: Fitted
    gain: float  # bits a held-out press over a log-normal fitted to the same episodes
    held_out: int  # presses


def fit_people(sessions: Sessions) -> Iterator[FittedPerson]:
    """Fit everybody with enough presses in episodes that count; the middle population's floor is taken as given.

    Raises:
        LogError: if there is no such folder.
        ReportError: if nobody has enough.
    """
    nobody = True
    for session in sessions.rows(with_shortest=False):
        steps = session.rows["steps"].to_pandas()
        if steps.empty:
            continue
        counting = {(facts["episode"], facts["attempt"]) for facts in session.facts}
        counts = [one in counting for one in zip(steps["episode"], steps["attempt"], strict=True)]
        times, episodes = times_of(steps.assign(reaction_ms=steps["reaction_ms"].where(counts)))
        odd = episodes % 2 == 1
        whole, half = fit(times, floor_ms=Person().floor_ms), fit(times[odd], floor_ms=Person().floor_ms)
        if whole is None or half is None:
            continue
        nobody = False
        yield FittedPerson(
            str(steps["participant"].iloc[0]), whole, _gain(half, times[odd], times[~odd]), int((~odd).sum())
        )
    if nobody:
        raise ReportError(f"{sessions.source}: nobody has enough presses to fit a person to")


def times_of(steps: pd.DataFrame) -> tuple[Times, NDArray[np.int64]]:
    """The times that a fit can be told from, with their episodes.

    Left out are an episode's first press, after which one looks round, and a press after one that nothing came of.
    """
    before = steps.shift(1)
    told = (steps["episode"] == before["episode"]) & (steps["attempt"] == before["attempt"])
    told &= before["visible_effect"].astype("boolean").fillna(False).astype(bool) & steps["reaction_ms"].notna()
    kept = steps[told]
    times = Times(
        kept["reaction_ms"].to_numpy(float),
        (steps["key"].astype(str) == before["key"].astype(str))[told].to_numpy(bool),
        np.flatnonzero(told.to_numpy(bool)).astype(np.int64),
    )
    return times, kept["episode"].to_numpy(np.int64)


def _gain(fitted: Fitted, seen: Times, unseen: Times) -> float:
    plain = stats.norm(np.log(seen.ms).mean(), np.log(seen.ms).std())
    base = plain.logpdf(np.log(unseen.ms)) - np.log(unseen.ms)
    told = log_density(unseen, fitted.values, floor_ms=Person().floor_ms)
    above = unseen.ms > Person().floor_ms + 0.5  # a chance and a density cannot be compared
    return float((told - base)[above].mean() / np.log(2)) if above.any() else float("nan")


def lines(found: list[FittedPerson]) -> Iterator[str]:
    """The people, the middle of them as a player, and what the fit is worth."""
    for one in found:
        said = ", ".join(f"{name} {one.fitted.values[name]:.3g}" for name in NAMES)
        yield f"{one.participant}  {said}  ({one.fitted.n} presses; held out: {one.gain:+.2f} bits a press)"
    middle = {name: float(np.median([one.fitted.values[name] for one in found])) for name in NAMES}
    yield "human-like:" + ",".join(f"{name}={value:.4g}" for name, value in middle.items())
    gain = np.mean([one.gain for one in found])
    yield f"On episodes it has not seen the fit tells {gain:+.2f} bits a press more than a log-normal of the others."


def write(found: list[FittedPerson], path: Path, search: SearchFit | None = None) -> Path:
    """Everybody's values and intervals as CSV; of how they look for the goal too where that was fitted."""
    with path.open("w", newline="") as file:
        table = csv.writer(file)
        table.writerow(("participant", "parameter", "value", "low", "high", "presses", "held_out_bits"))
        for one in found:
            for name in NAMES:
                values = one.fitted.values[name], *one.fitted.intervals[name]
                table.writerow((one.participant, name, *values, one.fitted.n, one.gain))
        for looked in search.people if search is not None else ():
            for name in SOUGHT:
                table.writerow((looked.participant, name, looked.values[name], *looked.intervals[name], "", ""))
    return path
