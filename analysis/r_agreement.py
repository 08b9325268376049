"""Whether the report's R script agrees with the report and with R's own packages, on ten data sets.

``python analysis/r_agreement.py [--only NAME] [--out FOLDER]``

Each data set goes through the report's functions and its ``--r`` and ``--python`` scripts. Differences between groups'
contrast scores and the effects of the mixed model are compared in three digits; Kenward and Roger's F, degrees of
freedom and p, and the analysis of variance corrected for sphericity, with pbkrtest's and base R's, which
``r_agreement.R`` computes by other functions. ``r_agreement.csv`` has every number, ``r_agreement.md`` the table: the
report's p, Welch's and Kenward and Roger's side by side, and why they differ.
"""

import argparse
import csv
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pandas as pd

from minihuman.experiment.protocol.specs import AnalysisSpec
from minihuman.experiment.protocol.study_design import Contrast, ExperimentDesign, Factor
from minihuman.reporting.block_measures import MEASURES
from minihuman.reporting.interactions import ContrastComparison, InteractionResults, compute_interaction
from minihuman.reporting.results import compute_results
from minihuman.reporting.scripts import write_scripts
from minihuman.statistics.comparison import GroupComparison

FOLDER = Path(__file__).parent
EPISODES = 5
DIGITS = 1e-3  # how far apart, of the number, three digits may be
CLOSE = 0.01  # p that differ by less have no reason in the table
MEASURES_OF = {"log_excess_steps_mean": "log_excess_steps", "playing_s_mean": "playing_s"}
COLUMNS = ("data set", "what", "ours", "r", "agree")
HEADS = (
    *("data set", "contrast score", "difference", "in R", "p of the report", "p of Welch's t", "p of Kenward-Roger"),
    "why p differ",
)


@dataclass(frozen=True)
class DataSet:
    """A study: participants per group, their spread, and how they differ between conditions."""

    name: str
    sizes: tuple[int, ...]
    spreads: tuple[float, ...]  # of participants' own differences between conditions, per group
    conditions: str = "xy"
    measure: str = "log_excess_steps_mean"
    missing: int = 0  # participants without the last condition
    grows: bool = False  # whether a condition spreads more than the one before, against sphericity
    skewed: bool = False
    contrasts: tuple[Contrast, ...] = ()

    @property
    def groups(self) -> tuple[str, ...]:
        """The groups' names."""
        return tuple("abc"[: len(self.sizes)])


FACTORS = (
    Contrast("first factor", (("w", 0.5), ("x", 0.5), ("y", -0.5), ("z", -0.5))),
    Contrast("both factors", (("w", 1.0), ("x", -1.0), ("y", -1.0), ("z", 1.0))),
)
DATA_SETS = (
    DataSet("2 x 2, equal", (12, 12), (1, 1)),
    DataSet("2 x 2, small group spreads", (8, 20), (3, 1)),
    DataSet("2 x 2, large group spreads", (20, 8), (3, 1)),
    DataSet("2 x 3, spherical", (10, 10), (1, 1), conditions="xyz"),
    DataSet("2 x 3, not spherical", (9, 16), (1, 1), conditions="xyz", grows=True),
    DataSet("2 x 3, missing cells", (12, 14), (1, 1), conditions="xyz", missing=2),
    DataSet("3 x 2, unequal groups", (8, 12, 20), (1, 1, 1)),
    DataSet("3 x 2 x 2, stated contrasts", (10, 10, 10), (1, 1, 1), conditions="wxyz", contrasts=FACTORS),
    DataSet("2 x 2, log-normal times", (14, 14), (1, 1), measure="playing_s_mean"),
    DataSet("2 x 2, skewed", (10, 24), (1, 1), skewed=True),
)


