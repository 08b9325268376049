"""Power of the report's comparisons: studies drawn from simulated participants go through the report's own functions.

From the table of blocks on, everything is the report's: logarithms, roles, Holm's correction, conditions within
participants, changes between sessions, and group sizes by their allocation ratio. Participants who drop out are missing
from some session on.
"""

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory

import msgspec
import numpy as np
import pandas as pd

from minihuman.dataset.table_catalogue import EVERY_MOMENT, TABLES
from minihuman.dataset.tables import Tables, select
from minihuman.errors import ReportError
from minihuman.experiment.protocol.protocol import Protocol, decode_protocol
from minihuman.experiment.protocol.specs import AnalysisSpec
from minihuman.experiment.protocol.study_design import ExperimentDesign, derive_design
from minihuman.planning.power import ALPHA, PowerEstimate, tabulate_power
from minihuman.reporting.activity_sections import SectionSource, build_activity_sections
from minihuman.reporting.analysed_rows import blank_goal_measures
from minihuman.reporting.block_measures import assign_roles, list_default_measures, set_measures_aside, take_logarithms
from minihuman.reporting.block_results import compare_measures, list_changes
from minihuman.reporting.interactions import InteractionResults, compute_interaction
from minihuman.reporting.results import find_target_block
from minihuman.reporting.study_measures import add_measures
from minihuman.reporting.within_results import (
    compare_within,
    measure_levels,
    name_conditions,
    read_label,
    select_measures,
    unite_teams,
)
from minihuman.runtime.simulated_session import simulate
from minihuman.statistics.scores import wilson_interval
from minihuman.statistics.units import find_units, name_units

COMPARISONS = ("groups", "conditions", "interaction", "change")
_TABLES = ("blocks", "episodes", "participants", "answers", "parts", "points", "teams")
_TRIAL_TABLES = (*(name for name in TABLES if name not in EVERY_MOMENT), "steps")  # of the sections on activities


@dataclass(frozen=True, slots=True)
class StudyDesign:
    """The assumptions of a simulated study: the effect, the comparison that has it, and the rate of drop-out."""

    shift: float = 0.0  # of the primary measure, in standard deviations between participants
    on: str = "groups"  # which of `COMPARISONS` has it; `_mark_affected` says in which rows
    drop_out: float = 0.0  # the chance to be missing from a session, and from all later ones

    def __post_init__(self) -> None:
        """Check that the comparison exists, and that the drop-out is a probability."""
        if self.on not in COMPARISONS:
            raise ReportError(f"--on {self.on!r} is unknown; use one of {', '.join(COMPARISONS)}")
        if not 0 <= self.drop_out < 1:
            raise ReportError(
                f"--drop-out {self.drop_out:g} is not valid; use a probability of 0 or more and less than 1"
            )


@dataclass(frozen=True, slots=True, eq=False)
class ReportPool:
    """Simulated participants as the report reads them: the table of blocks, without practice blocks.

    The column ``person`` is the participant who played. The column ``participant`` is the unit of the statistics, which
    is the team where participants played together. The column ``drawn`` is the unit of sampling: all who are connected
    by a chain of teams.
    """

    rows: pd.DataFrame  # those of excluded participants, too
    groups: Mapping[str, int]  # in the order of the report, with their allocation ratio
    analysis: AnalysisSpec
    target: str
    design: ExperimentDesign = field(default_factory=ExperimentDesign)
    levels: "ReportPool | None" = None  # with a row per level of the label of trials whose levels are the conditions

    def select_comparison(self, comparison: str) -> "ReportPool":
        """Return the pool whose rows are compared: ``levels`` if the compared conditions are levels of a label."""
        if self.levels is not None and comparison in ("conditions", "interaction"):
            return self.levels
        return self


