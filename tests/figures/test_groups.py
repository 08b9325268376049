"""Occupancy and learning curves: what they count."""

import math

import numpy as np
import pandas as pd
import pytest
import scipy
from matplotlib.figure import Figure

from minihuman.figures.figure_data import collect_learning_curves
from minihuman.figures.learning_curves import draw_learning, mean_and_band, share_and_band
from minihuman.figures.occupancy import compute_occupancy, draw_occupancy, group_by_participant, occupancy_figure
from minihuman.figures.survival_curves import survival_figure
from minihuman.statistics.scores import wilson_interval
from minihuman.statistics.survival import SurvivalTimes
from tests.builders import episode, grid_map, made, plan, session, session_of


def standing(place: tuple[float, float], steps: int):
    return made(plan(), [(place[0], 0.0, place[1], 0.0)] * (steps + 1), [0] * steps, grid_map((2, 2)))


def test_every_participant_weighs_the_same_however_long_they_took():
    share, x_edges, z_edges = compute_occupancy([[standing((3, 4), 1)], [standing((10, 12), 99)]])
    assert share[3, 4] == pytest.approx(0.5)
    assert share[10, 12] == pytest.approx(0.5)
    assert share.shape == (len(x_edges) - 1, len(z_edges) - 1) == (19, 19)


def test_a_participant_of_two_days_weighs_as_much_as_one_of_one_day():
    first = session_of([standing((3, 4), 1)])
    second = session_of([standing((5, 6), 1)])
    other = session_of([standing((10, 12), 9)], participant="sub-02")
    participants = group_by_participant([first, second, other], plan().world)
    share, _, _ = compute_occupancy(participants)
    assert (share[3, 4], share[5, 6], share[10, 12]) == pytest.approx((0.25, 0.25, 0.5))
    assert occupancy_figure("w", {"a": participants}).axes[0].get_title(loc="left") == "w, 2 participants"


def test_metres_are_counted_in_half_metre_squares():
    share, x_edges, _ = compute_occupancy([[episode(kind="room")]])
    assert np.diff(x_edges) == pytest.approx(0.5)
    assert share.sum() == pytest.approx(1)


def test_cells_and_metres_do_not_mix():
    with pytest.raises(ValueError, match="one unit"):
        compute_occupancy([[episode(), episode(kind="room")]])


def test_a_place_nobody_went_stays_white_and_every_wall_is_drawn():
    ax = draw_occupancy(Figure().subplots(), [[standing((3, 4), 5)]])
    mesh, walls = ax.collections
    assert mesh.get_array().count() == 1
    assert len(walls.get_segments()) == len(grid_map((2, 2)).walls)


def test_the_band_is_students_interval_of_the_mean():
    values = np.array([[0.2, 0.4], [0.5, 0.9], [0.9, 0.7]])
    mean, low, high = mean_and_band(values)
    for i in range(2):
        expected = scipy.stats.t.interval(0.95, 2, values[:, i].mean(), scipy.stats.sem(values[:, i]))
        assert (low[i], high[i]) == pytest.approx(expected)
    assert mean == pytest.approx(values.mean(axis=0))


def test_one_participant_has_a_line_but_no_band():
    mean, low, high = mean_and_band(np.array([[0.3, math.nan]]))
    assert mean[0] == 0.3
    assert np.isnan([mean[1], *low, *high]).all()


def test_each_group_has_its_line_its_band_and_its_size_in_the_legend():
    rng = np.random.default_rng(0)
    curves = {"grid_first": rng.random((4, 5)), "direct": rng.random((3, 5))}
    ax = draw_learning(Figure().subplots(), curves, measure="reward", limits=(0, 1))
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["grid_first (n = 4)", "direct (n = 3)"]
    means = [line for line in ax.lines if line.get_gid() not in ("participant: grid_first", "participant: direct")]
    assert [line.get_linestyle() for line in means] == ["-", "--"]
    assert len(ax.lines) - len(means) == 4 + 3  # participants, so few that each has a line
    assert [band.get_gid() for band in ax.collections] == ["band: grid_first", "band: direct"]
    heights = np.concatenate([band.get_paths()[0].vertices[:, 1] for band in ax.collections])
    assert heights.min() >= 0
    assert heights.max() <= 1


