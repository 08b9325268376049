"""What a reader sees in the path figure."""

import dataclasses
import math
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from minihuman.errors import LogError
from minihuman.figures.occupancy import compute_occupancy, occupancy_figure
from minihuman.figures.path_figures import draw_path, episode_panel, find_goal, paths_figure, session_paths
from tests.builders import episode, grid_map, made, plan, pursue, session


@pytest.fixture
def ax() -> Axes:
    return Figure().subplots()


def by_gid(ax: Axes, gid: str):
    return [artist for artist in ax.get_children() if artist.get_gid() == gid]


def walk_round_a_corner():
    poses, actions = pursue([(2, 2), (5, 2), (5, 4)], 0.0, stride=1.0, turn_rad=math.pi / 2, reach=0.01)
    return made(plan(4), poses, actions, grid_map((5, 4)))


def test_every_move_is_a_piece_of_the_line_and_colour_runs_from_start_to_end(ax):
    draw_path(ax, walk_round_a_corner())
    (line,) = by_gid(ax, "path")
    pieces = np.array(line.get_segments())
    assert np.allclose(pieces[:, 1], [(3, 2), (4, 2), (5, 2), (5, 3), (5, 4)])
    times = line.get_array()
    assert (np.diff(times) > 0).all()
    assert times[-1] == 1.0


def test_a_quarter_turn_on_the_spot_shows_as_a_ring_where_it_happened(ax):
    draw_path(ax, walk_round_a_corner())
    (rings,) = by_gid(ax, "turns in place")
    assert np.allclose(rings.get_offsets(), [(5, 2)])


def test_turning_twice_as_far_draws_a_larger_ring(ax):
    spots = [(2.0, 0.0, 2.0, 0.0), (2.0, 0.0, 2.0, -math.pi / 2), (2.0, 0.0, 3.0, -math.pi / 2)]
    spots += [(2.0, 0.0, 3.0, 0.0), (2.0, 0.0, 3.0, math.pi / 2), (2.0, 0.0, 2.0, math.pi / 2)]
    draw_path(ax, made(plan(), spots, [1, 2, 0, 0, 2], grid_map((2, 2))))
    (rings,) = by_gid(ax, "turns in place")
    assert len(rings.get_sizes()) == 2
    assert rings.get_sizes()[1] > rings.get_sizes()[0]


def test_start_end_and_goal_are_marked_where_they_are(ax):
    episode_panel(ax, walk_round_a_corner())
    for gid, place in (("start", (2, 2)), ("end", (5, 4)), ("goal", (5, 4))):
        (mark,) = by_gid(ax, gid)
        assert (mark.get_xdata()[0], mark.get_ydata()[0]) == pytest.approx(place)


def test_a_way_there_and_back_in_the_grid_shows_as_two_lines(ax):
    poses, actions = pursue([(2, 2), (6, 2), (2, 2)], 0.0, stride=1.0, turn_rad=math.pi / 2, reach=0.01)
    draw_path(ax, made(plan(), poses, actions, grid_map((2, 2))))
    (line,) = by_gid(ax, "path")
    there, back = np.array(line.get_segments())[1], np.array(line.get_segments())[-2]
    assert np.abs(there - back[::-1]).max() > 0.05


def test_z_grows_down_the_page_as_rows_do(ax):
    episode_panel(ax, walk_round_a_corner())
    bottom, top = ax.get_ylim()
    assert bottom > top


def test_the_panel_says_number_steps_and_an_outcome_that_is_not_the_goal(ax):
    episode_panel(ax, dataclasses.replace(walk_round_a_corner(), outcome="timeout"))
    assert ax.get_title("left") == "5"
    assert ax.get_title("right") == "timeout (6)"


def test_an_episode_the_log_broke_off_in_says_cut_off(ax):
    episode_panel(ax, dataclasses.replace(walk_round_a_corner(), outcome=None))
    assert ax.get_title("right") == "cut_off (6)"


def test_a_world_that_tells_no_pose_gets_a_panel_that_says_so(ax):
    blind = made(plan(), [(math.nan,) * 4] * 3, [2, 2], None)
    episode_panel(ax, blind)
    assert "no map or pose" in ax.texts[0].get_text()
    assert not by_gid(ax, "path")


def test_ten_numbered_episodes_of_both_worlds_stand_side_by_side():
    figure = paths_figure([(kind, session(blocks=(kind,), episodes=10).episodes) for kind in ("grid", "room")])
    numbers = [ax.get_title("left") for ax in figure.axes if ax.get_title("left")]
    assert numbers == [str(number) for number in range(1, 11)] * 2
    assert [len(by_gid(ax, "path")) for ax in figure.axes if ax.get_title("left")] == [1] * 20


def test_text_stays_readable_at_column_width():
    figure = paths_figure([("grid", session(blocks=("grid",), episodes=4).episodes)])
    assert figure.get_figwidth() * 2.54 == pytest.approx(8.5)
    sizes = [text.get_fontsize() for ax in figure.axes for text in ax.findobj(lambda a: hasattr(a, "get_fontsize"))]
    assert min(sizes) >= 6


def test_the_goal_is_the_thing_the_mission_names_where_none_is_called_goal():
    room = episode(kind="room")
    assert find_goal(room) == (room.start.map.things[0].x, room.start.map.things[0].z)


def test_where_the_mission_names_several_things_no_goal_is_drawn_or_in_the_legend():
    room = episode(kind="room")
    (box,) = room.start.map.things
    two_things = replace(room.start.map, things=(box, replace(box, name="blue ball", x=box.x + 1)))
    start = replace(room.start, mission=f"put the {box.name} near the blue ball", map=two_things)
    several = replace(room, start=start)
    assert find_goal(several) is None
    for played, is_named in ((room, True), (several, False)):
        legends = [legend for part in paths_figure([("room", [played])]).subfigs for legend in part.legends]
        labels = [text.get_text() for legend in legends for text in legend.get_texts()]
        assert ("goal" in labels) is is_named


@pytest.mark.parametrize("bounds", [(5.0, 0.0, 1.0, 9.0), (0.0, float("nan"), 9.0, 9.0), (0.0, 0.0, float("inf"), 9.0)])
def test_a_map_whose_bounds_were_changed_is_refused_in_one_sentence(bounds):
    log = session(episodes=2, blocks=("grid",))
    changed = tuple(
        replace(episode, start=replace(episode.start, map=replace(episode.start.map, bounds=bounds)))
        for episode in log.episodes
    )
    for draw in (
        lambda: session_paths(replace(log, episodes=changed)),
        lambda: occupancy_figure("world", {"a": [list(changed)]}),
    ):
        with pytest.raises(LogError, match=r"a map's bounds are x .*minihuman verify") as refused:
            draw()
        assert "\n" not in str(refused.value)


def test_bounds_that_do_not_hold_the_path_keep_every_step_and_those_without_end_are_refused():
    log = session(episodes=2, blocks=("grid",))

    def moved(*bounds):
        return [
            replace(episode, start=replace(episode.start, map=replace(episode.start.map, bounds=bounds)))
            for episode in log.episodes
        ]

    share, _, _ = compute_occupancy([moved(100.0, 100.0, 101.0, 101.0)])
    assert share.sum() == pytest.approx(1)
    with pytest.raises(LogError, match="too much to draw"):
        compute_occupancy([moved(0.0, 0.0, 1e9, 1e9)])
