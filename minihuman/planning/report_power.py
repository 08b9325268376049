"""Power of what the report will say: studies drawn from simulated participants go through the report's own functions.

From the table of blocks on: logarithms, roles, Holm's correction, conditions within participants and changes between
sessions are the report's, as are the sizes of groups by their allocation ratio. Participants who drop out are missing
from a session on.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import msgspec
import numpy as np
import pandas as pd

from minihuman.dataset.selection import Selection
from minihuman.dataset.sessions import StudySessions
from minihuman.errors import ReportError
from minihuman.experiment.protocol.protocol import Protocol, decode_protocol
from minihuman.experiment.protocol.specs import AnalysisSpec
from minihuman.planning.power import ALPHA, PowerEstimate
from minihuman.reporting.results import (
    assign_roles,
    compare_measures,
    compare_within,
    find_target_block,
    list_changes,
    list_default_measures,
    set_measures_aside,
    take_logarithms,
)
from minihuman.reporting.study_measures import add_measures
from minihuman.runtime.simulated_session import simulate
from minihuman.statistics.scores import wilson_interval

COMPARISONS = ("groups", "conditions", "change")
_TABLES = ("blocks", "episodes", "participants", "answers", "parts", "points")


@dataclass(frozen=True, slots=True)
class StudyDesign:
    """What is varied: the effect, where it lies, and how many leave."""

    shift: float = 0.0  # of the primary measure, in standard deviations between participants
    on: str = "groups"  # which comparison has it: of the first group, the first condition, or the first group's change
    drop_out: float = 0.0  # the chance to be missing from a session, and from all later ones

    def __post_init__(self) -> None:
        """Refuse what is no design."""
        if self.on not in COMPARISONS:
            raise ReportError(f"--on {self.on!r} is unknown; use one of {', '.join(COMPARISONS)}")
        if not 0 <= self.drop_out < 1:
            raise ReportError(
                f"--drop-out {self.drop_out:g} is not valid; use a probability of 0 or more and less than 1"
            )


@dataclass(frozen=True, slots=True, eq=False)
class ReportPool:
    """Simulated participants as the report reads them: the table of blocks, practice left out."""

    rows: pd.DataFrame
    groups: Mapping[str, int]  # in the order of the report, with their allocation ratio
    analysis: AnalysisSpec
    target: str


def simulate_report_pool(toml: bytes, *, people: int, player: str, seed: int) -> ReportPool:
    """Simulate participants of every group through whole sessions; nothing stays on disk.

    Raises:
        ProtocolError: if the protocol cannot be understood.
        SimulationError: if there is no such player, or it cannot play a block's world.
        ReportError: if the protocol names a measure that the sessions do not give.
    """
    protocol = decode_protocol(toml, "protocol")
    study = msgspec.structs.replace(protocol.study, participants=people)
    with TemporaryDirectory(prefix="minihuman-power-") as folder:
        for _ in simulate(
            msgspec.structs.replace(protocol, study=study), Path(folder), participants=people, seed=seed, player=player
        ):
            pass
        sessions = StudySessions(Path(folder), Selection(), processes=1).rows(with_shortest=True)
        parts: dict[str, list[pd.DataFrame]] = {name: [] for name in _TABLES}
        for one in sessions:
            for name in _TABLES:
                parts[name].append(one.rows[name].to_pandas())
    return make_report_pool(protocol, {name: pd.concat(tables, ignore_index=True) for name, tables in parts.items()})


def make_report_pool(protocol: Protocol, tables: Mapping[str, pd.DataFrame]) -> ReportPool:
    """A pool of a study's tables."""
    analysis = protocol.analysis
    rows = add_measures(tables["blocks"], tables, analysis.find_plugin_measures())
    analysed = {block.name for block in protocol.blocks if block.analysed}
    rows = rows[rows["exclusion_reason"].isna() & rows["block"].isin(analysed)]
    blocks = rows.groupby("group")["block"].nunique()
    ratios = {group.name: group.allocation_ratio for group in protocol.groups}
    order = sorted(map(str, blocks.index), key=lambda group: (-int(blocks[group]), group))
    groups = {group: ratios[group] for group in order}
    return ReportPool(rows.reset_index(drop=True), groups, analysis, analysis.block or find_target_block(rows))


