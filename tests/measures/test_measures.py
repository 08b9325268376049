"""Measures on episodes small enough to count by hand."""

import dataclasses
import math

import numpy as np
import pytest

from minihuman.dataset.measures import (
    KeyTally,
    mean_and_median,
    measure_paths,
    net_displacement,
    played_ns,
    playing_s,
    response_ms,
    slope_per_episode,
    summarize_key_use,
    turned_rad,
    turns_in_place,
    visible_effect,
)
from minihuman.experiment.machine.events import KeyPressed
from tests.builders import episode, grid_map, made, plan, pursue

SECOND = 1_000_000_000


def round_a_corner(number=0, **changes):
    poses, actions = pursue([(2, 2), (5, 2), (5, 6)], 0.0, stride=1.0, turn_rad=math.pi / 2, reach=0.01)
    return made(plan(number), poses, actions, grid_map((5, 6)), **changes)


def test_a_path_round_a_corner_is_seven_cells_long_five_apart_and_turns_once():
    corner = round_a_corner()
    assert net_displacement(corner) == 5
    assert measure_paths([corner]) == [(7, pytest.approx(5 / 7), 1)]
    turns = turns_in_place(corner)
    assert turns["row"].tolist() == [4]
    assert turns["turned_rad"].tolist() == pytest.approx([math.pi / 2])
    assert turns["steps"].tolist() == [1]


def test_who_never_moves_has_no_efficiency():
    (walk,) = measure_paths([made(plan(), [(1.0, 0.0, 1.0, 0.0)] * 3, [0, 1], None)])
    assert math.isnan(walk.efficiency)


def test_a_path_is_the_same_among_others_as_alone():
    spun = made(plan(), [(5.0, 0.0, 6.0, yaw) for yaw in (math.pi, -math.pi / 2, math.pi)], [0, 1], None)
    corner, unmoved = round_a_corner(), made(plan(), [(1.0, 0.0, 1.0, 0.0)], [], None)
    together = [corner, spun, unmoved, spun, corner]
    assert str(measure_paths(together)) == str([measure_paths([one])[0] for one in together])  # NaN and all
    assert [walk.turns for walk in measure_paths(together)] == [1, 1, 0, 1, 1]
    assert measure_paths([]) == []


def test_turning_through_half_a_circle_counts_the_short_way():
    spun = made(plan(), [(1.0, 0.0, 1.0, yaw) for yaw in (math.pi, -math.pi / 2, math.pi)], [0, 1], None)
    assert turned_rad(spun).tolist() == pytest.approx([math.pi / 2, -math.pi / 2])


def test_bumping_into_a_wall_is_no_turn():
    assert turns_in_place(made(plan(), [(1.0, 0.0, 1.0, 0.0)] * 4, [2, 2, 2], None)).size == 0


