"""How well the adaptive designs do: QUEST+ thresholds, type I error of a study that may stop, sessions replayed.

``python analysis/adaptive_designs.py [--people 500] [--studies 10000] [--sessions 500] [--out FILE.csv]``

``questplus`` rows: simulated people with log-normal thresholds (SD 0.4 of the logarithm), slope 3.5 and 2 % lapses,
estimated by the design itself; ``fixed`` rows play the same values equally often, in random order, and are estimated
alike. ``sequential`` rows: two groups without a difference, or with one, compared at three looks by the functions that
an enrolment calls; ``naive`` looks as often at p < 0.05. ``replayed``: whole sessions in memory of
protocols/trials/threshold.toml, each compared with its replay, event by event.
"""

import argparse
import csv
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import scipy

from minihuman.admin.protocol_file import read_protocol
from minihuman.display.windows.window import VirtualClock
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.plan.designs import PlayedEpisode
from minihuman.experiment.plan.episode_designs import QuestPlus
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.plan.group_sequential import compute_adjusted_p, compute_welch_z, find_boundaries
from minihuman.experiment.replay import compare_replay
from minihuman.log.record.recorder import MemoryRecorder
from minihuman.runtime.session_loop import run_session
from minihuman.runtime.simulated_window import SimulatedWindow
from minihuman.simulation.scripted import ObserverParticipant
from minihuman.statistics.scores import wilson_interval
from minihuman.worlds.adapters.world import World

VALUES = (0.004, 0.005, 0.006, 0.008, 0.010, 0.012, 0.015, 0.019, 0.024, 0.030, 0.038, 0.047, 0.06, 0.075, 0.094, 0.12)
PROTOCOL = Path(__file__).parents[1] / "protocols" / "trials" / "threshold.toml"
SLOPE, LAPSE, LOOKS = 3.5, 0.02, (16, 32, 48)
ADJUSTED = 300  # studies whose adjusted p is compared with the boundary, which takes 15 ms each
COLUMNS = ("what", "n", "median_error", "error_90", "share", "share_low", "share_high", "mean_n", "cpu_s")
Row = dict[str, object]


def measure_thresholds(people: int, trials: int, guess: float, *, adaptive: bool, seed: int = 0) -> Row:
    """The relative errors of people's thresholds after so many trials."""
    design = QuestPlus({"option": "size", "values": VALUES, "guess": guess})
    rng, errors = np.random.default_rng((seed, trials)), []
    for _ in range(people):
        threshold = 0.02 * np.exp(0.4 * rng.standard_normal())
        fixed = rng.permutation(np.resize(VALUES, trials)).tolist()
        history: list[PlayedEpisode] = []
        for place in range(trials):
            value = design.decide(history, None).options["size"] if adaptive else fixed[place]
            chance = guess + (1 - guess - LAPSE) * -np.expm1(-((value / threshold) ** SLOPE))
            outcome = "goal" if rng.random() < chance else "failure"
            history.append(PlayedEpisode({"size": value}, 0, outcome, 1, 0.0))
        errors.append(abs(design.decide(history, None).estimates["threshold"] / threshold - 1))
    what = f"{'questplus' if adaptive else 'fixed'}, {trials} trials, guess {guess:g}"
    return {"what": what, "n": people, "median_error": np.median(errors), "error_90": np.quantile(errors, 0.9)}


def measure_sequential(studies: int, difference: float, *, naive: bool = False, seed: int = 0) -> Row:
    """How often a study of two equal groups rejects at one of its looks, and how many people it takes."""
    rng, fractions = np.random.default_rng((seed, 1)), [look / LOOKS[-1] for look in LOOKS]
    bounds = [scipy.stats.norm.isf(0.025)] * len(LOOKS) if naive else find_boundaries(fractions)
    rejected = taken = 0
    for study in range(studies):
        people = rng.standard_normal((2, LOOKS[-1] // 2))
        people[0] += difference
        for at, look in enumerate(LOOKS):
            groups = people[:, : look // 2]
            z = compute_welch_z(*((look // 2, its.mean(), its.var(ddof=1)) for its in groups))
            if abs(z) >= bounds[at] or look == LOOKS[-1]:
                rejected += abs(z) >= bounds[at]
                taken += look
                if study < ADJUSTED and not naive:  # the adjusted p and the boundary agree
                    assert (compute_adjusted_p(z, fractions[: at + 1], bounds) < 0.05) == (abs(z) >= bounds[at])
                break
    low, high = wilson_interval(rejected, studies)
    what = f"{'naive' if naive else 'sequential'}, looks at {', '.join(map(str, LOOKS))}, difference {difference:g}"
    share = {"share": rejected / studies, "share_low": low, "share_high": high}
    return {"what": what, "n": studies, **share, "mean_n": taken / studies}


def measure_replays(sessions: int) -> Row:
    """How many adaptive sessions are the same when they are played again from their events."""
    protocol, clean = read_protocol(PROTOCOL), 0
    for index in range(sessions):
        plan = expand_protocol(protocol, enrol_participant(protocol, index % protocol.study.participants))
        clock, recorder = VirtualClock(), MemoryRecorder()
        session = SessionMachine(plan, World, {}, picture_px=None)
        player = ObserverParticipant("threshold=0.02", np.random.default_rng(index))
        run_session(session, SimulatedWindow(player, session, clock), recorder, clock)
        clean += not list(compare_replay(recorder.events, World))
    low, high = wilson_interval(clean, sessions)
    what = "replayed, 40 trials of QUEST+"
    return {"what": what, "n": sessions, "share": clean / sessions, "share_low": low, "share_high": high}


def measure_all(people: int, studies: int, sessions: int) -> Iterator[Row]:
    """Every row, with its CPU time."""
    jobs = [
        *(
            (lambda guess=guess, kind=kind: measure_thresholds(people, kind[0], guess, adaptive=kind[1]))
            for guess in (0.5, 0.0)
            for kind in ((40, True), (40, False), (80, False))
        ),
        lambda: measure_sequential(studies, 0.0),
        lambda: measure_sequential(studies, 0.0, naive=True),
        lambda: measure_sequential(studies // 10, 0.8),
        lambda: measure_replays(sessions),
    ]
    for job in jobs:
        begun = time.process_time()
        row = job()
        cells = row | {"cpu_s": time.process_time() - begun}
        yield {name: f"{its:.4g}" if isinstance(its := cells.get(name, ""), float) else its for name in COLUMNS}


def main() -> None:
    """Measure, print and write."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--people", type=int, default=500)
    options.add_argument("--studies", type=int, default=10_000)
    options.add_argument("--sessions", type=int, default=500)
    options.add_argument("--out", type=Path)
    given = options.parse_args()
    rows = []
    for row in measure_all(given.people, given.studies, given.sessions):
        rows.append(row)
        print(" ".join(f"{key}={value}" for key, value in row.items() if value != ""), flush=True)
    if given.out:
        with given.out.open("w", newline="", encoding="utf-8") as file:
            table = csv.DictWriter(file, COLUMNS)
            table.writeheader()
            table.writerows(rows)


if __name__ == "__main__":
    main()
