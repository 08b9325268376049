"""What a reader sees in the session overview."""

import dataclasses

import pytest
from matplotlib.figure import Figure

from minihuman.errors import LogError
from minihuman.experiment.machine.events import KeyPressed
from minihuman.figures.overview import draw_different_keys, draw_keys, draw_steps, draw_time, overview_figure
from minihuman.log.model.event_columns import EventColumns
from tests.builders import session, session_of


def heights(ax):
    return [bar.get_height() for bar in ax.patches]


def test_each_episode_shows_its_steps_and_its_outcome_in_shape():
    log = session(episodes=3)
    ax = draw_steps(Figure().subplots(), log)
    tops = [line.get_ydata()[0] for line in ax.lines if line.get_marker() != "None" and len(line.get_ydata()) == 1]
    assert tops == [len(episode.actions) for episode in log.episodes]
    assert {text.get_text() for text in ax.get_legend().get_texts()} == {"goal", "timeout", "step limit"}


def test_time_is_in_seconds():
    log = session(episodes=2)
    expected = [(episode.t_ns[-1] - episode.t_ns[0]) / 1e9 for episode in log.episodes]
    assert heights(draw_time(Figure().subplots(), log)) == expected


def test_presses_without_an_action_stand_apart():
    log = session(episodes=1)
    first = log.episodes[0]
    stray = tuple(KeyPressed(first.t_ns[0] + i, "9", "9", True, None, "unmapped", "playing") for i in range(3))
    log = session_of(
        [dataclasses.replace(first, keys=EventColumns.of(KeyPressed, [*stray, *first.keys])), *log.episodes[1:]]
    )
    ax = draw_keys(Figure().subplots(), log)
    assert heights(ax)[:4] == [len(log.episodes[0].actions), len(log.episodes[1].actions), 3, 0]
    assert heights(draw_different_keys(Figure().subplots(), log))[0] == len({key.key for key in first.keys}) + 1


def test_the_overview_names_participant_group_and_study_and_numbers_the_episodes_from_one():
    figure = overview_figure(session(episodes=3))
    assert figure.get_suptitle() == "sub-01 (grid_first), transfer"
    assert list(figure.axes[-1].get_xticks()) == [1, 2, 3, 4, 5, 6]


def test_the_overview_names_the_blocks_and_numbers_a_long_session_sparsely():
    figure = overview_figure(session(episodes=10))
    assert [text.get_text() for text in figure.axes[0].texts] == ["grid", "room"]
    labels = [tick for tick in figure.axes[-1].get_xticks() if 1 <= tick <= 20]
    assert 4 <= len(labels) <= 12
    assert all(tick == int(tick) for tick in labels)


def test_a_log_that_was_cut_off_says_so():
    assert overview_figure(session_of(session(episodes=1).episodes, clean=False)).get_suptitle().endswith("cut off")


def test_a_session_without_episodes_has_no_overview_and_says_so():
    with pytest.raises(LogError, match="has no included episode to draw"):
        overview_figure(session_of([]))
