"""The rules of adaptive designs: they decide as their sources say, and every one keeps the contract."""

import itertools
import math

import numpy as np
import pytest
import scipy

from minihuman.errors import ProtocolError
from minihuman.experiment.plan.designs import (
    Design,
    DesignSpec,
    EnrolledParticipant,
    PlayedEpisode,
    make_design,
    make_enrolment_design,
)
from minihuman.experiment.plan.group_sequential import compute_adjusted_p, compute_welch_z, find_boundaries
from minihuman.testing import ContractError, check_design

STAIRCASE = {"option": "size", "values": [10, 8, 6, 4, 2], "step_sizes": [2, 1]}
QUEST = {"option": "x", "values": [0.5, 1.0, 2.0, 4.0], "grid": 15, "slopes": [2.0, 4.0]}
LEVELS = {"seeds": [3, 5, 7], "options": [{"size": 5}, {"size": 6}], "replay": 0.0}
SEQUENTIAL = {"looks": [4, 8, 12], "outcome": "reward"}


@pytest.mark.parametrize(
    ("name", "settings", "make"),
    [
        ("staircase", STAIRCASE, make_design),
        ("questplus", QUEST, make_design),
        ("level-replay", LEVELS | {"replay": 0.5}, make_design),
        ("minimisation", {}, make_enrolment_design),
        ("thompson", {}, make_enrolment_design),
        ("group-sequential", SEQUENTIAL, make_enrolment_design),
    ],
)
def test_every_built_in_design_keeps_the_contract(name, settings, make):
    check_design(name, settings)
    with pytest.raises(ProtocolError, match="settings"):
        make(DesignSpec(name, {**settings, "hardness": 1}))


def test_the_contract_catches_a_design_with_a_memory():
    class Forgetful(Design):
        def __init__(self, settings):
            self.asked = 0

        def decide(self, history, draw):
            from minihuman.experiment.plan.designs import DesignDecision

            self.asked += 1
            return DesignDecision({"size": self.asked})

    with pytest.raises(ContractError, match="same history led to another decision"):
        check_design(Forgetful)
    with pytest.raises(ProtocolError, match="must make a"):
        make_design(DesignSpec("minimisation", {}))


def test_a_staircase_goes_down_after_two_successes_and_up_after_a_failure():
    design = make_design(DesignSpec("staircase", STAIRCASE))
    shown, history = [], []
    for success in (1, 1, 1, 1, 0, 1, 1, 0, 1, 0):
        value = design.decide(history, None).options["size"]
        shown.append(value)
        history.append(_episode({"size": value}, success))
    #             two successes: two places, until the first reversal; then one place
    assert shown == [10, 10, 6, 6, 2, 4, 4, 2, 4, 4]
    last = design.decide(history, None)
    assert last.options == {"size": 6}
    assert last.estimates == {"reversals": 3.0, "threshold": pytest.approx((2 + 4 + 2) / 3, rel=1e-5)}
    stopping = make_design(DesignSpec("staircase", STAIRCASE | {"stop_reversals": 3}))
    assert [stopping.decide(history[:n], None).stop for n in (6, 7, 8)] == [False, False, True]  # down, up, down, up


def _episode(options, success, seed=0, return_=0.0):
    return PlayedEpisode(options, seed, "goal" if success else "failure", 1, return_)


def test_quest_plus_is_bayes_rule_and_asks_where_the_least_entropy_is_expected():
    design = make_design(DesignSpec("questplus", QUEST))
    history = [_episode({"x": x}, won) for x, won in ((2.0, 1), (1.0, 1), (0.5, 0), (1.0, 0), (1.0, 1))]
    thresholds, slopes = np.geomspace(0.5, 4.0, 15), (2.0, 4.0)

    def chance(x, threshold, slope):
        return 0.5 + 0.48 * (1 - math.exp(-((x / threshold) ** slope)))

    weights = {}
    for threshold, slope in itertools.product(thresholds, slopes):
        chances = [(chance(one.options["x"], threshold, slope), one.success) for one in history]
        weights[threshold, slope] = math.prod(p if won else 1 - p for p, won in chances)
    total = sum(weights.values())
    mean = sum(weight * math.log(threshold) for (threshold, _), weight in weights.items()) / total
    decided = design.decide(history, None)
    assert decided.estimates["threshold"] == pytest.approx(math.exp(mean), rel=1e-4)

    def expected_entropy(x):
        found = 0.0
        for won in (True, False):
            joint = [
                sum(weights[t, s] / total * (chance(x, t, s) if won else 1 - chance(x, t, s)) for s in slopes)
                for t in thresholds
            ]
            found += sum(joint) * scipy.stats.entropy(joint)
        return found

    assert decided.options == {"x": min(QUEST["values"], key=expected_entropy)}
    harder = make_design(DesignSpec("questplus", QUEST | {"harder": "larger"}))
    easy = [_episode({"x": 4.0}, True)] * 12
    assert harder.decide(easy, None).estimates["threshold"] > 2.5 > design.decide(easy, None).estimates["threshold"]
    assert make_design(DesignSpec("questplus", QUEST | {"stop_sd": 5.0})).decide(history, None).stop


