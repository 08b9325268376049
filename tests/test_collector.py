import gc
from collections.abc import Iterator

import pytest

from minihuman.dataset.log_files import infrequent_collection

PYTHONS_OWN = (700, 10, 10)


@pytest.fixture
def usual() -> Iterator[tuple[int, int, int]]:
    """Python's own thresholds; this process may have others, as tests collect less often."""
    before = gc.get_threshold()
    gc.set_threshold(*PYTHONS_OWN)
    yield PYTHONS_OWN
    gc.set_threshold(*before)


def test_cycles_are_looked_for_seldom_and_afterwards_as_before(usual: tuple[int, int, int]) -> None:
    with infrequent_collection():
        assert gc.isenabled()
        assert gc.get_threshold()[0] > 10 * usual[0]
    assert gc.get_threshold() == usual