def simulate_report_pool(
    toml: bytes, *, people: int, player: str, seed: int, files: Mapping[str, bytes] | None = None
) -> ReportPool:
    """Simulate whole sessions of participants in every group, without leaving files on disk.

    ``people`` is their number, ``player`` their name and settings; ``files`` has the protocol's files, by name.

    Raises:
        ProtocolError: if the protocol is invalid.
        SimulationError: if there is no such player, or it cannot play a block's world.
        ReportError: if the protocol names a measure that the sessions do not give.
    """
    protocol = decode_protocol(toml, "protocol", files)
    study = msgspec.structs.replace(protocol.study, participants=people)
    with TemporaryDirectory(prefix="minihuman-power-") as folder:
        pool_protocol = msgspec.structs.replace(protocol, study=study)
        list(simulate(pool_protocol, Path(folder), participants=people, seed=seed, player=player))
        with select(Path(folder), processes=1) as tables:
            needs_trials = _needs_trials(protocol.analysis)
            tables.require(_TRIAL_TABLES if needs_trials else _TABLES, shortest_paths=True)
            frames = {name: tables.frame(name) for name in _TABLES}
            if needs_trials:
                frames |= _measure_trials(tables, protocol, Path(folder))
            return make_report_pool(protocol, frames)


def _needs_trials(analysis: AnalysisSpec) -> bool:
    """Return whether an analysis names measures of trials, or a label whose levels are the conditions."""
    return bool(analysis.condition_label) or any(name.startswith("trials:") for name in analysis.find_plugin_measures())


def _measure_trials(tables: Tables, protocol: Protocol, folder: Path) -> dict[str, pd.DataFrame]:
    """Return the tables of measures that the report's sections on activities compute, by name, without practice."""
    practice = frozenset(
        (group.name, block.name) for group in protocol.groups for block in protocol.blocks if not block.analysed
    )
    frames: dict[str, pd.DataFrame] = {}
    for section in build_activity_sections(SectionSource(tables, folder, practice)):
        frames |= section.measure_tables
    return frames


def make_report_pool(protocol: Protocol, tables: Mapping[str, pd.DataFrame]) -> ReportPool:
    """Return the pool of the participants in a study's tables.

    Args:
        protocol: the study.
        tables: the tables by name: "blocks" and "teams", and those others that the analysis needs.
    """
    analysis = protocol.analysis
    rows = add_measures(tables["blocks"], tables, analysis.find_plugin_measures())
    analysed = {block.name for block in protocol.blocks if block.analysed}
    rows = rows[rows["block"].isin(analysed)]
    if "episodes" in tables:
        rows = blank_goal_measures(rows, tables["episodes"], analysis)
    rows = rows.assign(person=rows["participant"])
    sampling_units = name_units(rows, find_units(tables["teams"]))["participant"]
    rows = unite_teams(rows, tables["teams"]).assign(drawn=sampling_units).reset_index(drop=True)
    n_blocks = rows.groupby("group")["block"].nunique()
    ratios = {group.name: group.allocation_ratio for group in protocol.groups}
    order = sorted(map(str, n_blocks.index), key=lambda group: (-int(n_blocks[group]), group))
    groups = {group: ratios[group] for group in order}
    target = analysis.block or find_target_block(rows[rows["exclusion_reason"].isna()])
    pool = ReportPool(rows, groups, analysis, target, derive_design(protocol))
    if not analysis.condition_label:
        return pool
    episodes = tables["episodes"]
    return replace(
        pool, levels=_make_level_pool(pool, episodes[episodes["block"].isin(analysed)], tables.get("trial_levels"))
    )


