"""Onsets in made-up recordings: clicks and edges, noise, missing ones, constant delays and clocks that drift apart."""

import numpy as np
import pytest
from numpy.typing import NDArray

from minihuman.runtime.onset_analysis import compute_share_within, find_onsets, measure_delays_s, summarise_delays
from tests.made_recordings import RATE_HZ, add_clicks, add_edges, draw_times_s

CLICK_RISE_S = 0.002
EDGE_RISE_S = 0.015
TIMES_S = draw_times_s(40, (0.2, 0.3))


def find_s(samples: NDArray[np.float32], rise_s: float, count: int = 40) -> NDArray[np.float64]:
    return find_onsets(samples, RATE_HZ, count=count, rise_s=rise_s) / RATE_HZ


@pytest.mark.parametrize("noise", [0.0, 0.001, 0.02])
def test_clicks_are_found_in_noise_to_a_tenth_of_a_millisecond(noise: float) -> None:
    onsets_s = find_s(add_clicks(TIMES_S, noise=noise), CLICK_RISE_S)
    assert len(onsets_s) == 40
    assert np.abs(onsets_s - TIMES_S).max() < 0.0001


@pytest.mark.parametrize("level", [0.004, 0.9])
def test_a_quiet_line_and_one_that_is_clipped_give_the_same_onsets(level: float) -> None:
    samples = (2 * add_clicks(TIMES_S, level=level, noise=level / 100)).clip(-1, 1)
    assert np.abs(find_s(samples, CLICK_RISE_S) - TIMES_S).max() < 0.0001


@pytest.mark.parametrize("fade_s", [0.008, 0.02, 0.16])
def test_an_edge_behind_an_ac_coupled_input_is_found_in_both_directions(fade_s: float) -> None:
    onsets_s = find_s(add_edges(TIMES_S, fade_s=fade_s, noise=0.005), EDGE_RISE_S)
    assert len(onsets_s) == 40
    assert np.abs(onsets_s - TIMES_S).max() < 0.0003


def test_the_onset_of_a_slow_edge_is_where_half_of_it_is_reached() -> None:
    onsets_s = find_s(add_edges(TIMES_S, fade_s=10.0, rise_s=0.008, noise=0.002), EDGE_RISE_S)
    assert len(onsets_s) == 40
    assert np.median(onsets_s - TIMES_S) == pytest.approx(0.004, abs=0.0005)
    assert np.std(onsets_s - TIMES_S) < 0.0002


def test_hum_of_the_mains_hides_no_edge() -> None:
    samples = add_edges(TIMES_S, fade_s=0.02, level=0.5)
    hum = 0.03 * np.sin(2 * np.pi * 50 * np.arange(len(samples)) / RATE_HZ)
    onsets_s = find_s((samples + hum).astype(np.float32), EDGE_RISE_S)
    assert len(onsets_s) == 40
    assert np.abs(onsets_s - TIMES_S).max() < 0.001


@pytest.mark.parametrize("level", [0.0, 0.0004])
def test_an_input_without_a_signal_has_no_onsets(level: float) -> None:
    assert len(find_s(add_clicks(TIMES_S, level=level), CLICK_RISE_S)) == 0


def test_faint_sounds_between_clicks_are_no_onsets() -> None:
    """As of crosstalk, or of an echo."""
    samples = add_clicks(TIMES_S) + add_clicks(TIMES_S + 0.12, level=0.03)[: len(add_clicks(TIMES_S))]
    assert np.abs(find_s(samples, CLICK_RISE_S) - TIMES_S).max() < 0.0001


def test_noise_alone_has_hardly_an_onset() -> None:
    assert len(find_s(add_clicks(TIMES_S, level=0.0, noise=0.05), CLICK_RISE_S)) <= 1


def test_a_recording_that_is_too_short_has_no_onsets() -> None:
    assert len(find_s(np.ones(10, np.float32), CLICK_RISE_S)) == 0


def delays_s(recorded_s: NDArray[np.float64], tolerance_s: float = 0.09) -> NDArray[np.float64]:
    return measure_delays_s(TIMES_S, recorded_s, tolerance_s=tolerance_s)