def test_pauses_are_no_playing_time():
    played = round_a_corner()
    whole = (played.t_ns[-1] - played.t_ns[0]) / 1e9
    inside = (int(played.t_ns[2]), int(played.t_ns[2]) + SECOND // 2)
    assert playing_s(played) == pytest.approx(whole)
    assert playing_s(dataclasses.replace(played, pauses=(inside,))) == pytest.approx(whole - 0.5)


def test_playing_time_until_a_key_press_counts_only_the_pauses_before_it():
    played = round_a_corner()
    paused = (int(played.t_ns[2]), int(played.t_ns[2]) + SECOND // 4)
    of = dataclasses.replace(played, pauses=(paused,))
    assert played_ns(of, int(played.t_ns[1])) == played_ns(played, int(played.t_ns[1]))
    assert played_ns(of, int(played.t_ns[5])) == played_ns(played, int(played.t_ns[5])) - SECOND // 4


def test_a_key_is_not_found_later_for_a_pause_before_it():
    poses = [(1.0, 0.0, 1.0, 0.0)] * 3 + [(2.0, 0.0, 1.0, 0.0)]
    played = made(plan(0), poses, [2, 2, 2], None)
    paused = dataclasses.replace(played, pauses=((int(played.t_ns[1]), int(played.t_ns[1]) + SECOND // 5),))
    found = [
        {use.key: use.discovered_s for use in summarize_key_use([KeyTally.of(one)])}["1"] for one in (played, paused)
    ]
    assert found[1] == pytest.approx(found[0] - 0.2)


def test_reaction_times_leave_out_steps_without_one():
    played = round_a_corner(rt_ms=[100, 200, math.nan, 600, math.nan, math.nan, math.nan, math.nan])
    assert response_ms(played) is played.rt_ms
    assert mean_and_median(played.rt_ms) == (300, 200)
    assert mean_and_median(np.full(8, math.nan)) == (None, None)


def test_a_key_is_found_at_the_first_press_that_changed_the_picture():
    poses = [(1.0, 0.0, 1.0, 0.0)] * 3 + [(2.0, 0.0, 1.0, 0.0)]
    first = made(plan(0), poses, [2, 2, 2], None)  # two bumps, then a stride
    second = round_a_corner(1, start_ns=int(first.t_ns[-1]) + 5 * SECOND)
    uses = {use.key: use for use in summarize_key_use([KeyTally.of(first), KeyTally.of(second)])}
    forward, right, left = uses["1"], uses["2"], uses["3"]
    assert visible_effect(first).tolist() == [False, False, True]
    assert (forward.action, forward.steps, forward.ineffective_steps, forward.discovered_steps) == ("forward", 10, 2, 3)
    assert forward.discovered_s == pytest.approx((first.key_t_ns[2] - first.t_ns[0]) / 1e9)
    assert right.discovered_steps == 3 + 4
    in_second = second.key_t_ns[3] - second.t_ns[0]
    assert right.discovered_s == pytest.approx((first.t_ns[-1] - first.t_ns[0] + in_second) / 1e9)
    assert (left.steps, left.discovered_s, left.discovered_steps) == (0, None, None)


def test_presses_without_an_action_are_counted_by_key():
    strays = [
        KeyPressed(5, "4", "4", True, None, "spare", "playing"),
        KeyPressed(6, "x", "x", True, None, "unmapped", "playing"),
    ]
    strays += [
        KeyPressed(7, "x", "x", True, None, "repeat", "playing"),
        KeyPressed(8, "x", "x", False, None, "release", "playing"),
    ]
    uses = {use.key: use for use in summarize_key_use([KeyTally.of(round_a_corner(extra_keys=strays))])}
    assert (uses["4"].action, uses["4"].presses, uses["4"].refused) == (None, 1, 1)
    assert (uses["x"].presses, uses["x"].refused) == (1, 1)
    assert (uses["5"].presses, uses["1"].presses, uses["1"].refused) == (0, 7, 0)


def test_a_new_key_map_starts_its_own_discovery():
    other = dataclasses.replace(episode(kind="room"))
    uses = summarize_key_use([KeyTally.of(played) for played in (round_a_corner(0), round_a_corner(1), other)])
    assert [use.first_episode for use in uses if use.key == "2"] == [1, other.number]


def test_adaptation_is_the_slope_of_the_first_episodes():
    assert slope_per_episode([0.1, 0.3, 0.5, 0.7, 0.9, -9, -9]) == pytest.approx(0.2)
    assert slope_per_episode([0.1, math.nan, 0.5]) == pytest.approx(0.2)
    assert math.isnan(slope_per_episode([0.5]))


@pytest.mark.parametrize("values", [[0.0] * 4, [0.1] * 5, [0.7] * 3, [0.3, math.nan, 0.3, math.nan, 0.3]])
def test_equal_values_have_no_slope_at_all(values):
    """Rounding errors of a fit would be a spread between people: a g of 2.1 where nobody learnt anything."""
    assert slope_per_episode(values) == 0.0


def test_a_world_without_poses_has_no_path_but_its_times():
    blind = made(plan(), [(math.nan,) * 4] * 3, [2, 2], None)
    assert math.isnan(measure_paths([blind])[0].length)
    assert np.isfinite(playing_s(blind))
    unplayed = made(plan(), [(math.nan,) * 4], [], "abandoned")
    assert math.isnan(measure_paths([unplayed])[0].length)