def _make_level_pool(pool: ReportPool, episodes: pd.DataFrame, trial_levels: pd.DataFrame | None) -> ReportPool | None:
    """Return the pool with a row per participant, session and level of the analysis's label; None without two levels.

    Participants whose trials are all excluded are drawn as often as others, so each has a row, which is excluded.
    ``episodes`` are without practice; ``trial_levels`` has the measures of trials by level, if the analysis names any.
    """
    label = pool.analysis.condition_label
    included = episodes[episodes["exclusion_reason"].isna()]
    rows = measure_levels(included, label, trial_levels)
    names = sorted(rows["block"].unique())
    if len(names) < 2:
        return None
    keys = ["participant", "session", "block"]
    trials = included.assign(block=read_label(included, label)).groupby(keys).size().rename("episodes")
    rows = rows.merge(trials.reset_index(), on=keys).assign(exclusion_reason=None)
    without_trials = pool.rows[~pool.rows["person"].isin(rows["participant"])].drop_duplicates("person")
    excluded_rows = without_trials[["group", "participant", "session"]].assign(
        block=names[0], exclusion_reason="no trial counts"
    )
    rows = pd.concat([rows, excluded_rows], ignore_index=True)
    rows = rows.assign(person=rows["participant"], drawn=rows["participant"])
    analysis = msgspec.structs.replace(select_measures(pool.analysis, rows), conditions=tuple(names))
    return replace(pool, rows=rows, analysis=analysis, design=pool.design.add_levels(names))


def estimate_report_power(
    pool: ReportPool, design: StudyDesign, sizes: Sequence[int], *, studies: int, seed: int
) -> tuple[PowerEstimate, ...]:
    """Estimate the share of studies in which the report's corrected p of each comparison is below 5 %.

    Per size, there is an estimate for each comparison of the primary measure, and one for any of them. If the protocol
    names no primary measure, the first one that has values is used.

    Args:
        pool: the simulated participants.
        design: the effect and the drop-out.
        sizes: the numbers of participants per group, before they are multiplied by the group's allocation ratio.
        studies: the number of studies per size.
        seed: the seed of the draws.

    Raises:
        ReportError: if the protocol does not have the comparison of the design.
    """
    estimates = []
    pool = pool.select_comparison(design.on)
    if not _has_comparison(pool, design.on):
        raise ReportError(
            f"the protocol has no comparison of {design.on}; add one to [analysis], or choose another with --on"
        )
    for size in sizes:
        rng = np.random.default_rng([seed, size])
        counts = Counter[str]()
        for _ in range(studies):
            comparisons = compare_study(draw_study(pool, design, size, rng), pool, design.on)
            rejected = {name: p < ALPHA for name, p in comparisons}
            if len(rejected) > 1:
                rejected["any of them"] = any(rejected.values())
            counts.update(rejected)
        for name, n_rejected in counts.items():
            low, high = wilson_interval(n_rejected, studies)
            estimates.append(PowerEstimate(name, size, n_rejected / studies, low, high, studies))
    return tuple(estimates)


def _has_comparison(pool: ReportPool, comparison: str) -> bool:
    """Return whether the protocol has a comparison, which is one of `COMPARISONS`."""
    has_several_groups = len(pool.groups) > 1
    possible = {
        "groups": has_several_groups,
        "conditions": len(pool.analysis.conditions) > 1,
        "interaction": pool.design.is_mixed,
        "change": has_several_groups and pool.rows["session"].nunique() > 1,
    }
    return possible[comparison]


def draw_study(pool: ReportPool, design: StudyDesign, size: int, rng: np.random.Generator) -> pd.DataFrame:
    """Return the included rows of one study's table of blocks, with the effect added.

    Participants, or whole teams, are drawn with replacement: ``size`` of them per group, times its allocation ratio.
    """
    measure, is_log, shifted_rows = _find_effect(pool, design)
    rows = _draw_participants(pool, shifted_rows, size, rng)
    if design.drop_out:
        rows = _drop_out(rows, design.drop_out, rng)
    rows = rows[rows["exclusion_reason"].isna()]
    measured = rows[measure].astype(float)
    move = rows["move"]
    if measure == "success":
        return rows.assign(success=_move_success(rows, measured, rng))
    if is_log:
        return rows.assign(**{measure: measured * np.exp(move)})
    return rows.assign(**{measure: measured + move})


