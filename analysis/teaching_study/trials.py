"""Simulated trials: one small file of rows each, so that an interrupted run resumes; means over seeds."""

import json
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
import scipy
import torch

from minihuman.learn.policy.file import get_versions
from minihuman.storage.durable_files import write_atomically

Trial = tuple[Callable[..., Sequence[Any]], tuple[Any, ...]]  # a module's function that gives rows, and its arguments


def run_trials(trials: Mapping[Path, Trial], *, workers: int) -> list[dict[str, Any]]:
    """The rows of all trials, as plain values; those that have no file yet are run."""
    missing = [(path, *trial) for path, trial in trials.items() if not path.exists()]
    for path, *_ in missing:
        path.parent.mkdir(parents=True, exist_ok=True)
    if workers == 1 or len(missing) < 2:
        for one in missing:
            _run(*one)
    else:
        with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
            for done in [pool.submit(_run, *one) for one in missing]:
                done.result()
    return [row for path in trials for row in json.loads(path.read_text())]


def write_results(out: Path, name: str, rows: Sequence[dict[str, Any]], text: str, command: str) -> None:
    """Write rows, command and versions to ``NAME.json``, and the table to ``NAME.md``."""
    numbers = {"rows": list(rows), "command": command, "versions": get_versions()}
    write_atomically(json.dumps(numbers, indent=1) + "\n", out / f"{name}.json")
    write_atomically(text, out / f"{name}.md")


def describe_command(command: str) -> list[str]:
    """The last lines of a table: how it was made."""
    return [f"Command: `{command}`", "", "Versions: " + ", ".join(f"{k} {v}" for k, v in get_versions().items())]


def mean_interval(values: Sequence[float]) -> tuple[float, float, float]:
    """Mean, and the 95 % interval of Student's t over seeds; without width for a single one."""
    mean = float(np.mean(values))
    if len(values) < 2:
        return mean, mean, mean
    half = float(scipy.stats.t.ppf(0.975, len(values) - 1) * np.std(values, ddof=1) / len(values) ** 0.5)
    return mean, mean - half, mean + half


def format_interval(values: Sequence[float]) -> str:
    """The mean of shares and its interval in words, as in "0.90 [0.87, 0.94]"; a single one has none."""
    mean, low, high = mean_interval(values)
    return f"{mean:.2f} [{max(0.0, low):.2f}, {min(1.0, high):.2f}]" if len(values) > 1 else f"{mean:.2f} (one seed)"


def _run(path: Path, make: Callable[..., Sequence[Any]], arguments: tuple[Any, ...]) -> None:
    torch.set_num_threads(1)  # such small networks are faster so, and sums come in one order
    write_atomically(json.dumps([asdict(row) for row in make(*arguments)], indent=1), path)
