"""Scripts that fit mixed models to a report's tables: in R (lme4, brms) and Python (statsmodels, Bambi)."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import pandas as pd
from jinja2 import Environment, PackageLoader, StrictUndefined

import minihuman
from minihuman.errors import ReportError
from minihuman.reporting.block_measures import label_measure
from minihuman.reporting.results import Results

_FILES = {"r": "analysis.R", "python": "analysis.py"}


class _Expression(NamedTuple):
    """A measure of one episode as an expression in R and Python over the columns of the table of episodes."""

    r: str
    python: str


def _column(name: str) -> _Expression:
    return _Expression(f"as.numeric(d${name})", f'd["{name}"].astype(float)')


def _logarithm(name: str) -> _Expression:
    return _Expression(f"log(as.numeric(d${name}))", f'np.log(d["{name}"].astype(float))')


_OF_EPISODE = {  # measures of a block that are the mean of an episode's; times on their logarithms, as in the report
    "log_excess_steps_mean": _column("log_excess_steps"),
    "log_steps_ratio_mean": _column("log_steps_ratio"),
    "spl_mean": _column("spl"),
    "reward_mean": _column("reward"),
    "success": _column("success"),
    "steps_at_limit_mean": _Expression(
        "ifelse(d$success, d$steps, d$max_steps)",
        'd["steps"].where(d["success"].eq(True), d["max_steps"]).astype(float).where(d["success"].notna())',
    ),
    "playing_s_mean": _logarithm("playing_s"),
    "response_median_ms": _logarithm("response_median_ms"),
    "reaction_median_ms": _logarithm("reaction_median_ms"),
    "path_efficiency_mean": _column("path_efficiency"),
}


def write_scripts(
    out: Path, study: str, results: Results, episodes: pd.DataFrame, languages: Sequence[str]
) -> tuple[Path, ...]:
    """Write ``analysis.R`` and ``analysis.py`` into a report's folder, for the block on which groups are compared.

    The measure is the primary one if it is a mean over episodes, else the first that is.

    Raises:
        ReportError: if no block is played by two groups, or no such measure has values.
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
    context = {
        "study": study,
        "block": block.block,
        "version": minihuman.__version__,
        "groups": [str(group) for group in block.groups["group"]],
        "reference": str(block.groups["group"].iloc[-1]),
        "label": label_measure(measure),
        "expression": _OF_EPISODE[measure],
    }
    environment = _make_environment()
    paths = []
    for language in languages:
        path = out / _FILES[language]
        path.write_text(environment.get_template(f"{path.name}.j2").render(context), encoding="utf-8", newline="\n")
        paths.append(path)
    return tuple(paths)


def _make_environment() -> Environment:
    """Create the Jinja environment that renders the scripts."""
    environment = Environment(
        loader=PackageLoader("minihuman.reporting", "templates"), undefined=StrictUndefined, trim_blocks=True,
        lstrip_blocks=True, keep_trailing_newline=True,
    )  # fmt: skip
    environment.filters["tojson"] = json.dumps
    return environment