def _draw_participants(pool: ReportPool, rows: pd.DataFrame, size: int, rng: np.random.Generator) -> pd.DataFrame:
    """Return the rows of participants of each group, or whole teams, drawn with replacement and numbered by draw."""
    samples = []
    for group, ratio in pool.groups.items():
        group_rows = rows[rows["group"] == group]
        unit_indices = [*group_rows.groupby("drawn").indices.values()]  # of each unit of sampling, its rows
        n_draws = round(size * ratio * len(unit_indices) / group_rows["person"].nunique())
        drawn_indices = [unit_indices[unit] for unit in rng.integers(len(unit_indices), size=n_draws)]
        sample = group_rows.iloc[np.concatenate(drawn_indices)]
        draw_numbers = np.repeat(np.arange(n_draws), [len(indices) for indices in drawn_indices])
        for column in ("participant", "person"):
            codes = [f"{number}/{code}" for number, code in zip(draw_numbers, sample[column], strict=True)]
            sample = sample.assign(**{column: codes})
        samples.append(sample)
    return pd.concat(samples, ignore_index=True)


def _drop_out(rows: pd.DataFrame, chance: float, rng: np.random.Generator) -> pd.DataFrame:
    """Return the rows without the session in which a person drops out, with probability ``chance``, and later ones."""
    sessions = sorted({*rows["session"]})
    first_missed: dict[object, float] = {}
    for person in rows["person"].unique():
        missed_sessions = (session for session in sessions if rng.random() < chance)
        first_missed[person] = next(missed_sessions, math.inf)
    return rows[rows["session"] < rows["person"].map(first_missed)]


def _move_success(rows: pd.DataFrame, shares: "pd.Series[float]", rng: np.random.Generator) -> "pd.Series[float]":
    """Return the shares of successes after the effect, from 0 to 1; the rows have the columns of `_find_effect`.

    An upward move turns each failure into a success with a chance that moves the mean of the cell as far as intended; a
    downward move does the reverse.
    """
    move = rows["move"]
    movable_share = shares.where(move < 0, 1 - shares)
    chance = (move.abs() / rows["middle"].where(move < 0, 1 - rows["middle"])).fillna(0).clip(0, 1)
    n_movable = (movable_share * rows["episodes"]).round().fillna(0).astype(int)
    moved: pd.Series[float] = shares + np.sign(move) * rng.binomial(n_movable, chance) / rows["episodes"]
    return moved


def _find_primary_measure(pool: ReportPool, rows: pd.DataFrame) -> str:
    """Return the primary measure: the one that the protocol names, or the first that has values; "" if none has."""
    return pool.analysis.primary_measure or next(iter(list_default_measures(rows)), "")


def _list_first_blocks(pool: ReportPool) -> list[str]:
    """Return the names of the blocks of the first condition; blocks are conditions themselves if none are named."""
    condition_of_block = dict(pool.design.condition_of_block) or {block: block for block in pool.analysis.conditions}
    first_condition = next(iter(condition_of_block.values()), "")
    return [block for block, condition in condition_of_block.items() if condition == first_condition]


@lru_cache(maxsize=1)
def _find_effect(pool: ReportPool, design: StudyDesign) -> tuple[str, bool, pd.DataFrame]:
    """Return the primary measure, whether it is compared as logarithms, and the pool's rows with the shift of each.

    The cells that are compared are first shifted to a common mean, so that they differ only by the design's effect and
    not by a difference of the simulated groups or conditions. The column ``move`` is the whole shift of a row, and
    ``middle`` the mean of its cell before the shift.
    """
    within = design.on in ("conditions", "interaction")
    rows = pool.rows
    cell = {"conditions": ["block"], "interaction": ["block", "group"]}.get(design.on, ["group", "session"])
    if within:
        compared = rows["block"].isin(pool.analysis.conditions)
    else:
        compared = rows["block"] == pool.target
    compared_rows = rows[compared & rows["exclusion_reason"].isna()]
    measure = _find_primary_measure(pool, compared_rows)
    scaled, logs = take_logarithms(compared_rows, [measure])
    measured = scaled[measure].astype(float)
    person_means = scaled.groupby(["block", "group", "participant"])[measure].mean()
    cell_mean = measured.groupby([compared_rows[name] for name in cell]).transform("mean")
    common_mean: float | pd.Series[float] = measured.mean()
    if not within:
        common_mean = measured.groupby(compared_rows["session"]).transform("mean")
    sd_between_persons = float(person_means.groupby(["block", "group"]).std().mean())
    has_effect = _mark_affected(pool, design.on, compared_rows)
    move = common_mean - cell_mean + design.shift * sd_between_persons * has_effect
    return measure, measure in logs, rows.assign(move=move, middle=cell_mean).fillna({"move": 0.0})


