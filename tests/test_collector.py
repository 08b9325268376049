import gc

from minihuman.dataset.log_files import infrequent_collection


def test_cycles_are_looked_for_seldom_and_afterwards_as_before():
    usual = gc.get_threshold()
    with infrequent_collection():
        assert gc.isenabled()
        assert gc.get_threshold()[0] > 10 * usual[0]
    assert gc.get_threshold() == usual
