import math

import pytest

from minihuman.dataset.measures import excess_steps, log_excess_steps, log_steps_ratio, spl


def test_who_took_the_best_way_has_no_excess_and_full_spl():
    assert excess_steps(20, 20, success=True) == 0
    assert log_excess_steps(20, 20, 250, "goal") == 0
    assert log_steps_ratio(20, 20, 250, "goal") == 0
    assert spl(20, 20, "goal") == 1


def test_who_never_got_there_counts_as_at_the_limit():
    assert excess_steps(250, 20, success=False) is None
    assert log_excess_steps(250, 20, 250, "timeout") == pytest.approx(math.log(231))
    assert log_excess_steps(7, 20, 250, "failure") == log_excess_steps(250, 20, 250, "timeout")
    assert log_steps_ratio(250, 20, 250, "timeout") == pytest.approx(math.log(12.5))
    assert log_steps_ratio(7, 20, 250, "failure") == log_steps_ratio(250, 20, 250, "timeout")
    assert spl(250, 20, "timeout") == 0


def test_as_many_times_the_steps_tell_the_same_on_a_short_way_as_on_a_long_one():
    assert log_steps_ratio(14, 10, 250, "goal") == pytest.approx(log_steps_ratio(140, 100, 250, "goal"))
    assert log_steps_ratio(70, 50, 250, "goal") - log_steps_ratio(100, 50, 250, "goal") == pytest.approx(math.log(0.7))


@pytest.mark.parametrize("outcome", ["abandoned", "cut_off"])
def test_what_was_broken_off_tells_nothing(outcome):
    assert log_excess_steps(7, 20, 250, outcome) is None
    assert log_steps_ratio(7, 20, 250, outcome) is None
    assert spl(7, 20, outcome) is None


def test_without_a_known_way_nothing_is_told():
    assert log_steps_ratio(7, None, 9, "goal") is None
    assert log_steps_ratio(7, 0, 9, "goal") is None  # who begins at the goal has no way to take
    assert excess_steps(7, None, success=True) is log_excess_steps(7, None, 9, "goal") is spl(7, None, "goal") is None