def estimate_report_power(
    pool: ReportPool, design: StudyDesign, sizes: Sequence[int], *, studies: int, seed: int
) -> tuple[PowerEstimate, ...]:
    """The share of studies in which the report's corrected p of each comparison is below 5 %.

    ``sizes`` are participants per group, times the group's allocation ratio. Of each size, an estimate per comparison
    of the primary measure (of the first that has values where none is named), and one of any of them.

    Raises:
        ReportError: if the protocol has no such comparison.
    """
    found = []
    for size in sizes:
        rng = np.random.default_rng([seed, size])
        counts: dict[str, int] = {}
        for _ in range(studies):
            study = draw_study(pool, design, size, rng)
            ps = dict(compare_study(study, pool, design.on))
            for name, p in ps.items():
                counts[name] = counts.get(name, 0) + (p < ALPHA)
            if len(ps) > 1:
                counts["any of them"] = counts.get("any of them", 0) + any(p < ALPHA for p in ps.values())
        if not counts:
            raise ReportError(
                f"the protocol has no comparison of {design.on}; add one to [analysis], or choose another with --on"
            )
        for name, hits in counts.items():
            low, high = wilson_interval(hits, studies)
            found.append(PowerEstimate(name, size, hits / studies, low, high, studies))
    return tuple(found)


def draw_study(pool: ReportPool, design: StudyDesign, size: int, rng: np.random.Generator) -> pd.DataFrame:
    """The table of blocks of one study: participants of the pool's groups, drawn with replacement."""
    drawn = []
    for group, ratio in pool.groups.items():
        theirs = pool.rows[pool.rows["group"] == group]
        codes = theirs["participant"].unique()
        for number, code in enumerate(rng.choice(codes, size * ratio)):
            drawn.append(theirs[theirs["participant"] == code].assign(participant=f"{group}-{number}"))
    rows = pd.concat(drawn, ignore_index=True)
    if design.drop_out:
        sessions = sorted(rows["session"].unique())
        left = {
            code: next((at for at in sessions if rng.random() < design.drop_out), math.inf)
            for code in rows["participant"].unique()
        }
        rows = rows[rows["session"] < rows["participant"].map(left)]
    return _shift(rows, pool, design)


def _primary(pool: ReportPool, rows: pd.DataFrame) -> str:
    return pool.analysis.primary_measure or next(iter(list_default_measures(rows)), "")


def _shift(rows: pd.DataFrame, pool: ReportPool, design: StudyDesign) -> pd.DataFrame:
    if not design.shift:
        return rows
    target = rows["block"] == pool.target
    measure = _primary(pool, rows[target])
    scaled, logs = take_logarithms(pool.rows, [measure])
    means = scaled[scaled["block"] == pool.target].groupby(["group", "participant"])[measure].mean()
    by = design.shift * float(means.groupby("group").std().mean())
    first = rows["group"] == next(iter(pool.groups))
    where = {
        "groups": target & first,
        "conditions": rows["block"].isin(pool.analysis.conditions[:1]),
        "change": target & first & (rows["session"] > rows["session"].min()),
    }[design.on]
    values = rows[measure].astype(float)
    moved = values * math.exp(by) if measure in logs else values + by
    return rows.assign(**{measure: moved.where(where, values)})


