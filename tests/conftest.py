"""Fixtures that more than one folder of tests needs."""

import os
from collections.abc import Iterator

import pytest
from hypothesis import HealthCheck, settings

from tests.xserver import xvfb

# How fast this machine is just now is no property of the code. Examples are the same each time in CI, as Hypothesis has
# it there by default: what is judged is a change. Everywhere else they are new ones each time.
settings.register_profile(
    "minihuman", deadline=None, suppress_health_check=[HealthCheck.too_slow], derandomize="CI" in os.environ
)
settings.load_profile("minihuman")


@pytest.fixture(scope="session")
def display() -> Iterator[str]:
    """An X display of our own, ":12"; one for the whole run."""
    with xvfb() as name:
        yield name