@pytest.mark.parametrize("delay_s", [-0.003, 0.0, 0.08, 0.25, 0.7])
def test_a_constant_delay_is_the_median_with_jitter_as_its_sd(delay_s: float) -> None:
    """0.25 s is one interval: only that these are irregular tells it from no delay at all."""
    jitter_s = np.random.default_rng(3).normal(0, 0.001, 40)
    summary = summarise_delays(delays_s(TIMES_S + delay_s + jitter_s))
    assert (summary.stated, summary.recorded) == (40, 40)
    assert summary.median_ms == pytest.approx(1000 * (delay_s + np.median(jitter_s)))
    assert summary.sd_ms == pytest.approx(1000 * jitter_s.std(ddof=1))
    assert summary.largest_ms == pytest.approx(1000 * np.abs(jitter_s - np.median(jitter_s)).max())


def test_a_missing_click_is_no_number_and_moves_no_other() -> None:
    recorded = delays_s(np.delete(TIMES_S, [0, 17]) + 0.08)
    assert np.flatnonzero(np.isnan(recorded)).tolist() == [0, 17]
    assert np.allclose(np.delete(recorded, [0, 17]), 0.08)
    assert summarise_delays(recorded).recorded == 38


def test_other_sounds_are_not_taken_for_clicks() -> None:
    others_s = TIMES_S[::4] + 0.08 + 0.06
    recorded = delays_s(np.sort(np.concatenate([TIMES_S + 0.08, others_s])))
    assert np.allclose(recorded, 0.08)


def test_a_recorded_onset_belongs_to_one_stated_onset() -> None:
    twice_s = np.sort(np.concatenate([TIMES_S, [TIMES_S[5] + 0.03]]))
    recorded = measure_delays_s(twice_s, TIMES_S + 0.08, tolerance_s=0.09)
    assert np.flatnonzero(np.isnan(recorded)).tolist() == [6]


def test_a_click_far_from_its_time_did_not_come_back() -> None:
    moved_s = TIMES_S + 0.08
    moved_s[3] += 0.095
    assert np.flatnonzero(np.isnan(delays_s(moved_s))).tolist() == [3]


def test_clocks_that_drift_apart_are_seen_in_the_spread() -> None:
    summary = summarise_delays(delays_s(TIMES_S * 1.0005 + 0.08))
    assert summary.recorded == 40
    assert summary.largest_ms == pytest.approx(0.5 * (TIMES_S[-1] - TIMES_S[0]) / 2, rel=0.1)


def test_two_different_delays_are_both_matched() -> None:
    """As of a display that becomes light faster than dark."""
    delay_s = np.where(np.arange(40) % 2, 0.045, 0.01)
    assert np.allclose(delays_s(TIMES_S + delay_s), delay_s)


def test_nothing_recorded_has_no_median() -> None:
    summary = summarise_delays(delays_s(np.empty(0)))
    assert (summary.stated, summary.recorded) == (40, 0)
    assert np.isnan([summary.median_ms, summary.sd_ms, summary.largest_ms]).all()


def test_sounds_long_after_the_last_click_match_nothing() -> None:
    assert np.isnan(delays_s(TIMES_S[-1] + np.array([2.0, 3.0]))).all()


def test_the_share_within_the_uncertainty_is_of_the_clicks_that_came_back() -> None:
    recorded = np.array([0.0800, 0.0805, 0.0790, np.nan, 0.0800, 0.0830])
    assert compute_share_within(recorded, np.full(6, 0.0015)) == pytest.approx(0.8)
    assert compute_share_within(recorded, np.full(6, 0.0002)) == pytest.approx(0.4)


def test_of_two_sounds_near_a_click_the_one_with_the_constant_delay_is_its_own() -> None:
    stated_s = draw_times_s(10, (0.2, 0.3))
    recorded_s = np.sort(np.concatenate([stated_s + 0.08, [stated_s[4] + 0.05]]))  # and a knock before the fifth
    assert measure_delays_s(stated_s, recorded_s, tolerance_s=0.09) == pytest.approx(0.08)
