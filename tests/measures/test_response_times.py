"""Reaction times in real time: from a stimulus onset, never from the last tick."""

import dataclasses
import math

import numpy as np
import pytest

from minihuman.dataset.measures import mean_and_median, response_ms
from minihuman.dataset.session_measures import SessionMeasures, skip_path_bounds
from minihuman.dataset.table_catalogue import build_data_dictionary
from minihuman.errors import ProtocolError
from minihuman.experiment.plan.dry_run import describe_plan
from minihuman.log.read.session_reader import read_log
from minihuman.log.record.disk import RecorderSettings
from minihuman.log.record.mcap_recorder import McapRecorder
from tests.builders import STARTED_NS
from tests.study.sessions import MS, Desk, corridor_plan

PERIOD_MS = 100
PLAY = f'pace = "real_time"\nstep_period_ms = {PERIOD_MS}\nnoop_action = "stay"\n'
RESPONSES_MS = (352, 487, 633, 295)


def go_no_go(more):
    """One episode of 60 ticks, and a press some time after the pictures of steps 10, 20, 30 and 40."""
    desk = Desk(corridor_plan(episodes=1, max_steps=60, more=PLAY + more))
    desk.press("enter")
    desk.show()
    due_ns = []
    for step in range(1, 61):
        while due_ns and due_ns[0] < desk.session.next_tick_ns:
            desk.now_ns = due_ns.pop(0) - MS  # a press is one millisecond after the last input
            desk.act("back")
        desk.pass_ms((desk.session.next_tick_ns - desk.now_ns) / MS)
        desk.show()
        if step in (10, 20, 30, 40):
            due_ns.append(desk.now_ns + RESPONSES_MS[step // 10 - 1] * MS)
    return desk


def logged(desk, folder):
    recorder = McapRecorder(folder, desk.plan, started_ns=STARTED_NS, settings=RecorderSettings(sync=lambda fd: None))
    recorder.write(desk.events)
    return read_log(recorder.close())


def test_a_response_counts_from_the_onset_that_the_world_names(tmp_path):
    log = logged(go_no_go("options = { onset_every = 10 }"), tmp_path)
    (episode,) = log.episodes
    times = response_ms(episode)
    assert times[~np.isnan(times)].tolist() == list(RESPONSES_MS)
    assert np.nanmax(episode.rt_ms) <= PERIOD_MS + 2  # the old column: since the last tick
    (row,) = SessionMeasures.of(log, skip_path_bounds).rows
    assert (row["response_mean_ms"], row["response_median_ms"]) == mean_and_median(np.array(RESPONSES_MS, float))
    assert row["reaction_median_ms"] < PERIOD_MS + 2


def test_a_pause_between_onset_and_key_leaves_no_response_time(tmp_path):
    (episode,) = logged(go_no_go("options = { onset_every = 10 }"), tmp_path).episodes
    answered = np.flatnonzero(~np.isnan(response_ms(episode)))
    key_ns = int(episode.key_t_ns[answered[1]])
    paused = dataclasses.replace(episode, pauses=((key_ns - 2 * MS, key_ns - MS),))
    assert np.flatnonzero(~np.isnan(response_ms(paused))).tolist() == [answered[0], *answered[2:]]


def test_a_real_time_block_without_an_onset_has_no_response_time(tmp_path):
    log = logged(go_no_go(""), tmp_path)
    (row,) = SessionMeasures.of(log, skip_path_bounds).rows
    assert np.isnan(response_ms(log.episodes[0])).all()
    assert (row["response_mean_ms"], row["response_median_ms"]) == (None, None)
    assert not math.isnan(row["reaction_median_ms"])
    assert SessionMeasures.of(log, skip_path_bounds).aggregate([0])["response_median_ms"] is None


def test_a_block_may_name_the_first_picture_as_the_onset(tmp_path):
    (episode,) = logged(go_no_go('stimulus_onset = "reset"'), tmp_path).episodes
    (step,) = np.flatnonzero(~np.isnan(response_ms(episode)))  # the first key after it, and no later one
    first_flip_ns = int(episode.frames.column("flip_ns")[0])
    assert response_ms(episode)[step] == (episode.key_t_ns[step] - first_flip_ns) / 1e6


@pytest.mark.parametrize(
    ("more", "onset"),
    [("", "the world's info['onset'], NULL where it names none"), ('stimulus_onset = "reset"', "the first picture")],
)
def test_check_says_what_response_times_count_from(more, onset):
    assert any(line.endswith(f"; response_ms from {onset}") for line in _paces(corridor_plan(more=PLAY + more)))


def _paces(plan):
    return [line.partition("; at most")[0] for line in describe_plan(plan) if line.startswith("  pace")]


def test_an_onset_is_refused_where_keys_make_the_steps():
    with pytest.raises(ProtocolError, match=r"stimulus_onset .* is for 'real_time'"):
        corridor_plan(more='stimulus_onset = "reset"')


def test_the_dictionary_numbers_both_definitions():
    steps = build_data_dictionary()["steps"]
    assert [steps[name]["definition"] for name in ("reaction_ms", "response_ms")] == ["1", "2"]
