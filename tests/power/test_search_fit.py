import math

import numpy as np
import pytest
from scipy import stats

from minihuman.data.marks import Mark, add_mark
from minihuman.data.study import Sessions
from minihuman.errors import ReportError
from minihuman.log.read.open_log import open_log
from minihuman.players.human_like import HumanLikePlayer
from minihuman.power.bare import best_ways, play_bare
from minihuman.power.fitting import fit_people
from minihuman.power.search_fit import SOUGHT, fit_search, lines
from minihuman.power.traces import COUNTED, Trace, counts_of, trace_of
from minihuman.seats.simulate import simulate
from minihuman.study.protocol import decode
from tests.builders import session, write_log
from tests.counts import count

PROTOCOL = """
[study]
name = "looking"
version = "1"
seed = 5
participants = 40
[keys]
pool = ["1", "2", "3", "4", "5", "6"]
[[groups]]
name = "everyone"
blocks = ["grid"]
[[blocks]]
name = "grid"
world = "minihuman/MiniGrid-FourRooms-v0"
episodes = EPISODES
actions = ["left", "right", "forward"]
max_steps = 100
"""


def study(episodes):
    return decode(PROTOCOL.replace("EPISODES", str(episodes)).encode())


def somebody(seed, index):
    """The very person whom ``simulate`` seats there."""
    return HumanLikePlayer("", np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(index,))))


def trace(actions, *, shown=None, poses=None, t_s=None, outcome="goal", steps=10, best=5, limit=100, block=0):
    n = len(actions)
    return Trace(
        block,
        tuple(actions),
        np.ones(n, bool) if shown is None else np.array(shown, bool),
        np.zeros((n, 3)) if poses is None else np.array(poses, float),
        np.arange(n, dtype=float) if t_s is None else np.array(t_s, float),
        outcome,
        0.9,
        steps,
        best,
        limit,
    )


@pytest.mark.program
def test_without_a_session_somebody_presses_the_same_keys(tmp_path):
    list(simulate(study(2), tmp_path, participants=2, seed=3, player="human-like"))
    for index, counted in enumerate(Sessions(tmp_path, processes=1)):
        best = best_ways([episode.plan for episode in counted.episodes])
        logged = [trace_of(episode, known) for episode, known in zip(counted.episodes, best, strict=True)]
        played = play_bare(counted.session.plan, somebody(3, index), {})
        assert [one.actions for one in logged] == [one.actions for one in played]
        assert [one.shown.tolist() for one in logged] == [one.shown.tolist() for one in played]
        ended = [[(one.outcome, one.reward, one.steps, one.best) for one in traces] for traces in (logged, played)]
        assert ended[0] == ended[1]
        for one, other in zip(logged, played, strict=True):
            assert one.poses == pytest.approx(other.poses)


def told(traces):
    return dict(zip(COUNTED, counts_of(traces).tolist(), strict=True))


def test_what_is_counted_begins_when_the_keys_were_found():
    before = trace(["", "", "left", "forward"])
    after = trace(["left", "right", "", "forward", "forward"], shown=[1, 1, 0, 0, 1])
    found = told([trace(["", "left", "right", "", "forward"]), after])
    assert found["spare keys"] == math.log(1.5 / 6)
    assert found["steps in vain"] == math.log(1.5 / 6)
    assert found["turns undone"] == math.log(1.5 / 6)
    assert found["turns"] == math.log(2.5 / 6)
    assert found["steps straight on"] == math.log(1.5 / 6)
    assert told([before])["spare keys"] == math.log(0.5 / 1)  # nothing was pressed after the last key was found


def test_places_are_come_back_to():
    walk = [(0, 0, 0), (1, 0, 0), (2, 0, 0), (1, 0, 0), (5, 5, 0)]
    assert told([trace(["", *["forward"] * 5], shown=[0, *[1] * 5], poses=[(0, 0, 0), *walk])])[
        "places again"
    ] == math.log(1.5 / 5)
    late = [0, 1, 2, 30, 31]
    assert told([trace(["forward"] * 5, poses=walk, t_s=late)])["places again much later"] == math.log(1.5 / 5)


def test_time_outs_count_at_the_limit():
    found = told([trace(["forward"], steps=100, outcome="timeout"), trace(["forward"], steps=5)])
    assert found["log excess steps"] == pytest.approx(math.log(96) / 2)
    assert found["time-outs"] == math.log(1.5 / 3)


@pytest.mark.program
@pytest.mark.long
def test_known_people_are_in_their_intervals(tmp_path):
    people, seed = count(4, 30), 11
    list(simulate(study(count(4, 10)), tmp_path, participants=people, seed=seed, player="human-like"))
    found = fit_search(Sessions(tmp_path), people=count(40, 200), seed=1)
    assert len(found.people) == people
    held = dict.fromkeys(SOUGHT, 0)
    for index, one in enumerate(found.people):
        truth = somebody(seed, index).person
        for name, (low, high) in one.intervals.items():
            held[name] += low <= getattr(truth, name) <= high
    print({name: f"{hits} of {people}" for name, hits in held.items()}, {k: round(v, 2) for k, v in found.told.items()})
    print("\n".join(lines(found)[-3:]))  # shown by pytest -s
    assert stats.binomtest(sum(held.values()), people * len(SOUGHT), 0.95).pvalue > 0.001
    assert all(0 < low < one.values[name] < high for one in found.people for name, (low, high) in one.intervals.items())


def test_who_does_not_count_is_nobody_that_a_person_is_fitted_to(tmp_path):
    path = write_log(session(episodes=4, blocks=("grid",)), tmp_path)  # some 150 presses
    add_mark(open_log(path), Mark("exclude", "2026-11-23T09:00:00Z", note="the wrong person"))
    with pytest.raises(ReportError, match="nobody has enough presses"):
        list(fit_people(Sessions(tmp_path, processes=1)))


def test_too_few_simulated_people_are_refused(tmp_path):
    with pytest.raises(ReportError, match="--search is 5"):
        fit_search(Sessions(tmp_path), people=5, seed=1)