def test_level_replay_shows_each_level_once_then_those_with_regret():
    design = make_design(DesignSpec("level-replay", LEVELS))
    history = []
    for number in range(6):
        decided = design.decide(history, lambda count: (0.3,) * count)
        history.append(_episode(dict(decided.options), True, decided.seed, 0.2 if number == 4 else 0.9))
    levels = {(episode.seed, episode.options["size"]) for episode in history}
    assert levels == set(itertools.product((3, 5, 7), (5, 6)))
    again = [design.decide(history, lambda count, at=at: (0.0, at)[:count]) for at in (0.0, 0.3, 0.6, 0.8)]
    assert {(one.seed, one.options["size"]) for one in again} == {(history[4].seed, history[4].options["size"])}
    assert again[0].estimates == {"levels": 6.0, "regret": pytest.approx((5 * 0.1 + 0.8) / 6, rel=1e-5)}


@pytest.mark.parametrize(("ratio", "most"), [(1, 2), (2, 3)])
def test_minimisation_balances_within_strata(ratio, most):
    design = make_enrolment_design(DesignSpec("minimisation", {"probability": 0.9}))
    rng, enrolled = np.random.default_rng(4), []
    for _ in range(60):
        stratum = str(rng.choice(["often", "rarely"], p=[0.2, 0.8]))
        statistics = design.compute_statistics(enrolled, {"a": 1, "b": ratio})
        decided = design.decide(statistics, stratum, lambda count: tuple(rng.random(count)))
        enrolled.append(EnrolledParticipant(decided.group, stratum))
    for stratum in ("often", "rarely"):
        groups = [one.group for one in enrolled if one.stratum == stratum]
        assert abs(groups.count("a") - groups.count("b") / ratio) <= most
    statistics = {"ratios": {"a": 1, "b": 1}, "all": {"a": 5, "b": 3}, "strata": {}}
    coins = [design.decide(statistics, "often", lambda count, at=at: (at, 0.0)).group for at in (0.89, 0.91)]
    assert coins == ["b", "a"]


def test_thompson_sampling_prefers_success_as_often_as_the_beta_distributions_say():
    design = make_enrolment_design(DesignSpec("thompson", {}))
    enrolled = [
        EnrolledParticipant("a", "", 0.75),
        EnrolledParticipant("a", "", 1.0),
        EnrolledParticipant("b", "", 0.5),
    ]
    statistics = design.compute_statistics([*enrolled, EnrolledParticipant("b")], {"a": 1, "b": 1})
    assert statistics == {"a": [1.75, 0.25], "b": [0.5, 0.5]}
    rng = np.random.default_rng(1)
    drawn = [design.decide(statistics, "", lambda count: tuple(rng.random(count))).group for _ in range(400)]
    truth = np.mean(rng.beta(2.75, 1.25, 20_000) > rng.beta(1.5, 1.5, 20_000))
    assert np.mean([group == "a" for group in drawn]) == pytest.approx(truth, abs=0.08)


def test_boundaries_are_the_published_ones_and_the_adjusted_p_is_alpha_there():
    """Lan-DeMets O'Brien-Fleming, two-sided 0.05, three and five looks, as ldbounds and EAST print them."""
    assert find_boundaries([1 / 3, 2 / 3, 1]) == pytest.approx([3.710, 2.511, 1.993], abs=6e-4)
    assert find_boundaries([0.2, 0.4, 0.6, 0.8, 1]) == pytest.approx([4.877, 3.357, 2.680, 2.290, 2.031], abs=6e-4)
    fractions, bounds = [1 / 3, 2 / 3, 1], find_boundaries([1 / 3, 2 / 3, 1])
    assert compute_adjusted_p(bounds[2], fractions, bounds) == pytest.approx(0.05, abs=1e-6)
    assert compute_adjusted_p(-2.8, fractions[:1], bounds) == pytest.approx(2 * scipy.stats.norm.sf(2.8), rel=1e-6)
    rng = np.random.default_rng(2)
    first, second = rng.normal(1, 1, 9), rng.normal(0, 3, 14)
    z = compute_welch_z(*([len(its), its.mean(), its.var(ddof=1)] for its in (first, second)))
    assert 2 * scipy.stats.norm.sf(abs(z)) == pytest.approx(
        scipy.stats.ttest_ind(first, second, equal_var=False).pvalue
    )
    assert z > 0


def test_a_sequential_study_counts_the_first_complete_participants_of_a_look():
    design = make_enrolment_design(DesignSpec("group-sequential", SEQUENTIAL))
    people = [EnrolledParticipant("ab"[at % 2], "", float(at % 2) + at / 100) for at in range(9)]
    people.insert(2, EnrolledParticipant("a"))
    statistics = design.compute_statistics(people, {"a": 1, "b": 1})
    assert statistics["look"] == 2
    assert [statistics[group][0] for group in "ab"] == [4, 4]  # the ninth waits for the third look
    decided = design.decide(statistics, "", None)
    assert decided.stop
    assert decided.estimates["z"] < -decided.estimates["boundary"]
    assert not design.decide(design.compute_statistics(people[:3], {"a": 1, "b": 1}), "", None).stop
    null = {"look": 3, "a": [6, 0.0, 1.0], "b": [6, 0.1, 1.0]}
    assert design.decide(null, "", None).stop  # the last look ends it
    assert design.decide(null, "", None).estimates["p"] > 0.5
