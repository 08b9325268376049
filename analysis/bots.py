"""Fit and try the evidence of `minihuman bots`: simulated people against five kinds of simulated programs.

    python analysis/bots.py OUT [--people 420] [--programs 60] [--write-model]

Everyone plays ten episodes of FourRooms through the ordinary simulated session and is read back from the log. People
are `human-like` with key times as people's: slow fluctuations, log-normal holds; of every ten, two are slow, one scans
with a single switch and one uses an on-screen keyboard. Programs take the planner's path. Each attacker is held out of
the fit in turn, and people in tenths. Writes OUT/bots.csv; with --write-model also the model that the package uses.
"""

import argparse
import csv
import json
import multiprocessing
import sys
import tempfile
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize
from scipy.stats import beta

from minihuman import simulate
from minihuman.experiment.plan.session_plan import EpisodePlan
from minihuman.log.read.session_reader import read_log
from minihuman.reporting.bots import (
    BINS,
    FLAG,
    MEASURES,
    PressTimes,
    find_same_times,
    measure_key_times,
    place_in_bin,
    read_key_times,
    weigh_measures,
)
from minihuman.simulation.human_like import HumanLikeParticipant, ParticipantPopulation
from minihuman.simulation.participant import KeyPress, SimulatedParticipant
from minihuman.simulation.scripted import OptimalParticipant
from minihuman.worlds.adapters.world import World

PEOPLE = ("plain", "plain", "plain", "plain", "plain", "plain", "slow", "slow", "one-switch", "on-screen-keyboard")
PROGRAMS = ("constant", "ex-Gaussian", "screenshot", "replay", "knowing")
FRAME_MS = 1_000 / 60  # from a step to its picture, after which a simulated key is counted
PACKAGE = Path(__file__).parents[1] / "minihuman" / "reporting" / "data" / "bots.json"
STUDY = """
[study]
name = "bots"
version = "1"
seed = {seed}
participants = 5000
closing = ""
[keys]
keyboard_check = false
pool = ["1", "2", "3", "4", "5"]
[[groups]]
name = "all"
blocks = ["rooms"]
[[blocks]]
name = "rooms"
world = "minihuman/MiniGrid-FourRooms-v0"
actions = ["left", "right", "forward"]
episodes = 10
max_steps = 100
"""


class Person(HumanLikeParticipant):
    """A simulated person with a person's way at the keys: slow fluctuations of speed, and holds that vary."""

    def __init__(self, argument: str, rng: np.random.Generator) -> None:
        super().__init__("", rng)
        self.hands = argument
        self._own = own = rng.spawn(1)[0]
        self._tempo = 0.0
        self._slowness = own.uniform(2.0, 5.0) if argument == "slow" else 1.0
        self._hold_ms = own.lognormal(np.log(95), 0.25) * self._slowness**0.3
        self._hold_sd = own.uniform(0.15, 0.4)
        self._fluctuation = own.uniform(0.08, 0.25)
        self._scan_ms = own.uniform(500, 1_200)
        self._software_ms = own.choice([0.0, 20.0, 50.0, 100.0])
        self._finger: str | None = None

    def begin(self, plan: EpisodePlan, pool: tuple[str, ...], world: World) -> None:
        """Start an episode."""
        super().begin(plan, pool, world)
        self._order = pool

    def press(self, world: World) -> KeyPress:
        """The next key, when this person's hands have it."""
        found, own = super().press(world), self._own
        self._tempo = 0.75 * self._tempo + own.normal(0, self._fluctuation * np.sqrt(1 - 0.75**2))
        again, self._finger = found.key == self._finger, found.key
        delay_ms = found.delay_ms * float(np.exp(self._tempo)) * self._slowness
        hold_ms = self._hold_ms * float(own.lognormal(0, self._hold_sd))
        if self.hands == "one-switch":  # the scanner walks along the keys; the software makes the key
            turns = 1 + self._order.index(found.key) + len(self._order) * (own.random() < 0.08)
            delay_ms = 0.3 * delay_ms + self._scan_ms * turns
            hold_ms = self._software_ms
        elif self.hands == "on-screen-keyboard":  # Fitts' law at a distance of some keys
            delay_ms += (60.0 if again else own.lognormal(np.log(650), 0.25)) * np.exp(self._tempo)
            hold_ms = self._software_ms
        return KeyPress(found.key, float(min(delay_ms, 60_000)), float(hold_ms))


