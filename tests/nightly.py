"""Leaves long proofs to the night: what is marked ``nightly`` runs by ``pytest -m nightly``, and by ``.ci/run all``.

- ``nightly``: the plain run leaves the test out.
- ``nightly(by_day=[ID, ...])``: the plain run takes these parameters of it.
- ``nightly(sample=True)``: the plain run takes a small sample of it, by the counts of `tests.counts`.

A test that is named by its own address (``FILE::TEST``) runs whatever its mark, and so do all where
``MINIHUMAN_NIGHTLY=1`` asks for full counts.
"""

import os
from collections import defaultdict

import pytest

FULL_COUNTS = "MINIHUMAN_NIGHTLY"  # in the environment: every proof at its full count


def choose_counts(config: pytest.Config) -> None:
    """Count in full where the nightly proofs are asked for, before any test is imported."""
    expression = str(config.option.markexpr)
    if "nightly" in expression and "not nightly" not in expression:
        os.environ.setdefault(FULL_COUNTS, "1")


def deselect_nightly(config: pytest.Config, items: list[pytest.Item]) -> int:
    """Leave out what only the night runs, and return how many tests that is.

    Raises:
        pytest.UsageError: if a mark names a parameter that its test does not have.
    """
    addressed = any("::" in argument for argument in config.args)
    if config.option.markexpr or addressed or os.environ.get(FULL_COUNTS) == "1":
        return 0
    if not config.option.keyword:  # with -k, some parameters of a test may be left out already
        _check_parameters(items)
    nightly = [item for item in items if is_only_nightly(item)]
    if nightly:
        config.hook.pytest_deselected(items=nightly)
        items[:] = [item for item in items if not is_only_nightly(item)]
    return len(nightly)


def is_only_nightly(item: pytest.Item) -> bool:
    """Tell whether the plain run leaves a test out."""
    for mark in item.iter_markers("nightly"):
        if not mark.kwargs.get("sample") and _parameters(item) not in mark.kwargs.get("by_day", ()):
            return True
    return False


def _parameters(item: pytest.Item) -> str:
    callspec = getattr(item, "callspec", None)
    return "" if callspec is None else str(callspec.id)


def _check_parameters(items: list[pytest.Item]) -> None:
    """Refuse a mark with a parameter that there is not: its test would never run by day."""
    wanted: defaultdict[str, set[str]] = defaultdict(set)
    existing: defaultdict[str, set[str]] = defaultdict(set)
    for item in items:
        function = item.nodeid.partition("[")[0]
        existing[function].add(_parameters(item))
        for mark in item.iter_markers("nightly"):
            wanted[function].update(mark.kwargs.get("by_day", ()))
    for function, parameters in wanted.items():
        unknown = parameters - existing[function]
        if unknown:
            known = sorted(existing[function])
            raise pytest.UsageError(f"{function}: nightly(by_day=...) names {sorted(unknown)}; there are {known}")
