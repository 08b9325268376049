import numpy as np
import pytest
from scipy import stats

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


@pytest.mark.long
def test_known_parameters_are_in_their_intervals():
    people = [somebodys(seed) for seed in range(count(4, 30))]
    held = dict.fromkeys(PARAMETER_NAMES, 0)
    for person, times in people:
        found = fit_reaction_times(times, floor_ms=person.floor_ms)
        assert found is not None
        for name, (low, high) in found.intervals.items():
            held[name] += low <= getattr(person, name) <= high
    print({name: f"{hits} of {len(people)}" for name, hits in held.items()})  # shown by pytest -s
    assert stats.binomtest(sum(held.values()), len(people) * len(PARAMETER_NAMES), 0.95).pvalue > 0.001


def test_a_fitted_person_predicts_better_than_another():
    person, times = somebodys(0)
    other, _ = somebodys(1)
    own, others = (
        log_density(times, {name: getattr(one, name) for name in PARAMETER_NAMES}, floor_ms=160.0).mean()
        for one in (person, other)
    )
    assert own > others


def test_too_few_times_are_not_fitted():
    _, times = somebodys(0, presses=30)
    assert fit_reaction_times(times, floor_ms=160.0) is None