def draw_episodes(data_set: DataSet) -> pd.DataFrame:
    """Return the table of episodes: conditions are blocks, and the first group gains in the first condition."""
    rng = np.random.default_rng([20261129, DATA_SETS.index(data_set)])
    rows = []
    for group, size, spread in zip(data_set.groups, data_set.sizes, data_set.spreads, strict=True):
        for number in range(size):
            level = rng.normal(2, 0.5)
            slope = rng.normal(-0.1, 0.06)
            for place, block in enumerate(data_set.conditions):
                own = rng.exponential() - 1 if data_set.skewed else rng.normal()
                value = level + 0.6 * spread * own * (1 + place * data_set.grows)
                value += 0.7 * (group == "a" and place == 0)
                rows += [
                    (f"{group}{number:02}", group, block, at, value + slope * (at - 3) + rng.normal(0, 0.3))
                    for at in range(1, EPISODES + 1)
                    if not (number < data_set.missing and place == len(data_set.conditions) - 1)
                ]
    frame = pd.DataFrame(rows, columns=["participant", "group", "block", "episode_in_block", "value"])
    success = rng.random(len(frame)) < 0.8
    column = MEASURES_OF[data_set.measure]
    times: dict[str, Any] = {"log_excess_steps": frame["value"], "playing_s": 9.0}
    if column == "playing_s":
        times["playing_s"] = np.exp(frame["value"])
    return frame.assign(
        **times, session=1, exclusion_reason=None, world="w", reward=0.5, steps=30, max_steps=90, success=success,
        outcome=np.where(success, "goal", "timeout"), episode=frame["episode_in_block"],
    )  # fmt: skip


def analyse(data_set: DataSet, out: Path) -> InteractionResults:
    """Write the report's scripts and their tables into a folder, and return what the report says."""
    episodes = draw_episodes(data_set)
    column = MEASURES_OF[data_set.measure]
    keys = ["group", "participant", "block"]
    means = episodes.groupby(keys)[column].mean().rename(data_set.measure)
    blocks = means.reset_index().assign(
        session=1, exclusion_reason=None, episodes=EPISODES, reward_sd=0.1, keys_total=0
    )
    blocks = blocks.assign(**{name: np.nan for name in MEASURES if name not in blocks})
    factors = (
        Factor("group", data_set.groups, is_within=False),
        Factor("condition", tuple(data_set.conditions), is_within=True),
    )
    design = ExperimentDesign(
        factors, primary_effect="interaction", contrasts=data_set.contrasts,
        condition_of_block=tuple(zip(data_set.conditions, data_set.conditions, strict=True)),
    )  # fmt: skip
    analysis = AnalysisSpec(primary_measure=data_set.measure)
    people = blocks[["participant", "session", "exclusion_reason"]]
    results = compute_results(episodes, blocks, people, analysis, design=design)
    interaction = compute_interaction(blocks, design, analysis, data_set.groups)
    assert interaction is not None
    (out / "tables").mkdir()
    episodes.to_csv(out / "tables" / "episodes.csv", index=False)
    write_scripts(out, "agreement", results, episodes, ("r", "python"), interaction)
    return interaction


def run_scripts(out: Path) -> None:
    """Run the report's two scripts and the reference in the report's folder."""
    shutil.copy(FOLDER / "r_agreement.R", out)
    for command in (["Rscript", "analysis.R"], ["Rscript", "r_agreement.R"], [sys.executable, "analysis.py"]):
        subprocess.run(command, cwd=out, check=True, capture_output=True, text=True)


def name_comparison(comparison: ContrastComparison) -> frozenset[str]:
    """Return the names of a contrast and of a pair of groups, as emmeans writes them in columns of their own."""
    return frozenset((comparison.contrast, f"{comparison.groups.first} - {comparison.groups.second}"))


def read_model_contrasts(out: Path) -> dict[frozenset[str], dict[str, float]]:
    """Return the estimate, degrees of freedom and p of emmeans, by the names of contrast and groups."""
    with (out / "contrasts_r.csv").open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    return {
        frozenset(cell for column, cell in row.items() if column.startswith("contrast")): {
            name: float(row[name]) for name in ("estimate", "df", "p.value")
        }
        for row in rows
    }


def compare_numbers(interaction: InteractionResults, out: Path) -> Iterator[tuple[str, float, float]]:
    """Yield what was computed twice: its name, the report's number or its script's, and R's own."""
    welch = pd.read_csv(out / "interaction_r.csv")
    of_model_by_names = read_model_contrasts(out)
    compared = [comparison for comparison in interaction.contrasts if comparison.groups.measure == interaction.measure]
    assert len(compared) == len(welch) == len(of_model_by_names)
    for comparison, (_, row) in zip(compared, welch.iterrows(), strict=True):
        groups = comparison.groups
        assert (comparison.contrast, groups.first, groups.second) == (row["contrast"], row["first"], row["second"])
        place = f"{comparison.contrast}, {groups.first} - {groups.second}"
        yield f"{place}: difference, t.test", groups.difference, row["difference"]
        estimate = of_model_by_names[name_comparison(comparison)]["estimate"]
        yield f"{place}: difference, emmeans", groups.difference, estimate
    models = [pd.read_csv(out / f"analysis_{language}.csv") for language in ("python", "r")]
    for term, ours, theirs in zip(models[1]["term"], models[0]["estimate"], models[1]["estimate"], strict=True):
        yield f"mixed model, {term}: estimate", ours, theirs
    model, anova, reference = (pd.read_csv(out / f"{name}_r.csv") for name in ("model", "anova", "reference"))
    (of_model,), (of_anova,) = (rows[rows["term"].eq("group:condition")].to_dict("records") for rows in (model, anova))
    (reference_row,) = reference.to_dict("records")
    for name, script, column in (
        ("Kenward-Roger F", of_model["F.value"], "kr_f"), ("Kenward-Roger df", of_model["DenDF"], "kr_df"),
        ("Kenward-Roger p", of_model["Pr..F."], "kr_p"), ("analysis of variance F", of_anova["F"], "aov_f"),
        ("Greenhouse-Geisser p", of_anova["Pr..F."], "gg_p"),
    ):  # fmt: skip
        yield f"interaction: {name}", script, reference_row[column]