def test_a_band_never_leaves_what_the_measure_can_be_but_blocks_no_value():
    ax = draw_learning(Figure().subplots(), {"all": session_rewards()}, measure="reward")
    assert list(ax.lines[-1].get_ydata()) == pytest.approx(session_rewards().mean(axis=0))


def test_a_share_of_everybody_has_an_interval_too():
    values = np.array([[1.0, 0.0, math.nan], [1.0, 1.0, math.nan]])
    share, low, high = share_and_band(values)
    assert list(share[:2]) == [1.0, 0.5]
    assert (low[0], high[0]) == wilson_interval(2, 2)
    assert np.isnan([share[2], low[2], high[2]]).all()
    ax = draw_learning(Figure().subplots(), {"all": values[:, :2]}, measure="success", limits=(0, 1))
    assert ax.collections[0].get_paths()[0].vertices[:, 1].min() == pytest.approx(wilson_interval(1, 2)[0])


def test_a_measure_that_goes_beyond_1_is_no_share_where_everybody_is_perfect():
    perfect = {"all": np.zeros((10, 2))}
    for limits, highest in (((0, math.inf), 0.0), ((0, 1), wilson_interval(0, 10)[1])):
        ax = draw_learning(
            Figure().subplots(), perfect, measure="log of the excess steps over the shortest path", limits=limits
        )
        (band,) = ax.collections
        assert band.get_paths()[0].vertices[:, 1].max() == pytest.approx(highest)


def test_how_many_wait_is_told_below_the_axis_numbers_that_it_is_of():
    waited = SurvivalTimes(np.array([30.0, 120.0, 250.0]), np.array([True, True, False]))
    axes, below = survival_figure({"a": waited}, label="steps", counted="without the goal").axes
    assert "without the goal, a:" in [text.get_text() for text in below.texts]
    told = {float(text.get_position()[0]): text.get_text() for text in below.texts if text.get_text().isdigit()}
    assert set(told) == {float(tick) for tick in axes.get_xticks() if 0 <= tick <= 250}
    assert told[0.0] == "3"
    assert told[100.0] == "2"


def session_rewards():
    return np.array([[played.return_ for played in session(seed=seed, episodes=3).episodes] for seed in range(3)])


def test_a_participant_of_two_sessions_has_a_curve_in_each_and_an_episode_nobody_finished_leaves_a_gap():
    columns = ["participant", "session", "group", "episode_in_block", "reward"]
    rows = [
        ("sub-01", 1, "a", 1, 0.2),
        ("sub-01", 2, "a", 1, 0.4),
        ("sub-01", 1, "a", 3, 0.9),
        ("sub-02", 1, "b", 2, 1.0),
    ]
    curves = collect_learning_curves(pd.DataFrame(rows, columns=columns))
    assert {name: curve.shape for name, curve in curves.items()} == dict.fromkeys(
        ("a, session 1", "a, session 2", "b, session 1"), (1, 3)
    )
    assert curves["a, session 1"][0] == pytest.approx([0.2, np.nan, 0.9], nan_ok=True)
    assert curves["a, session 2"][0] == pytest.approx([0.4, np.nan, np.nan], nan_ok=True)
    assert curves["b, session 1"][0] == pytest.approx([np.nan, 1.0, np.nan], nan_ok=True)


def test_groups_are_beside_each_other_on_one_scale_the_darker_the_more():
    groups = {"a": [[standing((3, 4), 5)]], "b": [[standing((3, 4), 1), standing((10, 12), 99)]]}
    *panels, bar = occupancy_figure("w", groups).axes
    assert [ax.get_title(loc="left") for ax in panels] == ["a, 1 participant", "b, 1 participant"]
    assert len({(ax.collections[0].norm.vmin, ax.collections[0].norm.vmax) for ax in panels}) == 1
    least, most = (sum(panels[1].collections[0].cmap(place)[:3]) for place in (0.0, 1.0))
    assert most < least < 3
    assert bar.get_ylabel().startswith("share of steps")


def test_a_few_participants_have_a_line_each_and_many_have_none():
    for count, lines in ((5, 5), (40, 0)):
        values = np.random.default_rng(1).random((count, 6))
        ax = draw_learning(Figure().subplots(), {"a": values}, measure="reward")
        assert sum(line.get_gid() == "participant: a" for line in ax.lines) == lines
