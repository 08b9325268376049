"""Scripts that analyse a report's tables again: in R (lme4, afex, brms) and Python (SciPy, statsmodels, Bambi).

They fit mixed models of the block on which groups are compared, and test the interaction of groups and conditions.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd
from jinja2 import Environment, PackageLoader, StrictUndefined

import minihuman
from minihuman.errors import ReportError
from minihuman.reporting.block_measures import label_measure
from minihuman.reporting.interactions import InteractionResults
from minihuman.reporting.results import Results

_FILES = {"r": "analysis.R", "python": "analysis.py"}
_CELLS = "cells.csv"


class _Expression(NamedTuple):
    """A measure of one episode as an expression in R and Python over the columns of the table of episodes."""

    r: str
    python: str


def _make_column_expression(name: str) -> _Expression:
    return _Expression(f"as.numeric(d${name})", f'd["{name}"].astype(float)')


def _make_logarithm_expression(name: str) -> _Expression:
    return _Expression(f"log(as.numeric(d${name}))", f'np.log(d["{name}"].astype(float))')


_OF_EPISODE = {  # measures of a block that are the mean of an episode's; times on their logarithms, as in the report
    "log_excess_steps_mean": _make_column_expression("log_excess_steps"),
    "log_steps_ratio_mean": _make_column_expression("log_steps_ratio"),
    "spl_mean": _make_column_expression("spl"),
    "reward_mean": _make_column_expression("reward"),
    "success": _make_column_expression("success"),
    "steps_at_limit_mean": _Expression(
        "ifelse(d$success, d$steps, d$max_steps)",
        'd["steps"].where(d["success"].eq(True), d["max_steps"]).astype(float).where(d["success"].notna())',
    ),
    "playing_s_mean": _make_logarithm_expression("playing_s"),
    "response_median_ms": _make_logarithm_expression("response_median_ms"),
    "reaction_median_ms": _make_logarithm_expression("reaction_median_ms"),
    "path_efficiency_mean": _make_column_expression("path_efficiency"),
}


def write_scripts(
    out: Path,
    study: str,
    results: Results,
    episodes: pd.DataFrame,
    languages: Sequence[str],
    interaction: InteractionResults | None = None,
) -> tuple[Path, ...]:
    """Write ``analysis.R`` and ``analysis.py`` into a report's folder; return the paths of all written files.

    The scripts analyse the block on which groups are compared and, in a mixed design, the interaction of groups and
    conditions from the file ``cells.csv``, which is written beside them. The block's measure is the primary one if it
    is a mean over episodes, else the first measure that is.

    ``languages`` are ``r``, ``python`` or both. ``interaction`` is None unless the design is mixed.

    Raises:
        ReportError: if there is no interaction, and no block is played by two groups or no measure is a mean over
            episodes.
    """
    context: dict[str, Any] = {"study": study, "version": minihuman.__version__, "block": "", "interaction": None}
    paths = []
    if interaction is not None:
        context["interaction"] = _describe_interaction(interaction)
        paths.append(_write_cells(out / _CELLS, interaction))
    try:
        context |= _describe_block(results, episodes)
    except ReportError:
        if interaction is None:
            raise
    environment = _make_environment()
    for language in languages:
        path = out / _FILES[language]
        path.write_text(environment.get_template(f"{path.name}.j2").render(context), encoding="utf-8", newline="\n")
        paths.append(path)
    return tuple(paths)


def _describe_block(results: Results, episodes: pd.DataFrame) -> dict[str, Any]:
    """Return the templates' variables about the block on which groups are compared.

    Raises:
        ReportError: if there is no such block with episodes and a measure that is a mean over episodes.
    """
    block = results.target_block
    if block is None or len(block.groups) < 2:
        raise ReportError(
            "--r and --python compare groups, but no block is played by two groups; leave these options out"
        )
    measures = sorted(block.roles, key=lambda name: block.roles[name] != "primary")
    measure = next((name for name in measures if name in _OF_EPISODE), None)
    if measure is None or episodes[episodes["block"] == block.block].empty:
        raise ReportError(
            f"--r and --python need a measure for each episode, which block {block.block} lacks; remove them"
        )
    return {
        "block": block.block,
        "groups": [str(group) for group in block.groups["group"]],
        "reference": str(block.groups["group"].iloc[-1]),
        "label": label_measure(measure),
        "expression": _OF_EPISODE[measure],
    }


def _describe_interaction(interaction: InteractionResults) -> dict[str, Any]:
    """Return the templates' variables about the interaction of groups and conditions."""
    weights = {
        contrast.name: [dict(contrast.weights).get(condition, 0.0) for condition in interaction.conditions]
        for contrast in interaction.tested_contrasts
    }
    return {
        "measure": label_measure(interaction.measure),
        "is_log": any(compared.groups.is_log for compared in interaction.headline),
        "groups": list(interaction.groups),
        "conditions": list(interaction.conditions),
        "contrasts": weights,
    }


def _write_cells(path: Path, interaction: InteractionResults) -> Path:
    """Write each participant's value in each condition, on the scale of the tests; return the path."""
    cells = interaction.scaled_cells.reset_index().melt(["group", "participant"], var_name="condition")
    cells.sort_values(["group", "participant"], kind="stable").to_csv(path, index=False, lineterminator="\n")
    return path


def _make_environment() -> Environment:
    """Create the Jinja environment that renders the scripts."""
    environment = Environment(
        loader=PackageLoader("minihuman.reporting", "templates"), undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True, keep_trailing_newline=True,
    )  # fmt: skip
    environment.filters["tojson"] = json.dumps
    return environment