def _mark_affected(pool: ReportPool, comparison: str, compared_rows: pd.DataFrame) -> "pd.Series[bool]":
    """Return a mask of the compared rows that have the effect: of the first condition, the first group, or both.

    A change is that of the first group in all sessions after the first.
    """
    is_first_condition = compared_rows["block"].isin(_list_first_blocks(pool))
    is_first_group: pd.Series[bool] = compared_rows["group"].eq(next(iter(pool.groups)))
    if comparison == "conditions":
        return is_first_condition
    if comparison == "interaction":
        return is_first_condition & is_first_group
    if comparison == "change":
        return is_first_group & compared_rows["session"].gt(pool.rows["session"].min())
    return is_first_group


def compare_study(rows: pd.DataFrame, pool: ReportPool, on: str) -> Iterator[tuple[str, float]]:
    """Yield the name and corrected p of each comparison of the kind ``on``, one of `COMPARISONS`, as in the report."""
    analysis = pool.analysis
    order = list(pool.groups)
    if on == "interaction":
        interaction = compute_interaction(rows, pool.design, analysis, tuple(order), intervals=False)
        if interaction is not None:
            yield from _list_interaction_ps(interaction)
        return
    if on == "conditions":
        yield from _list_condition_ps(rows, pool)
        return
    yield from _list_group_ps(rows, pool, order, is_change=on == "change")


def _list_condition_ps(rows: pd.DataFrame, pool: ReportPool) -> Iterator[tuple[str, float]]:
    """Yield the name and the corrected p of each pair of conditions."""
    named_rows, analysis = name_conditions(rows, pool.analysis, pool.design)
    within = compare_within(named_rows, analysis, pool.design.contrasts, has_order=not pool.design.condition_label)
    if within is None:
        return
    primary = _find_primary_measure(pool, rows[rows["block"].isin(pool.analysis.conditions)])
    for comparison in within.comparisons:
        if comparison.measure == primary:
            names = " - ".join(filter(None, (comparison.first, comparison.second)))
            yield f"{primary}: {names}", comparison.p_holm


def _list_group_ps(
    rows: pd.DataFrame, pool: ReportPool, order: Sequence[str], *, is_change: bool
) -> Iterator[tuple[str, float]]:
    """Yield the name and corrected p of each pair of groups in the target block; if ``is_change``, of their changes."""
    analysis = pool.analysis
    target_rows = rows[rows["block"] == pool.target]
    primary = _find_primary_measure(pool, target_rows)
    named = [name for name in (analysis.primary_measure, *analysis.secondary_measures) if ":" in name]
    aside = set_measures_aside(target_rows, late=int((target_rows["success"] < 1).any()))
    measured = [*(name for name in list_default_measures(target_rows) if name not in aside), *named, primary]
    roles = assign_roles(measured, analysis)
    if analysis.primary_measure:  # the other roles are corrected by themselves
        roles = {name: role for name, role in roles.items() if role == "primary"}
    scaled, logs = take_logarithms(target_rows, list(roles))
    if is_change:
        frames = list(list_changes(scaled, list(roles)).values())
    else:
        frames = [scaled.groupby(["group", "participant"])[list(roles)].mean().reset_index()]
    for frame in frames:
        for comparison in compare_measures(frame, roles, order, logs, intervals=False):
            if comparison.measure == primary:
                yield f"{primary}: {comparison.first} - {comparison.second}", comparison.p_holm