class Program(SimulatedParticipant):
    """The planner's keys at times of an attacker's own."""

    def __init__(self, argument: str, rng: np.random.Generator) -> None:
        self.kind = argument
        self._rng = rng
        self._keys = OptimalParticipant("", rng)
        self._person = ParticipantPopulation().draw(rng)
        self._pause_ms, self._sd_ms = rng.uniform(40, 900), rng.choice([0.0, 0.5, 3.0])
        self._latency_ms, self._latency_sd = rng.lognormal(np.log(2_800), 0.4), rng.uniform(0.15, 0.45)
        self._hold_ms = float(rng.choice([0.0, 1.0, 12.0, 50.0, 100.0]))
        self._hold_sd = rng.choice([0.0, 0.1, 0.3])
        self._tempo, self._presses, self._last = 0.0, 0, ""
        if self.kind == "replay":
            stolen = STOLEN[rng.integers(len(STOLEN))]
            self._stolen = [stolen[0], stolen[1], rng.integers(len(stolen[0]))]

    def begin(self, plan: EpisodePlan, pool: tuple[str, ...], world: World) -> None:
        """Start an episode."""
        self._keys.begin(plan, pool, world)
        self._fresh = True

    def press(self, world: World) -> KeyPress:
        """The planner's key."""
        key, rng = self._keys.press(world).key, self._rng
        again, self._last = key == self._last, key
        hold_ms = self._hold_ms * float(rng.lognormal(0, self._hold_sd))
        match self.kind:
            case "constant":
                delay_ms, hold_ms = max(1.0, rng.normal(self._pause_ms, self._sd_ms)), self._hold_ms
            case "ex-Gaussian":
                one = self._person
                delay_ms = max(30.0, rng.normal(one.mu_ms, one.sigma_ms) + rng.exponential(one.tau_ms))
            case "screenshot":
                delay_ms = rng.lognormal(np.log(self._latency_ms), self._latency_sd)
            case "replay":
                intervals, holds, place = self._stolen
                self._stolen[2] = (place + 1) % len(intervals)
                delay_ms, hold_ms = max(0.0, intervals[place] - FRAME_MS), holds[place % len(holds)]
            case _:  # it knows the measures and makes each as a person's
                self._tempo = 0.75 * self._tempo + rng.normal(0, 0.1)
                extra_ms = rng.exponential(700) if self._fresh else 0.0
                delay_ms = self._person.reaction_ms(rng, presses=self._presses, again=again, extra_ms=extra_ms)
                delay_ms *= float(np.exp(self._tempo))
                hold_ms = 95 * float(rng.lognormal(0, 0.25))
        self._fresh = False
        self._presses += 1
        return KeyPress(key, float(delay_ms), float(hold_ms))


Played = list[tuple[str, PressTimes]]
STOLEN: list[tuple[Any, Any]] = []  # intervals and holds of people, for the replay


def register(folder: Path) -> None:
    """Register both as plug-ins, as a lab's own package would."""
    info = folder / "bots_of_this_script-0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: bots-of-this-script\nVersion: 0\n")
    (info / "entry_points.txt").write_text(
        "[minihuman.players]\nkeyed-person = analysis_bots:Person\nkeyed-program = analysis_bots:Program\n"
    )
    sys.modules["analysis_bots"] = sys.modules[__name__]
    sys.path.append(str(folder))


