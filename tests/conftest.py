"""Fixtures that more than one folder of tests needs."""

from collections.abc import Iterator

import pytest

from tests.xserver import xvfb


@pytest.fixture(scope="session")
def display() -> Iterator[str]:
    """An X display of our own, ":12"; one for the whole run."""
    with xvfb() as name:
        yield name
