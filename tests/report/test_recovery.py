"""Studies made with known parameters: what the report estimates is what was put in, as often as it says."""

import math

import numpy as np
import pandas as pd
import pytest
import scipy

from minihuman.dataset.selection import Selection
from minihuman.dataset.session_measures import SessionMeasures, skip_path_bounds
from minihuman.dataset.session_tables import build_session_tables
from minihuman.dataset.sessions import StudySessions
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.reporting.results import compute_results
from minihuman.runtime.simulated_session import simulate
from minihuman.statistics.permutation import permutation_tests
from tests.builders import made, plan, session_of
from tests.counts import count

EFFECT, OWN_SD, NOISE_SD = 0.10, 0.08, 0.05  # of reward: between groups, between people, between episodes
REACTION_MS, REACTION_FACTOR = 400.0, 0.30
PEOPLE, EPISODES, STEPS = 16, 4, 12
KEYS = 3  # with an action, pressed at random: each is found after a geometric number of steps of chance 1 / 3


def person(rng, index):
    """One participant's session: rewards, reaction times and key presses drawn with the known parameters."""
    own = 0.6 + EFFECT * (index % 2) + rng.normal(0, OWN_SD)
    played = []
    for number in range(EPISODES):
        actions = rng.integers(0, KEYS, STEPS)
        poses = [(float(step), 0.0, 0.0, 0.0) for step in range(STEPS + 1)]  # every press shows
        rt_ms = REACTION_MS * np.exp(rng.normal(0, REACTION_FACTOR, STEPS))
        reward = own + rng.normal(0, NOISE_SD)
        its_plan = plan(number, in_block=number, of=EPISODES)
        start_ns = 60_000_000_000 * number
        played.append(made(its_plan, poses, actions, None, rt_ms=rt_ms, reward=reward, start_ns=start_ns))
    group = ("control", "trained")[index % 2]
    return session_of(played, participant=f"sub-{index:02}", index=index, group=group)


def tabled(log):
    measured = SessionMeasures.of(log, skip_path_bounds)
    return build_session_tables(Selection().judge(log, measured=measured, marks=()), measured)


def estimates(seed):
    """One study through the tables to its results: comparisons, model, reaction time interval, found steps."""
    rng = np.random.default_rng([2026, seed])
    people = [person(rng, index) for index in range(PEOPLE)]
    rows = [tabled(one) for one in people]
    tables = {name: pd.concat([one[name].to_pandas() for one in rows]) for name in rows[0]}
    found = compute_results(tables["episodes"], tables["blocks"], tables["participants"])
    target = found.target_block
    assert target is not None
    compared = {one.measure: one for one in target.comparisons}
    medians = tables["participants"]["reaction_median_ms"]
    interval = scipy.stats.t.interval(0.95, PEOPLE - 1, medians.mean(), scipy.stats.sem(medians))
    keys = tables["keys"]
    return compared, target.growth, interval, keys.loc[keys["action"].notna(), "discovered_steps"].to_numpy(float)


@pytest.mark.nightly(sample=True)
def test_intervals_cover_the_truth_and_key_discovery_is_recovered():
    studies = [estimates(seed) for seed in range(count(2, 400))]
    covered = {
        "effect of the group": [_holds(one["reward_mean"], -EFFECT) for one, *_ in studies],
        "effect of lines": [_covers(found, -EFFECT) for _, found, *_ in studies],
        "groups find keys alike": [_holds(one["all_keys_discovered_s"], 0.0) for one, *_ in studies],
        "reaction time": [low <= REACTION_MS <= high for _, _, (low, high), _ in studies],
    }
    for name, hits in covered.items():
        print(f"{name}: {np.mean(hits):.3f} of {len(hits)} intervals hold the truth")  # shown by pytest -s
        assert scipy.stats.binomtest(sum(hits), len(hits), 0.95).pvalue > 0.001, f"{name}: {np.mean(hits):.3f} of 0.95"
    found = np.concatenate([steps for *_, steps in studies])
    assert np.isnan(found).mean() < 0.01
    assert np.nanmean(found) == pytest.approx(KEYS, abs=4 * np.nanstd(found) / math.sqrt(len(found)))
    differences = np.array([one["reward_mean"].difference for one, *_ in studies])
    assert differences.mean() == pytest.approx(-EFFECT, abs=4 * differences.std(ddof=1) / math.sqrt(len(differences)))


@pytest.mark.nightly(sample=True)
def test_without_an_effect_p_is_small_as_rarely_as_it_should_be():
    small = []
    for seed in range(count(5, 2_000)):
        rng = np.random.default_rng([7, seed])
        (test,) = permutation_tests([(rng.normal(0.7, 0.1, 6), rng.normal(0.7, 0.1, 6))])
        small.append(test is not None and test.p() < 0.05)
    assert scipy.stats.binomtest(sum(small), len(small), 0.05, alternative="greater").pvalue > 0.001


PROTOCOL = b"""
[study]
name = "recovery"
version = "1"
seed = 5
participants = 12
[keys]
pool = ["1", "2", "3", "4", "5"]
[[groups]]
name = "everyone"
blocks = ["grid"]
[[blocks]]
name = "grid"
world = "minihuman/MiniGrid-FourRooms-v0"
episodes = 3
actions = ["left", "right", "forward"]
max_steps = 100
"""


@pytest.mark.nightly(sample=True)
def test_simulated_players_reaction_times_come_out_of_the_report_as_they_went_in(tmp_path):
    """Ex-Gaussian reaction times with mean 300 + 100 ms, no practice: their mean over all steps is 400 ms."""
    player = "human-like:mu_ms=300,sigma_ms=40,tau_ms=100,practice=0,repeat=1,orient_ms=0,post_error_ms=0,fatigue=0"
    people = count(2, 12)
    paths = list(simulate(decode_protocol(PROTOCOL), tmp_path, participants=people, seed=3, player=player))
    sessions = list(StudySessions(tmp_path, processes=1).rows(with_shortest=True))
    assert len(sessions) == len(paths) == people
    times = np.concatenate([one.rows["steps"].column("reaction_ms").to_numpy() for one in sessions])
    times = times[~np.isnan(times)]
    error = math.sqrt(40**2 + 100**2) / math.sqrt(len(times))
    assert times.mean() == pytest.approx(400, abs=4 * error)
    for one in sessions:
        keys = one.rows["keys"].to_pandas()
        mapped = keys[keys["action"].notna()]
        reached = [row["success"] for row in one.rows["episodes"].to_pylist()]
        assert mapped["discovered_steps"].notna().sum() >= 2 * any(reached)  # a goal elsewhere takes a turn and strides


def _holds(comparison, truth):
    low, high = comparison.interval
    return low <= truth <= high


def _covers(found, truth):
    (term,) = (term for term in found.terms if term.name.startswith("control minus trained: reward"))
    return term.interval[0] <= truth <= term.interval[1]