def play(job: tuple[str, int, int]) -> list[tuple[str, PressTimes]]:
    """The key times of some sessions of one kind; the seed gives levels, keys and times."""
    kind, count, seed = job
    player = f"keyed-person:{kind}" if kind in PEOPLE else f"keyed-program:{kind}"
    with tempfile.TemporaryDirectory() as name:
        protocol = Path(name) / "bots.toml"
        protocol.write_text(STUDY.format(seed=seed))
        logs = simulate(protocol, participants=count, data=name, player=player, seed=seed)
        return [(kind, read_key_times(read_log(log))) for log in logs]


def play_everyone(n_people: int, n_programs: int, *, processes: int = 2) -> tuple[Played, Played]:
    """People, then programs; a replay has the times of one of these people."""
    with tempfile.TemporaryDirectory() as name:
        register(Path(name))
        context = multiprocessing.get_context("fork")
        share = Counter(PEOPLE[number % len(PEOPLE)] for number in range(n_people))
        with context.Pool(processes) as pool:
            people = list(chain(*pool.imap(play, list_jobs(share, 1_000))))
        STOLEN[:] = [(one.intervals_ms[~np.isnan(one.intervals_ms)], one.holds_ms) for _, one in people]
        with context.Pool(processes) as pool:
            programs = list(chain(*pool.imap(play, list_jobs(dict.fromkeys(PROGRAMS, n_programs), 2_000))))
    return people, programs


def list_jobs(counts: Mapping[str, int], seed: int) -> list[tuple[str, int, int]]:
    """At most 20 sessions each."""
    sizes = [(kind, min(20, count - done)) for kind, count in counts.items() for done in range(0, count, 20)]
    return [(kind, size, seed + number) for number, (kind, size) in enumerate(sizes)]


Measured = Sequence[tuple[str, Mapping[str, float]]]  # a kind, and the measures of a session


def fit(people: Measured, programs: Measured) -> dict[str, Any]:
    """The kinds' histograms and the logistic regression; people weigh by their numbers, kinds of programs the same."""
    even = [round(-float(np.log10(BINS)), 3)] * BINS
    chosen = dict.fromkeys(("median", "hold"), even)  # a program has any speed that it likes
    n_kinds = len({kind for kind, _ in programs})
    share = {kind: 1 / sum(one == kind for one, _ in programs) / n_kinds for kind, _ in programs}
    model: dict[str, Any] = {
        "people": list_kinds(people, {kind: 1 / len(people) for kind, _ in people}),
        "programs": [
            *(
                one | {"log10": one["log10"] | chosen}
                for one in list_kinds(programs, {kind: n_kinds / (n_kinds + 1) * one for kind, one in share.items()})
            ),
            {"kind": "any", "weight": round(1 / (n_kinds + 1), 4), "log10": dict.fromkeys(MEASURES, even)},
        ],
        "slope": 1.0,
        "intercept": 0.0,
    }
    ratios = np.array([weigh_measures(one, model, bound=np.inf)[0] for _, one in (*people, *programs)])
    truth = np.where(np.arange(len(ratios)) < len(people), 1, -1)
    weights = np.array([1 / len(people)] * len(people) + [share[kind] for kind, _ in programs])

    def loss(values: np.ndarray) -> float:
        return float(weights @ np.logaddexp(0, -truth * (values[0] * ratios + values[1]) * np.log(10)))

    slope, intercept = minimize(loss, (0.5, 0.0), bounds=((0, 1), (-2, 2))).x
    return model | {"slope": round(float(slope), 4), "intercept": round(float(intercept), 4)}


