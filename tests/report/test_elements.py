import pytest

from minihuman.reporting.template import format_p_value


@pytest.mark.parametrize(
    ("value", "words"),
    [(0.0009, "< 0.001"), (0.001, "0.001"), (0.0049, "0.005"), (0.5, "0.500"), (1.0, "1.000"), (float("nan"), "n/a")],
)
def test_a_p_value_has_three_decimals_or_is_less_than_one_thousandth(value, words):
    assert format_p_value(value) == words
