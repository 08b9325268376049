"""How well `minihuman fit` finds simulated people's parameters: intervals, how many are reported, held-out bits.

``python analysis/fit_recovery.py [--people 60] [--out analysis/fit_recovery.csv]`` draws people from the package's own
generator, with pauses in 2 % of presses and a lag-1 correlation of 0.4 or without, and fits 150 to 600 presses of each.
"""

import argparse
import csv
from pathlib import Path

import numpy as np

from minihuman.planning.reaction_time_fit import PARAMETER_NAMES, ReactionTimes, fit_reaction_times, measure_gain
from minihuman.simulation.human_like import ParticipantPopulation

COLUMNS = ("times", "presses", "parameter", "people", "reported", "held", "median_ratio", "held_out_bits")
KINDS = {"own ex-Gaussian": "", "2 % pauses, lag 1 0.4": "pause=0.02,autocorrelation=0.4"}
PRESSES = (150, 600)
EPISODE = 30  # presses, of which every second is held out for the bits


def draw_times(kind: str, presses: int, seed: int) -> tuple[object, ReactionTimes]:
    """A person's parameters and times, every second press a repeated key."""
    rng = np.random.default_rng([20261126, seed])
    person = ParticipantPopulation.parse(KINDS[kind]).draw(rng)
    again, state = rng.random(presses) < 0.6, np.zeros(2)
    ms = [person.reaction_ms(rng, presses=at, again=bool(again[at]), state=state) for at in range(presses)]
    return person, ReactionTimes(np.array(ms), again, np.arange(presses))


def measure(kind: str, presses: int, people: int) -> list[dict[str, object]]:
    """A row per parameter."""
    held: dict[str, list[bool]] = {name: [] for name in PARAMETER_NAMES}
    ratios: dict[str, list[float]] = {name: [] for name in PARAMETER_NAMES}
    bits = []
    for seed in range(people):
        person, times = draw_times(kind, presses, seed)
        found = fit_reaction_times(times, floor_ms=160.0)
        assert found is not None
        for name in PARAMETER_NAMES:
            truth = getattr(person, name)
            ratios[name].append(found.values[name] / truth if truth else np.nan)
            if name in found.intervals and truth:
                held[name].append(found.intervals[name][0] <= truth <= found.intervals[name][1])
        odd = np.arange(presses) // EPISODE % 2 == 1
        half = fit_reaction_times(times[odd], floor_ms=160.0)
        if half is not None:
            bits.append(measure_gain(half, times[odd], times[~odd]))
    return [
        {
            "times": kind, "presses": presses, "parameter": name, "people": people,
            "reported": f"{len(held[name]) / people:.3g}", "held": f"{np.mean(held[name]):.3g}" if held[name] else "",
            "median_ratio": f"{np.median(ratios[name]):.3g}", "held_out_bits": f"{np.mean(bits):+.3f}" if bits else "",
        }
        for name in PARAMETER_NAMES
    ]  # fmt: skip


def main() -> None:
    """Measure and print."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--people", type=int, default=60)
    options.add_argument("--out", type=Path)
    given = options.parse_args()
    rows = []
    for kind in KINDS:
        for presses in PRESSES:
            rows += measure(kind, presses, given.people)
            for row in rows[-len(PARAMETER_NAMES) :]:
                print(*row.values(), flush=True)
    if given.out:
        with given.out.open("w", newline="", encoding="utf-8") as file:
            table = csv.DictWriter(file, COLUMNS)
            table.writeheader()
            table.writerows(rows)


if __name__ == "__main__":
    main()