def list_kinds(sessions: Measured, share: Mapping[str, float]) -> list[dict[str, Any]]:
    """Each kind's weight, and log10 of its smoothed histograms."""
    found = []
    for kind in dict.fromkeys(kind for kind, _ in sessions):
        theirs = [measured for one, measured in sessions if one == kind]
        log10 = {}
        for name in MEASURES:
            bins = [place_in_bin(name, one[name]) for one in theirs if np.isfinite(one[name])]
            counts = np.bincount(bins, minlength=BINS).astype(float) if bins else np.zeros(BINS)
            counts = np.convolve(np.pad(counts, 1, "edge"), (0.25, 0.5, 0.25), "valid") + 0.1
            log10[name] = np.round(np.log10(counts / counts.sum()), 3).tolist()
        found.append({"kind": kind, "weight": round(len(theirs) * share[kind], 4), "log10": log10})
    return found


def upper_limit(count: int, of: int) -> float:
    """The upper limit of the exact 95 % interval of a share (Clopper and Pearson, 1934)."""
    return 1.0 if count == of else float(beta.ppf(0.975, count + 1, of - count))


def tabulate(played: Played, attacked: Played) -> list[tuple[Any, ...]]:
    """False alarms of people in held-out tenths, and what is flagged of each attacker that the fit has not seen."""
    people = [(kind, measure_key_times(one)) for kind, one in played]
    programs = [(kind, measured) for kind, one in attacked if (measured := measure_key_times(one))]
    folds = np.random.default_rng(3).permutation(len(people)) % 10
    ratios = np.empty(len(people))
    for fold in range(10):
        model = fit([one for one, at in zip(people, folds, strict=True) if at != fold], programs)
        for number in np.flatnonzero(folds == fold):
            ratios[number] = weigh_measures(people[number][1], model)[0]
    alike = find_same_times([one for _, one in played])
    rows: list[tuple[Any, ...]] = []
    for kind in (*dict.fromkeys(PEOPLE), "all people"):
        here = [number for number, (one, _) in enumerate(people) if kind in (one, "all people")]
        flagged = sum(bool(ratios[number] <= FLAG or number in alike) for number in here)
        rows.append(
            (kind, "false alarm", len(here), flagged, upper_limit(flagged, len(here)), "", np.median(ratios[here]))
        )
    for kind in PROGRAMS:
        model = fit(people, [one for one in programs if one[0] != kind])
        theirs = [weigh_measures(measured, model)[0] for one, measured in programs if one == kind]
        area = np.mean([[(one < other) + 0.5 * (one == other) for one in theirs] for other in ratios])
        flagged = sum(one <= FLAG for one in theirs)
        rows.append((kind, "held out of the fit", len(theirs), flagged, "", area, np.median(theirs)))
    copies = find_same_times([one for _, one in (*played, *attacked)])
    theirs = [number for number, (kind, _) in enumerate((*played, *attacked)) if kind == "replay"]
    rows.append(("replay", "its original in the study", len(theirs), sum(one in copies for one in theirs), "", "", ""))
    return rows


def main(out: Path, played: Played, attacked: Played, *, write_model: bool) -> None:
    """Write the error rates, and the model."""
    out.mkdir(parents=True, exist_ok=True)
    with (out / "bots.csv").open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(("who", "what", "sessions", "flagged", "upper_95", "auc", "median_log10_ratio"))
        rows = tabulate(played, attacked)
        table.writerows([[f"{one:.4g}" if isinstance(one, float) else one for one in row] for row in rows])
    print((out / "bots.csv").read_text(), end="")
    if write_model:
        programs = [(kind, measured) for kind, one in attacked if (measured := measure_key_times(one))]
        model = fit([(kind, measure_key_times(one)) for kind, one in played], programs)
        PACKAGE.write_text(json.dumps(model) + "\n", encoding="utf-8")
        print(PACKAGE)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--people", type=int, default=420)
    parser.add_argument("--programs", type=int, default=60)
    parser.add_argument("--write-model", action="store_true")
    arguments = parser.parse_args()
    main(arguments.out, *play_everyone(arguments.people, arguments.programs), write_model=arguments.write_model)