def compare_study(rows: pd.DataFrame, pool: ReportPool, on: str) -> Iterator[tuple[str, float]]:
    """The corrected p of each comparison of the primary measure, as the report's page has it."""
    analysis, order = pool.analysis, list(pool.groups)
    if on == "conditions":
        within = compare_within(rows, analysis)
        if within is not None:
            primary = _primary(pool, rows[rows["block"].isin(analysis.conditions)])
            yield from (
                (f"{primary}: {one.first} - {one.second}", one.p_holm)
                for one in within.comparisons
                if one.measure == primary
            )
        return
    theirs = rows[rows["block"] == pool.target]
    primary = _primary(pool, theirs)
    named = [name for name in (analysis.primary_measure, *analysis.secondary_measures) if ":" in name]
    aside = set_measures_aside(theirs, late=int((theirs["success"] < 1).any()))
    measured = [*(name for name in list_default_measures(theirs) if name not in aside), *named]
    measured += [primary] if primary not in measured else []
    roles = assign_roles(measured, analysis)
    if analysis.primary_measure:  # the other roles are corrected by themselves
        roles = {name: role for name, role in roles.items() if role == "primary"}
    scaled, logs = take_logarithms(theirs, list(roles))
    frames = [scaled.groupby(["group", "participant"])[list(roles)].mean().reset_index()]
    if on == "change":
        frames = list(list_changes(scaled, list(roles)).values())
    for each in frames:
        for one in compare_measures(each, roles, order, logs, intervals=False):
            if one.measure == primary:
                yield f"{primary}: {one.first} - {one.second}", one.p_holm


def describe_report_power(pool: ReportPool, design: StudyDesign, found: Sequence[PowerEstimate], *, player: str) -> str:
    """Describe the result, for the terminal and a preregistration."""
    where = {
        "groups": f"in group {next(iter(pool.groups))}, block {pool.target}",
        "conditions": f"in block {(*pool.analysis.conditions, '')[0]}, within participants",
        "change": f"in the later sessions of group {next(iter(pool.groups))}, block {pool.target}",
    }[design.on]
    named = pool.analysis.primary_measure
    correction = "" if named else " The protocol names no primary measure, so all are corrected together."
    sizes = sorted({one.participants for one in found})
    ratios = ", ".join(f"{group} {ratio}" for group, ratio in pool.groups.items())
    width = max(len(one.measure) for one in found) + 2
    lines = [
        f"Power for a difference of {design.shift:g} standard deviations {where}: the share of {found[0].studies:,}",
        f"studies with p < {ALPHA:g} on the report's page, after its corrections.{correction}",
        f"Participants are drawn from {pool.rows['participant'].nunique()} simulated ones, player {player};",
        f"allocation ratio {ratios}; {design.drop_out:.0%} miss each session. In brackets: the Monte Carlo interval.",
        "",
        f"{'participants per group':<{width}}" + "".join(f"{size:>22}" for size in sizes),
    ]
    for name in dict.fromkeys(one.measure for one in found):
        at = {one.participants: one for one in found if one.measure == name}
        cells = (f"{at[size].power:.2f} ({at[size].low:.2f} to {at[size].high:.2f})" for size in sizes if size in at)
        lines.append(f"{name:<{width}}" + "".join(f"{cell:>22}" for cell in cells))
    return "\n".join(lines)


@dataclass(frozen=True, slots=True)
class ReportPower:
    """The estimates, and the text that says what they are."""

    estimates: tuple[PowerEstimate, ...]
    text: str


def plan_report_power(
    toml: bytes,
    effect: str,
    sizes: Sequence[int],
    *,
    on: str = "groups",
    drop_out: float = 0.0,
    studies: int,
    people: int,
    player: str,
    seed: int,
) -> ReportPower:
    """Simulate a pool and estimate the power of an effect such as ``shift=0.5``.

    Raises:
        ReportError: if the effect is none, or the protocol has no such comparison.
    """
    try:
        shift = float(effect.removeprefix("shift="))
    except ValueError:
        shift = math.nan
    if not math.isfinite(shift):
        raise ReportError(
            f"--effect {effect!r} is not valid; write it as shift=0.5, half a standard deviation of the primary measure"
        )
    design = StudyDesign(shift, on, drop_out)
    pool = simulate_report_pool(toml, people=people, player=player, seed=seed)
    found = estimate_report_power(pool, design, sizes, studies=studies, seed=seed)
    return ReportPower(found, describe_report_power(pool, design, found, player=player))
