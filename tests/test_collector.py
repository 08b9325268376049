import gc

from minihuman.figures.figure_data import infrequent_collection
from minihuman.runtime.warm_up import paused_collection


def test_cycles_are_looked_for_seldom_and_afterwards_as_before():
    usual = gc.get_threshold()
    with infrequent_collection():
        assert gc.isenabled()
        assert gc.get_threshold()[0] > 10 * usual[0]
    assert gc.get_threshold() == usual


def test_cycles_are_not_looked_for_at_all_and_afterwards_as_before():
    with paused_collection():
        assert not gc.isenabled()
    assert gc.isenabled()


def test_whoever_turned_the_collector_off_finds_it_off():
    gc.disable()
    try:
        with paused_collection():
            pass
        assert not gc.isenabled()
    finally:
        gc.enable()
