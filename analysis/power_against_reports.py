"""What `minihuman power` promises beside what reports of new participants find, design by design.

``python analysis/power_against_reports.py [--studies 4000] [--reports 20] [--only NAME] [--out FOLDER]``

Each design draws studies of new participants, whose tables go through the report's own function from table to
statistics (``compute_results``): the share with a corrected p below 5 % is what power should have said. Power knows a
pool of the same kind of participants without an effect. The true effect lies where a study has it: in each episode's
reward, in the odds of a success, in a factor of steps or seconds; its size is calibrated on many participants to the
shift that power was asked for. Whole reports, from simulated sessions to the page, show that the quick way is the
report's: every number of their results is compared, with the p of power's own comparison too. The result is written
after every hundred studies and every report of each design in turn; a run that was interrupted, or one that asks for
more, goes on from there.
"""

import argparse
import dataclasses
import importlib.metadata
import json
import math
import platform
import shutil
import time
from collections import Counter
from collections.abc import Iterator, Mapping
from datetime import date
from functools import lru_cache
from html import unescape
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from unittest import mock

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy import optimize, special

from minihuman import __version__
from minihuman.dataset.selection import Selection
from minihuman.dataset.sessions import StudySessions
from minihuman.dataset.tables import select
from minihuman.experiment.protocol.protocol import Protocol, decode_protocol
from minihuman.experiment.protocol.study_design import derive_design
from minihuman.planning.report_power import (
    ReportPool,
    StudyDesign,
    compare_study,
    estimate_report_power,
    make_report_pool,
)
from minihuman.reporting import build
from minihuman.reporting.block_measures import MEASURES, take_logarithms
from minihuman.reporting.exclusions import exclude_practice_alone
from minihuman.reporting.interactions import InteractionResults, compute_interaction, state_interaction
from minihuman.reporting.results import Results, compute_results
from minihuman.reporting.statements import difference_statement, paired_statement
from minihuman.reporting.within_results import unite_teams
from minihuman.runtime.simulated_session import simulate
from minihuman.statistics.scores import wilson_interval
from minihuman.statistics.units import find_units, name_units

ALPHA = 0.05
BATCH = 100  # studies between two writings
EPISODES = 4
LIMIT = 100  # steps
NAMES = "abc"
POOL = 2_000  # participants of each group that power draws from; of 300, a spread 10 % too large was 0.04 of power
POPULATION = 10_000  # participants of each group by whom the true effect is calibrated
TABLES = ("episodes", "blocks", "participants", "teams", "answers", "parts", "points")
FIRST = 20261126  # of the seeds


@dataclasses.dataclass(frozen=True)
class Design:
    """A study: who takes part, what is compared, and the true effect."""

    name: str
    shift: float  # of the first measure, in standard deviations between participants
    size: int  # participants per group, times its ratio
    ratios: tuple[int, ...] = (1, 1)
    measures: tuple[str, ...] = ("reward_mean",)  # the first is the primary one
    named: bool = True  # whether the protocol says so
    on: str = "groups"
    sessions: int = 1
    drop_out: float = 0.0
    team: int = 1
    rules: bool = False  # the protocol excludes participants and episodes

    @property
    def primary(self) -> str:
        """What is compared."""
        return self.measures[0]

    @property
    def blocks(self) -> tuple[str, ...]:
        """In the order of play; the last is the one that groups are compared on."""
        return ("narrow", "wide") if self.on in ("conditions", "interaction") else ("wide",)

    def sizes(self, size: int) -> tuple[int, ...]:
        """Participants of each group."""
        return tuple(size * ratio for ratio in self.ratios)


DESIGNS = (
    Design("two groups, 8 and 16", 1.1, 8, ratios=(1, 2)),
    Design("three groups, Holm over pairs and measures", 1.3, 14, ratios=(1, 1, 1), named=False,
           measures=("log_excess_steps_mean", "reward_mean", "playing_s_mean")),
    Design("within participants", 0.5, 8, on="conditions"),
    Design("drop-out of 15 % at each of two sessions", 0.9, 16, sessions=2, drop_out=0.15),
    Design("share of successes", 0.8, 20, measures=("success",)),
    Design("steps to the goal, censored at the limit", -0.8, 20, measures=("steps_at_limit_mean",)),
    Design("log-normal playing times", 0.8, 20, measures=("playing_s_mean",)),
    Design("teams of two", 0.9, 30, team=2),
    Design("change between two days", 0.8, 16, on="change", sessions=2),
    Design("exclusions by the protocol's rules", 0.9, 18, rules=True),
    Design("interaction of groups and conditions", 0.7, 16, on="interaction"),
)  # fmt: skip


