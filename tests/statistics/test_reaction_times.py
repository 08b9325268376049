import numpy as np
import pytest
import scipy

from minihuman.planning.reaction_time_fit import PARAMETER_NAMES, ReactionTimes, fit_reaction_times, log_density
from minihuman.simulation.human_like import ParticipantPopulation
from tests.counts import count


def somebodys(seed: int, presses: int = 900):
    """A person's parameters and times."""
    rng = np.random.default_rng([3, seed])
    person = ParticipantPopulation().draw(rng)
    again = rng.random(presses) < 0.6
    ms = [person.reaction_ms(rng, presses=number, again=bool(again[number])) for number in range(presses)]
    return person, ReactionTimes(np.array(ms), again, np.arange(presses))


@pytest.mark.nightly(sample=True)
def test_known_parameters_are_in_their_intervals():
    people = [somebodys(seed) for seed in range(count(4, 30))]
    named = [name for name in PARAMETER_NAMES if name != "pause"]  # these people look away never
    held, reported = dict.fromkeys(named, 0), 0
    for person, times in people:
        found = fit_reaction_times(times, floor_ms=person.floor_ms)
        assert found is not None
        for name in found.intervals.keys() & set(named):
            low, high = found.intervals[name]
            held[name] += low <= getattr(person, name) <= high
            reported += 1
    print({name: f"{hits} of {len(people)}" for name, hits in held.items()})  # shown by pytest -s
    assert reported >= 0.9 * 5 * len(people)  # of 900 presses all but practice_presses
    assert scipy.stats.binomtest(sum(held.values()), reported, 0.95).pvalue > 0.001


def test_a_fitted_person_predicts_better_than_another():
    person, times = somebodys(0)
    other, _ = somebodys(1)
    own, others = (
        log_density(times, {name: getattr(one, name) for name in PARAMETER_NAMES}, floor_ms=160.0).mean()
        for one in (person, other)
    )
    assert own > others


def test_too_few_times_are_not_fitted():
    _, times = somebodys(0, presses=100)
    assert fit_reaction_times(times, floor_ms=160.0) is None


def test_pauses_leave_the_other_parameters_as_they_are():
    person, times = somebodys(2, presses=600)
    rng = np.random.default_rng(1)
    paused = times.ms + np.where(rng.random(600) < 0.02, rng.uniform(1500, 5000, 600), 0.0)
    found = fit_reaction_times(ReactionTimes(paused, times.again, times.presses), floor_ms=160.0)
    assert found.values["tau_ms"] == pytest.approx(person.tau_ms, rel=0.35)  # without a part for pauses it doubles
    assert 0.005 < found.values["pause"] < 0.05


def test_autocorrelated_times_keep_their_distribution_and_have_wider_intervals():
    person = ParticipantPopulation.parse("spread=0,autocorrelation=0.4,practice=0").draw(np.random.default_rng(0))
    rng, state = np.random.default_rng(1), np.zeros(2)
    ms = np.array([person.reaction_ms(rng, presses=0, again=False, state=state) for _ in range(4000)])
    assert ms.mean() == pytest.approx(person.mu_ms + person.tau_ms, rel=0.03)
    assert ms.std() == pytest.approx(np.hypot(person.sigma_ms, person.tau_ms), rel=0.08)
    assert 0.25 < np.corrcoef(ms[:-1], ms[1:])[0, 1] < 0.45
    again, presses = np.zeros(400, bool), np.zeros(400, int)  # without practice the order tells nothing else
    own, shuffled = (
        fit_reaction_times(ReactionTimes(one, again, presses), floor_ms=160.0).intervals["mu_ms"]
        for one in (ms[:400], rng.permutation(ms[:400]))
    )
    assert own[1] - own[0] > 1.2 * (shuffled[1] - shuffled[0])


def test_few_presses_have_intervals_of_what_they_tell():
    _, times = somebodys(0, presses=160)
    found = fit_reaction_times(times, floor_ms=160.0)
    assert {"mu_ms", "sigma_ms", "repeat_factor"} <= set(found.intervals)
    assert not {"practice", "practice_presses", "tau_ms"} & set(found.intervals)
