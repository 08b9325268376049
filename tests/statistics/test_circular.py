"""Angles: their mean direction and how alike they are."""

import math

import pytest

from minihuman.statistics.circular import find_mean_direction_deg, find_resultant_length


@pytest.mark.parametrize(
    ("angles_deg", "mean_deg", "length"),
    [([359, 1], 0.0, math.cos(math.radians(1))), ([90], 90.0, 1.0), ([170, -170], 180.0, math.cos(math.radians(10)))],
)
def test_angles_about_a_direction_have_it_as_their_mean(angles_deg, mean_deg, length):
    assert abs(find_mean_direction_deg(angles_deg)) == pytest.approx(abs(mean_deg), abs=1e-9)
    assert find_resultant_length(angles_deg) == pytest.approx(length)


def test_opposite_angles_have_no_direction_and_no_angles_have_no_value():
    assert math.isnan(find_mean_direction_deg([0, 180]))
    assert find_resultant_length([0, 180]) == pytest.approx(0, abs=1e-12)
    assert math.isnan(find_mean_direction_deg([]))
    assert math.isnan(find_resultant_length([]))