def write_protocol(design: Design, participants: int, seed: int) -> bytes:
    """The protocol of a design."""
    name = "-".join("".join(one if one.isalnum() else " " for one in design.name.lower()).split())
    text = [
        f'[study]\nname = "{name}"\nversion = "1.0"\nseed = {seed}\nparticipants = {participants}',
        '[keys]\npool = ["left", "right", "up", "down", "space"]\nkeyboard_check = false',
        f'[analysis]\nprimary_measure = "{design.primary}"' if design.named else "",
        f"conditions = {json.dumps(design.blocks)}" if len(design.blocks) > 1 else "",
    ]
    for group, ratio in zip(NAMES, design.ratios, strict=False):
        text += [f'[[groups]]\nname = "{group}"\nallocation_ratio = {ratio}']
        text += ["" if design.sessions > 1 else f"parts = {json.dumps(design.blocks)}"]
    for day in range(design.sessions if design.sessions > 1 else 0):
        text += [f'[[sessions]]\nname = "day-{day + 1}"\nparts = ["wide"]']
    text += [
        '[[exclusions]]\nreason = "few successes"\nlevel = "participant"\nmeasure = "success"\nbelow = 0.5',
        '[[exclusions]]\nreason = "slow"\nlevel = "episode"\nmeasure = "playing_s"\nabove = 25.0',
    ] if design.rules else []  # fmt: skip
    for block, world in zip(design.blocks, ("Empty-5x5", "Empty-8x8"), strict=False):
        text += [f'[[blocks]]\nname = "{block}"\nepisodes = {EPISODES}\nshow_keys = true\nkey_map = "fixed"']
        if design.team > 1:
            keys = {one: one for one in ("up", "down", "left", "right")} | {"space": "interact"}
            text += ['kind = "team"\nworld = "minihuman/Team-CrampedRoom-v0"\nview = "full"\nmax_steps = 60']
        else:
            keys = {"left": "left", "right": "right", "up": "forward"}
            text += [f'world = "minihuman/MiniGrid-{world}-v0"\nmax_steps = 40']
        text += [f"actions = {json.dumps([*keys.values()])}"]
        text += [f"fixed_keys = {{ {', '.join(f'{key} = {json.dumps(action)}' for key, action in keys.items())} }}"]
        text += (
            ['[blocks.team]\nseats = ["person", "person"]\nstand_in = "scripted:cook"\npartner_disclosure = "debrief"']
            if design.team > 1
            else []
        )
    return "\n".join(filter(None, text)).encode()


