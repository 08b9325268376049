"""Estimation plots, distributions and bands show the numbers that they are given."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from minihuman.figures.estimation import (
    Difference,
    compare_every_pair,
    draw_differences,
    draw_participants,
    estimation_figure,
    reaction_time_figure,
    spread_dots,
)
from minihuman.figures.learning_curves import mean_and_band
from minihuman.figures.style import save_figure
from minihuman.figures.survival_curves import draw_survival, survival_band
from minihuman.statistics.permutation import permutation_tests
from minihuman.statistics.survival import SurvivalTimes, kaplan_meier


def groups(*counts):
    rng = np.random.default_rng(3)
    return {f"group {place}": rng.normal(place, 1, count) for place, count in enumerate(counts)}


def by_gid(ax):
    return {line.get_gid(): line for line in ax.lines if line.get_gid()}


@pytest.mark.parametrize("count", [3, 30, 300])
def test_every_participant_is_a_dot_at_its_value_beside_the_mean_and_its_interval(count):
    given = groups(count, count + 1)
    lines = by_gid(draw_participants(Figure().subplots(), given, measure="steps"))
    for name, values in given.items():
        assert sorted(lines[f"participants: {name}"].get_ydata()) == pytest.approx(sorted(values))
        (mean,), (low,), (high,) = mean_and_band(values[:, None])
        assert lines[f"mean: {name}"].get_ydata() == pytest.approx([mean])
        assert lines[f"interval: {name}"].get_ydata() == pytest.approx([low, high])


def test_a_participant_without_a_value_is_no_dot_and_one_alone_has_no_interval():
    lines = by_gid(
        draw_participants(Figure().subplots(), {"a": np.array([1.0, np.nan]), "b": np.array([])}, measure="m")
    )
    assert list(lines["participants: a"].get_ydata()) == [1.0]
    assert "interval: a" not in lines
    assert "mean: b" not in lines


def test_equal_dots_lie_beside_each_other():
    offsets = spread_dots(np.array([1.0, 2.0, 2.0, 2.0]))
    assert len({*offsets[1:]}) == 3
    assert offsets[1:].sum() == pytest.approx(0)
    assert np.abs(spread_dots(np.full(300, 7.0))).max() <= 0.37


def test_differences_are_those_of_the_comparison():
    given = groups(12, 14, 9)
    found = compare_every_pair(given)
    assert [(one.first, one.second) for one in found] == [
        ("group 0", "group 1"),
        ("group 0", "group 2"),
        ("group 1", "group 2"),
    ]
    (expected,) = permutation_tests([(given["group 0"], given["group 1"])])
    assert found[0].interval == pytest.approx(expected.interval())
    assert compare_every_pair({**given, "empty": np.array([])}) == found
    lines = by_gid(draw_differences(Figure().subplots(), found))
    for one in found:
        assert lines[f"difference: {one.first}, {one.second}"].get_xdata() == pytest.approx([one.estimate])
        assert lines[f"interval: {one.first}, {one.second}"].get_xdata() == pytest.approx(one.interval)


def test_panels_have_letters_and_say_block_and_measure_and_a_pdf_has_text(tmp_path):
    found = [Difference("group 0", "group 1", -1.0, (-2.0, 0.1))]
    figure = estimation_figure(groups(4, 5), found, measure="steps", title="Block grid: steps")
    assert figure.get_suptitle() == "Block grid: steps"
    assert [ax.texts[-1].get_text() for ax in figure.axes] == ["A", "B"]
    _, pdf = save_figure(figure, tmp_path / "estimation")
    assert b"/FontFile2" in pdf.read_bytes()


def test_differences_of_logarithms_are_told_as_ratios():
    found = [Difference("group 0", "group 1", np.log(0.5), (np.log(0.25), 0.0))]
    figure = estimation_figure(groups(4, 5), found, measure="ms", are_ratios=True)
    compared = figure.axes[1]
    assert (compared.get_xlabel(), compared.get_title("left")) == ("ratio of geometric means", "ratio")
    assert [label.get_text() for label in compared.get_yticklabels()] == ["group 0\n/ group 1"]
    assert compared.xaxis.get_major_formatter()(np.log(0.5), 0) == "\N{MULTIPLICATION SIGN}0.5"


def test_reaction_times_have_a_line_per_participant_and_their_mean():
    shares = np.array([[0.5, 0.5, 0.0], [0.1, 0.2, 0.7]])
    (ax,) = reaction_time_figure({"a": shares}, np.array([100.0, 200.0, 400.0, 800.0]), title="t").axes
    *each, mean = [line.get_ydata() for line in ax.lines]
    assert np.array(each) == pytest.approx(100 * shares)
    assert mean == pytest.approx(100 * shares.mean(axis=0))


def test_reaction_times_of_many_have_a_band_in_the_place_of_their_lines():
    shares = np.repeat(np.linspace(0, 1, 21)[:, None], 3, axis=1)
    (ax,) = reaction_time_figure({"a": shares}, np.array([100.0, 200.0, 400.0, 800.0]), title="t").axes
    assert len(ax.lines) == 1
    heights = ax.collections[0].get_paths()[0].vertices[:, 1]
    assert (heights.min(), heights.max()) == pytest.approx((10, 90))


def test_an_interval_is_cut_at_what_the_measure_cannot_leave():
    lines = by_gid(
        draw_participants(Figure().subplots(), {"a": np.array([0.7, 0.8, 0.9, 1.0])}, measure="m", limits=(0.0, 1.0))
    )
    low, high = lines["interval: a"].get_ydata()
    assert 0 < low < 0.8 < high == 1.0


def test_the_band_of_a_waiting_curve_is_greenwoods_on_the_log_log_scale():
    waited = SurvivalTimes(np.arange(1.0, 11.0), np.ones(10, bool))
    low, high = survival_band(kaplan_meier(waited))
    # R's survfit(Surv(1:10) ~ 1, conf.type = "log-log") at the first and fifth event
    assert (low[0], high[0]) == pytest.approx((0.4730, 0.9853), abs=1e-4)
    assert (low[4], high[4]) == pytest.approx((0.1836, 0.7532), abs=1e-4)
    bands = [draw_survival(Figure().subplots(), {"a": waited}, label="s", independent=one) for one in (True, False)]
    assert [len(ax.collections) for ax in bands] == [1, 0]