def _list_interaction_ps(interaction: InteractionResults) -> Iterator[tuple[str, float]]:
    """Yield the name and p of the omnibus test of the interaction, or of its contrasts if there is no such test."""
    omnibus = next((test for test in interaction.omnibus if test.measure == interaction.measure), None)
    if omnibus is not None:
        yield f"{interaction.measure}: interaction", omnibus.p_holm
        return
    for compared in interaction.headline:
        groups = compared.groups
        yield f"{interaction.measure}: {compared.contrast}, {groups.first} - {groups.second}", groups.p_holm


def describe_report_power(
    pool: ReportPool, design: StudyDesign, estimates: Sequence[PowerEstimate], *, player: str
) -> str:
    """Return the power analysis as text, for the terminal and a preregistration."""
    has_levels = pool.levels is not None
    pool = pool.select_comparison(design.on)
    condition = "level" if has_levels else "block"
    first_condition = next(iter(pool.analysis.conditions), "")
    first_group = next(iter(pool.groups))
    location = {
        "groups": f"in group {first_group}, block {pool.target}",
        "conditions": f"in {condition} {first_condition}, within participants",
        "interaction": f"in {condition} {first_condition} of group {first_group} alone",
        "change": f"in the later sessions of group {first_group}, block {pool.target}",
    }[design.on]
    if pool.analysis.primary_measure:
        sentence = ""
    else:
        sentence = " The protocol names no primary measure, so all are corrected together."
    studies = estimates[0].studies
    n_simulated = pool.rows["person"].nunique()
    ratios = ", ".join(f"{group} {ratio}" for group, ratio in pool.groups.items())
    lines = [
        f"Power for a difference of {design.shift:g} standard deviations {location}: the share of {studies:,}",
        f"studies with p < {ALPHA:g} on the report's page, after its corrections.{sentence}",
        f"Participants are drawn from {n_simulated} simulated ones, player {player};",
        f"allocation ratio {ratios}; {design.drop_out:.0%} miss each session. In brackets: the Monte Carlo interval.",
        "",
    ]
    return "\n".join([*lines, *tabulate_power(estimates)])


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
    files: Mapping[str, bytes] | None = None,
) -> tuple[tuple[PowerEstimate, ...], str]:
    """Simulate a pool and estimate the power of an effect; return the estimates and their text.

    Args:
        toml: the protocol.
        effect: the shift of the primary measure in standard deviations, such as ``shift=0.5``.
        sizes: the numbers of participants per group, before they are multiplied by the group's allocation ratio.
        on: the comparison that has the effect, one of `COMPARISONS`.
        drop_out: the chance to be missing from a session and from all later ones.
        studies: the number of simulated studies per size.
        people: the number of simulated participants.
        player: the simulated participants' name and settings.
        seed: the seed of the simulation and of the draws.
        files: the contents of the files that the protocol names, by name.

    Raises:
        ReportError: if the effect is not valid, or the protocol does not have the comparison.
    """
    design = StudyDesign(_parse_shift(effect), on, drop_out)
    pool = simulate_report_pool(toml, people=people, player=player, seed=seed, files=files)
    estimates = estimate_report_power(pool, design, sizes, studies=studies, seed=seed)
    return estimates, describe_report_power(pool, design, estimates, player=player)


def _parse_shift(effect: str) -> float:
    """Return the number of an effect such as ``shift=0.5``; raise `ReportError` if the text is no such effect."""
    try:
        shift = float(effect.removeprefix("shift="))
    except ValueError:
        shift = math.nan
    if not math.isfinite(shift):
        raise ReportError(
            f"--effect {effect!r} is not valid; write it as shift=0.5, half a standard deviation of the primary measure"
        )
    return shift