def draw(
    design: Design, sizes: tuple[int, ...], strength: float, rng: np.random.Generator, *, drop_out: float = 0.0
) -> dict[str, pd.DataFrame]:
    """The tables of one study of new participants; ``strength`` is the effect, as each measure's episodes have it."""
    count, shape = sum(sizes), (sum(sizes), design.sessions, len(design.blocks), EPISODES)
    group, team = np.repeat(np.arange(len(sizes)), sizes), np.arange(count) // design.team
    moved = np.zeros(shape)
    where = {
        "groups": group[:, None, None, None] == 0,
        "conditions": np.arange(shape[2])[:, None] == 0,
        "interaction": (group[:, None, None, None] == 0) & (np.arange(shape[2])[:, None] == 0),
        "change": (group[:, None, None, None] == 0) & (np.arange(shape[1])[:, None, None] > 0),
    }
    moved[np.broadcast_to(where[design.on], shape)] = strength
    episodes: dict[str, Any] = {"success": True, "steps": 10, "max_steps": LIMIT}
    # Of rewards and times the table of blocks tells enough: growth and reliability, which are not tested, take long.
    episodes |= dict.fromkeys(("reward", "log_excess_steps", "playing_s"), np.nan)
    means = {}
    slow = rng.random(shape) < 0.05 if design.rules else np.zeros(shape, bool)
    latent = np.zeros(shape)
    for measure in design.measures:
        person = rng.normal(size=count)
        if design.team > 1:
            person = math.sqrt(0.5) * (person + rng.normal(size=count)[team])
        latent = 0.8 * person[:, None, None, None] + 0.5 * rng.normal(size=shape[:3])[..., None]
        found = draw_episodes(measure, latent, moved if measure == design.primary else np.zeros(shape), rng)
        value = found.pop("value")
        episodes |= found
        with np.errstate(invalid="ignore"):
            means[measure] = (value * ~slow).sum(axis=-1) / (~slow).sum(axis=-1)
    who = np.array([f"sub-{number:05d}" for number in range(count)])
    at = np.indices(shape).reshape(4, -1)
    failed = np.zeros(count, bool)
    if design.rules:  # whoever is good at one thing is at the other
        failed = (rng.random((count, EPISODES)) < special.expit(1.8 + latent.mean(axis=(1, 2)))).mean(axis=1) < 0.5
    begun = np.minimum(rng.geometric(drop_out, count) - 1, design.sessions) if drop_out else design.sessions

    def rows(index: NDArray[np.int_], columns: Mapping[str, Any], reasons: NDArray[np.object_]) -> pd.DataFrame:
        names = {"participant": who[index[0]], "group": np.array([*NAMES])[group[index[0]]], "session": index[1] + 1}
        if len(index) > 2:
            names["block"] = np.array(design.blocks)[index[2]]
        there = index[1] < np.broadcast_to(begun, count)[index[0]]
        flat = {name: value.ravel() if np.ndim(value) else value for name, value in columns.items()}
        return pd.DataFrame(names | flat | {"exclusion_reason": reasons})[there].reset_index(drop=True)

    few = np.where(failed, "few successes", None)
    blocks = dict.fromkeys(MEASURES, np.nan) | means | {"episodes": (~slow).sum(axis=-1)}
    blocks |= {"reward_sd": np.nan, "keys_total": 0}
    ends = {"episode": at[3] + 1, "episode_in_block": at[3] + 1, "segment": 1, "attempt": 1, "world": "drawn"}
    tables = {
        "episodes": rows(at, ends | episodes, np.where(slow.ravel(), "slow", few[at[0]])),
        "blocks": rows(at[:3, at[3] == 0], blocks, few[at[0, at[3] == 0]]),
    }
    first = at[:2, (at[2] == 0) & (at[3] == 0)]
    tables["participants"] = rows(first, {}, few[first[0]])
    tables["episodes"]["outcome"] = np.where(tables["episodes"]["success"], "goal", "timeout")
    teams = pd.DataFrame({"block": "wide", "participant": who, "team": [f"team-{number:05d}" for number in team]})
    return tables | {"teams": teams if design.team > 1 else teams[:0]}


def draw_episodes(
    measure: str, latent: NDArray[np.float64], moved: NDArray[np.float64], rng: np.random.Generator
) -> dict[str, NDArray[Any]]:
    """The columns of the table of episodes that a measure is of, and each episode's value of it."""
    noise = rng.normal(size=moved.shape)
    if measure == "success":
        reached = rng.random(moved.shape) < special.expit(1.2 + 1.2 * latent + moved)
        return {"success": reached, "value": reached.astype(float)}
    if measure == "steps_at_limit_mean":
        steps = np.ceil(np.exp(3.8 + 0.5 * latent + 0.5 * noise + moved))
        capped = np.minimum(steps, LIMIT)
        return {"steps": capped.astype(int), "success": steps <= LIMIT, "value": capped}
    if measure == "playing_s_mean":
        return {"value": np.exp(2 + 0.5 * latent + 0.4 * noise + moved)}
    scale, middle = {"reward_mean": (0.1, 0.5), "log_excess_steps_mean": (0.6, 2.0)}[measure]
    return {"value": middle + scale * (latent + 0.8 * noise) + moved}


def find_people(design: Design, strength: float, sizes: tuple[int, ...]) -> pd.DataFrame:
    """The values of the block that groups are compared on, one per unit: many, without drop-out."""
    tables = draw(design, sizes, strength, np.random.default_rng([FIRST, 1]))
    rows = tables["blocks"][tables["blocks"]["exclusion_reason"].isna()]
    rows = name_units(rows, find_units(tables["teams"]))
    scaled, _ = take_logarithms(rows[rows["block"] == "wide"], [design.primary])
    return scaled.groupby(["group", "participant"])[design.primary].mean().reset_index()