def is_equal(ours: float, theirs: float) -> bool:
    """Return whether two numbers are equal to three digits."""
    return bool(abs(ours - theirs) <= DIGITS * max(abs(theirs), DIGITS))


def describe_p(data_set: DataSet, interaction: InteractionResults, out: Path) -> Iterator[str]:
    """Yield the table's rows: a contrast's difference and p by the report, by Welch's t, by Kenward and Roger."""
    welch = pd.read_csv(out / "interaction_r.csv")
    of_model_by_names = read_model_contrasts(out)
    for comparison, (_, row) in zip(interaction.headline, welch.iterrows(), strict=True):
        groups = comparison.groups
        of_model = of_model_by_names[name_comparison(comparison)]
        why = explain(groups, row["p_welch"], of_model["p.value"], interaction, comparison.contrast)
        yield (
            f"| {data_set.name} | {comparison.contrast}, {groups.first} - {groups.second} | {groups.difference:.3f} "
            f"| {row['difference']:.3f} | {groups.p:.4f} | {row['p_welch']:.4f} (df {row['df']:.1f}) "
            f"| {of_model['p.value']:.4f} (df {of_model['df']:.1f}) | {why} |"
        )


def explain(
    groups: GroupComparison, welch_p: float, model_p: float, interaction: InteractionResults, contrast: str
) -> str:
    """Return why the report's p differs from R's; "" where both are within ``CLOSE``."""
    reasons = []
    if abs(groups.p - welch_p) > CLOSE:
        reasons.append("permutation instead of the t distribution")
    if abs(groups.p - model_p) > CLOSE:
        weights = dict(next(tested.weights for tested in interaction.tested_contrasts if tested.name == contrast))
        scores = interaction.scaled_cells[list(weights)].dropna() @ np.array(list(weights.values()))
        spreads = scores.groupby("group").std()
        first, second = spreads[groups.first], spreads[groups.second]
        reasons.append(
            "the model has one variance for all groups and conditions; "
            f"SDs of these scores {first:.2f} and {second:.2f}"
        )
    return "; ".join(reasons)


def main() -> None:
    """Compare, write and print."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--only", default="", help="data sets whose names hold this")
    options.add_argument("--out", type=Path, default=FOLDER)
    given = options.parse_args()
    rows: list[tuple[str, str, str, str, str]] = []
    lines = [f"| {' | '.join(HEADS)} |", "|" + " --- |" * len(HEADS)]
    versions = pd.DataFrame()
    for data_set in DATA_SETS:
        if given.only not in data_set.name:
            continue
        with TemporaryDirectory(prefix="minihuman-r-") as name:
            out = Path(name)
            interaction = analyse(data_set, out)
            run_scripts(out)
            numbers = list(compare_numbers(interaction, out))
            rows += [
                (data_set.name, what, f"{ours:.6g}", f"{theirs:.6g}", "yes" if is_equal(ours, theirs) else "no")
                for what, ours, theirs in numbers
            ]
            lines += describe_p(data_set, interaction, out)
            versions = pd.read_csv(out / "versions_r.csv")
        print(data_set.name, sum(row[4] == "no" for row in rows), "of", len(rows), "differ so far", flush=True)
    with (given.out / "r_agreement.csv").open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(COLUMNS)
        table.writerows(rows)
    programs = ", ".join(f"{package} {version}" for package, version in versions.itertuples(index=False))
    lines += ["", f"{len(rows)} numbers, {sum(row[4] == 'no' for row in rows)} differ in three digits. {programs}."]
    (given.out / "r_agreement.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    print("\n".join(lines))


if __name__ == "__main__":
    main()