def calibrate(design: Design) -> float:
    """The effect on an episode that moves the mean of participants by ``shift`` of their standard deviations."""
    sizes = design.sizes(POPULATION // max(design.ratios))
    people = find_people(design, 0.0, sizes)
    by = design.shift * float(people.groupby("group")[design.primary].std().mean())
    if design.primary not in ("success", "steps_at_limit_mean"):
        return by

    def excess(strength: float) -> float:
        moved, before = (rows[rows["group"] == "a"] for rows in (find_people(design, strength, sizes), people))
        return float(moved[design.primary].mean() - before[design.primary].mean()) - by

    return float(optimize.brentq(excess, -4.0, 4.0, xtol=2e-3))


def list_interaction_p(interaction: InteractionResults) -> dict[str, float]:
    """The corrected p of each contrast of the primary measure, by the names that power has for them."""
    return {
        f"{interaction.measure}: {one.contrast}, {one.groups.first} - {one.groups.second}": one.groups.p_holm
        for one in interaction.headline
    }


def list_p(found: Results, design: Design) -> dict[str, float]:
    """The corrected p of each comparison of the primary measure, by the names that power has for them."""
    target = found.target_block
    assert target is not None
    within = found.within.comparisons if found.within else ()
    changes = (one for _, one in target.changes_compared)
    compared = {"groups": target.comparisons, "conditions": within, "change": changes}[design.on]
    return {
        f"{one.measure}: {one.first} - {one.second}": one.p_holm for one in compared if one.measure == design.primary
    }


def analyse(tables: Mapping[str, pd.DataFrame], protocol: Protocol) -> Results:
    """From table to statistics, as the report does it."""
    people = exclude_practice_alone(tables["participants"]) if "episodes" in tables["participants"] else None
    people = tables["participants"] if people is None else people
    return compute_results(tables["episodes"], tables["blocks"], people, protocol.analysis, tables["teams"])


def cross(
    tables: Mapping[str, pd.DataFrame], protocol: Protocol, design: Design, *, intervals: bool = True
) -> InteractionResults | None:
    """The interaction, as the report computes it; None where the design is about something else."""
    if design.on != "interaction":
        return None
    included = tables["blocks"][tables["blocks"]["exclusion_reason"].isna()]
    rows = unite_teams(included, tables["teams"])
    order = tuple(NAMES[: len(design.ratios)])
    return compute_interaction(rows, derive_design(protocol), protocol.analysis, order, intervals=intervals)


@lru_cache
def make_study(design: Design) -> tuple[Protocol, float, ReportPool]:
    """The protocol of a design, the true effect, and the pool that power draws from, which is without it."""
    protocol = decode_protocol(write_protocol(design, sum(design.sizes(design.size)), 1), design.name)
    rng = np.random.default_rng([FIRST, 3, DESIGNS.index(design)])
    people = draw(design, (POOL,) * len(design.ratios), 0.0, rng)
    missing = {name: pd.DataFrame() for name in TABLES if name not in people}
    return protocol, calibrate(design), make_report_pool(protocol, people | missing)


def measure_design(design: Design, before: Mapping[str, Any], studies: int) -> dict[str, Any]:
    """So many more studies of new participants than ``before``, and of those that power draws."""
    number, begun = DESIGNS.index(design), before.get("studies", 0)
    protocol, strength, pool = make_study(design)
    started = time.process_time()
    hits, done = Counter(before.get("hits", {})), begun + studies
    promised, since = Counter[str](), 0
    if before.get("pool") == POOL:
        promised, since = Counter(before["hits_of_power"]), begun
    for study in range(begun, begun + studies):
        rng = np.random.default_rng([FIRST, 2, number, study])
        tables = draw(design, design.sizes(design.size), strength, rng, drop_out=design.drop_out)
        interaction = cross(tables, protocol, design, intervals=False)
        found = list_interaction_p(interaction) if interaction else list_p(analyse(tables, protocol), design)
        found |= {"any of them": min(found.values())} if len(found) > 1 else {}
        hits.update({name: int(p < ALPHA) for name, p in found.items()})
    reported = time.process_time()
    asked = StudyDesign(design.shift, design.on, design.drop_out)
    for first in range(since, done, BATCH):
        drawn = min(BATCH, done - first)
        for one in estimate_report_power(pool, asked, [design.size], studies=drawn, seed=first):
            promised.update({one.measure: round(one.power * drawn)})
    assert promised.keys() == hits.keys()
    spent = before.get("cpu_s_of_power", 0) if since else 0
    return {
        "design": design.name, "participants": list(design.sizes(design.size)), "shift": design.shift, "studies": done,
        "pool": POOL,
        "cpu_s_of_studies": round(before.get("cpu_s_of_studies", 0) + reported - started, 2),
        "cpu_s_of_power": round(spent + time.process_time() - reported, 2),
        "hits": dict(hits), "hits_of_power": dict(promised),
        "comparisons": [compare_shares(name, hits[name], promised[name] / done, done) for name in hits],
    }  # fmt: skip


def compare_shares(name: str, hits: int, promised: float, studies: int) -> dict[str, Any]:
    """What reports found and power said, and their difference with its Monte Carlo interval (Newcombe's)."""
    found = hits / studies
    low, high = wilson_interval(hits, studies)
    least, most = wilson_interval(round(promised * studies), studies)
    apart = promised - found
    down, up = math.hypot(promised - least, high - found), math.hypot(most - promised, found - low)
    return {
        "comparison": name, "reports": round(found, 4), "power": round(promised, 4), "difference": round(apart, 4),
        "interval": [round(apart - down, 4), round(apart + up, 4)],
    }  # fmt: skip


def count_numbers(ours: object, theirs: object) -> tuple[int, int]:
    """How many numbers two results hold, and how many of them differ."""
    if dataclasses.is_dataclass(ours) and not isinstance(ours, type):
        assert type(ours) is type(theirs)
        names = [field.name for field in dataclasses.fields(ours)]
        return _sum(count_numbers(getattr(ours, name), getattr(theirs, name)) for name in names)
    if isinstance(ours, Mapping):
        assert isinstance(theirs, Mapping)
        assert [*ours] == [*theirs]
        return _sum(count_numbers(ours[name], theirs[name]) for name in ours)
    if isinstance(ours, pd.DataFrame):
        assert isinstance(theirs, pd.DataFrame)
        return count_numbers(ours.to_dict("list"), theirs.to_dict("list"))
    if isinstance(ours, list | tuple | np.ndarray):
        assert isinstance(theirs, list | tuple | np.ndarray)
        assert len(ours) == len(theirs)
        return _sum(count_numbers(*pair) for pair in zip(ours, theirs, strict=True))
    if isinstance(ours, float | int | np.number | np.bool_):
        assert isinstance(theirs, float | int | np.number | np.bool_)
        return 1, int(not (ours == theirs or (math.isnan(ours) and math.isnan(theirs))))
    assert ours == theirs, f"{ours!r} is not {theirs!r}"
    return 0, 0


def _sum(counts: Iterator[tuple[int, int]]) -> tuple[int, int]:
    both = np.array([*counts] or [(0, 0)])
    return int(both[:, 0].sum()), int(both[:, 1].sum())


def check_report(design: Design, before: Mapping[str, Any], folder: Path, size: int) -> dict[str, Any]:
    """One more whole report of simulated sessions, and the quick way beside it."""
    begun, number = time.process_time(), before.get("whole_reports", 0)
    seed, count = 1000 * DESIGNS.index(design) + number, sum(design.sizes(size))
    protocol = decode_protocol(write_protocol(design, count, seed), design.name)
    data, out = folder / "data", folder / "report"
    for _ in simulate(protocol, data, participants=count, seed=seed, player="human-like"):
        pass
    leave(data, design, np.random.default_rng(seed))
    kept: list[Results] = []
    with mock.patch.object(build, "build_page", _keeper(kept)), select(data, processes=1) as tables:
        page, *_ = build.build_report(tables, out)
    text = " ".join(unescape(page.read_text(encoding="utf-8")).split())
    tables = read_tables(data)
    quick, pool = analyse(tables, protocol), make_report_pool(protocol, tables)
    ours = dict(compare_study(pool.rows[pool.rows["exclusion_reason"].isna()], pool, design.on))
    assert ours
    assert quick.target_block is not None
    crossed = cross(tables, protocol, design)
    said = [*state_interaction(crossed)] if crossed else []
    said += [difference_statement(one, "wide") for one in quick.target_block.headline if not crossed]
    if quick.within and not crossed:
        said += [paired_statement(one) for one in quick.within.comparisons if one.measure == design.primary]
    missing = sum(" ".join(one.split()) not in text for one in said)
    counts = [
        count_numbers(kept[0], quick),
        count_numbers(ours, list_interaction_p(crossed) if crossed else list_p(quick, design)),
        (len(said), missing),
    ]
    compared, differ = (sum(each) for each in zip(*counts, strict=True))
    return {
        "whole_reports": number + 1, "numbers": before.get("numbers", 0) + compared,
        "numbers_that_differ": before.get("numbers_that_differ", 0) + differ,
        "cpu_s_of_reports": round(before.get("cpu_s_of_reports", 0) + time.process_time() - begun, 2),
    }  # fmt: skip


def _keeper(kept: list[Results]) -> Any:
    whole = build.build_page

    def keep(facts: build.PageContent, found: Results, templates: Path | None = None) -> str:
        kept.append(found)
        return whole(facts, found, templates)

    return keep


def leave(data: Path, design: Design, rng: np.random.Generator) -> None:
    """Let participants drop out: they have no second session."""
    for session in sorted(data.glob("*/*/ses-02")):
        if rng.random() < design.drop_out:
            shutil.rmtree(session)


def read_tables(data: Path) -> dict[str, pd.DataFrame]:
    """The tables of a study's logs, without the report."""
    rows = [one.rows for one in StudySessions(data, Selection(), processes=1).rows(with_shortest=True)]
    return {name: pd.concat([one[name].to_pandas() for one in rows], ignore_index=True) for name in TABLES}


def describe(found: Mapping[str, Any]) -> str:
    """The result as a table in Markdown."""
    lines = ["| design | participants | comparison | reports | power | difference [95 %] |", "|" + " --- |" * 6]
    for row in found["designs"]:
        for one in row["comparisons"]:
            low, high = one["interval"]
            sizes, name = ", ".join(map(str, row["participants"])), one["comparison"].replace("_", " ")
            lines.append(
                f"| {row['design']} | {sizes} | {name} | {one['reports']:.3f} | {one['power']:.3f} "
                f"| {one['difference']:+.3f} [{low:+.3f}, {high:+.3f}] |"
            )
    rows = found["designs"]
    counts = sorted({row["studies"] for row in rows})
    spent = {name: sum(row.get(f"cpu_s_of_{name}", 0) for row in rows) for name in ("studies", "power", "reports")}
    each = [1000 * row["cpu_s_of_studies"] / row["studies"] for row in rows]
    lines.append("")
    lines.append(
        f"{' to '.join(f'{count:,}' for count in counts)} studies per design, each way; one takes {min(each):.0f} to "
        f"{max(each):.0f} CPU-ms from table to statistics. Whole reports: "
        f"{sum(row.get('whole_reports', 0) for row in rows)}, {sum(row.get('numbers', 0) for row in rows):,} numbers, "
        f"{sum(row.get('numbers_that_differ', 0) for row in rows)} differ. CPU-seconds: "
        f"{', '.join(f'{name} {value:,.0f}' for name, value in spent.items())}. "
        f"{', '.join(f'{name} {version}' for name, version in found['versions'].items())}; {found['date']}."
    )
    return "\n".join(lines) + "\n"


def main() -> None:
    """Measure, write and print."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--studies", type=int, default=4000)
    options.add_argument("--reports", type=int, default=20)
    options.add_argument("--report-size", type=int, default=6, help="participants per group of a whole report")
    options.add_argument("--only", default="", help="designs whose names hold this")
    options.add_argument("--out", type=Path, default=Path(__file__).parent)
    given = options.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    path = given.out / f"{Path(__file__).stem}.json"
    designs = [one for one in DESIGNS if given.only in one.name]
    rows: dict[str, dict[str, Any]] = {}
    if path.exists():
        rows = {row["design"]: row for row in json.loads(path.read_text(encoding="utf-8"))["designs"]}
    while True:
        begun = False
        for design in designs:
            row = rows.setdefault(design.name, {})
            more = max(min(BATCH, given.studies - row.get("studies", 0)), 0)
            row |= measure_design(design, row, more) if more else {}
            if row.get("whole_reports", 0) < given.reports:
                with TemporaryDirectory(prefix="minihuman-reports-") as folder:
                    row |= check_report(design, row, Path(folder), given.report_size)
                more += 1
            begun = begun or more > 0
            if more > 0:
                write(path, [rows[one.name] for one in DESIGNS if one.name in rows])
                print(f"{design.name}: {row['studies']} studies, {row['comparisons']}", flush=True)
        if not begun:
            break
    print(path.with_suffix(".md").read_text(encoding="utf-8"))


def write(path: Path, rows: list[dict[str, Any]]) -> None:
    """Write the result as JSON and as a table."""
    found = {
        "date": date.today().isoformat(),
        "versions": {
            "minihuman": __version__, "Python": platform.python_version(),
            **{name: importlib.metadata.version(name) for name in ("numpy", "scipy", "pandas")},
        },
        "designs": rows,
    }  # fmt: skip
    path.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    path.with_suffix(".md").write_text(describe(found), encoding="utf-8")


if __name__ == "__main__":
    main()
