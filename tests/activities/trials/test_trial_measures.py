"""Measures of trials: equal to textbooks, and to the formulas written with SciPy; and the report that shows them."""

import html
import re

import numpy as np
import pandas as pd
import pytest
import scipy

from minihuman.activities.trials.trial_measures import find_quantiles, mark_trimmed, measure_conditions
from minihuman.dataset.tables import select
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.reporting.build import build_report
from minihuman.runtime.simulated_session import simulate
from minihuman.statistics.signal_detection import measure_detection
from tests.activities.trials.test_labels import TABLE, TOML


def test_detection_is_that_of_stanislaw_and_todorov():
    # Stanislaw and Todorov (1999), Behavior Research Methods, Instruments, & Computers 31, 137-149: hit rate 0.8 and
    # false-alarm rate 0.4 give d' = 1.095 and c = -0.294. With very many trials the log-linear correction vanishes.
    many = measure_detection(20_000_000, 5_000_000, 10_000_000, 15_000_000)
    assert (many.hit_rate, many.false_alarm_rate) == (0.8, 0.4)
    assert many.d_prime == pytest.approx(1.095, abs=5e-4)
    assert many.criterion == pytest.approx(-0.294, abs=5e-4)


@pytest.mark.parametrize("counts", [(20, 5, 10, 15), (25, 0, 0, 25), (0, 25, 25, 0), (1, 0, 0, 1), (40, 0, 3, 7)])
def test_detection_has_the_log_linear_correction_for_everybody(counts):
    hits, misses, false_alarms, correct_rejections = counts
    # Hautus (1995): (x + 0.5) / (n + 1)
    z_hit = scipy.stats.norm.ppf((hits + 0.5) / (hits + misses + 1))
    z_false_alarm = scipy.stats.norm.ppf((false_alarms + 0.5) / (false_alarms + correct_rejections + 1))
    measured = measure_detection(*counts)
    assert measured.d_prime == pytest.approx(z_hit - z_false_alarm, rel=1e-9)
    assert measured.criterion == pytest.approx(-(z_hit + z_false_alarm) / 2, rel=1e-9, abs=1e-12)


def test_detection_without_noise_trials_is_unknown():
    assert np.isnan(measure_detection(10, 2, 0, 0).d_prime)


def make_trials(rows: list[tuple[str, str, float, str]]) -> pd.DataFrame:
    """Trials of one participant: correct, response, time, level of congruent."""
    return pd.DataFrame(
        {
            "participant": "sub-01", "session": 1, "group": "all", "block": "b", "trial": number, "correct": correct,
            "response": response, "is_correct": response == correct, "response_ms": time,
            "labels": f'{{"congruent": "{level}"}}' if level else None,
        }
        for number, (correct, response, time, level) in enumerate(rows, 1)
    )  # fmt: skip


def test_accuracy_times_and_detection_are_those_counted_by_hand():
    trials = make_trials(
        [
            ("go", "go", 400.0, "yes"), ("go", "go", 420.0, "yes"), ("go", "none", np.nan, "yes"),
            ("go", "go", 500.0, "no"), ("go", "go", 540.0, "no"), ("none", "go", 300.0, "no"),
            ("none", "none", np.nan, "no"), ("none", "none", np.nan, "no"), ("go", "go", 100.0, "yes"),
        ]
    )  # fmt: skip
    measured = measure_conditions(trials).set_index(["label", "level"])
    overall = measured.loc[("", "all")]
    assert overall["trials"] == 9
    assert overall["accuracy"] == pytest.approx(7 / 9)
    assert overall["response_median_ms"] == np.median([400, 420, 500, 540, 100])
    assert overall["response_mean_ms"] == np.mean([400, 420, 500, 540]), "100 ms cannot follow from the stimulus"
    assert overall["omissions"] == pytest.approx(1 / 6)
    assert overall["hit_rate"] == pytest.approx(5 / 6)
    assert overall["false_alarm_rate"] == pytest.approx(1 / 3)
    assert overall["d_prime"] == pytest.approx(scipy.stats.norm.ppf(5.5 / 7) - scipy.stats.norm.ppf(1.5 / 4))
    times = measured["response_mean_ms"]
    assert times[("congruent", "no")] - times[("congruent", "yes")] == 520.0 - 410.0


def test_times_further_than_three_scaled_deviations_from_the_median_are_trimmed():
    times = [480.0, 490.0, 500.0, 510.0, 520.0, 900.0]
    trials = make_trials([("go", "go", time, "") for time in times])
    deviation = scipy.stats.median_abs_deviation(times, scale="normal")
    expected = [bool(abs(time - np.median(times)) <= 3 * deviation) for time in times]
    assert mark_trimmed(trials).tolist() == expected == [True] * 5 + [False]


def test_quantiles_are_each_participants_then_their_mean():
    first = make_trials([("go", "go", time, "") for time in (100.0, 200.0, 300.0)])
    second = make_trials([("go", "go", time, "") for time in (300.0, 400.0, 500.0)]).assign(participant="sub-02")
    trials = pd.concat([first, second], ignore_index=True)
    quantiles = find_quantiles(trials, pd.Series("all", trials.index), (0.5,))
    assert quantiles.loc["all", 0.5] == 300.0


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The text of the report's page of a simulated Stroop study with two groups."""
    data = tmp_path_factory.mktemp("trials-report")
    toml = TOML.replace('name = "all"', 'name = "old"').replace(
        "[[blocks]]", '[[groups]]\nname = "young"\nblocks = ["stroop"]\n[[blocks]]', 1
    )
    toml = toml.replace('"response_median_ms"', '"trials:response_mean_ms"')
    protocol = decode_protocol(toml.encode(), "p.toml", {"words.csv": TABLE})
    assert len(list(simulate(protocol, data, participants=8, seed=1, player="human-like"))) == 8
    with select(data / "stroop") as tables:
        build_report(tables, data / "report")
    assert (data / "report" / "figures" / "stroop_trials_congruent.png").exists()
    page = (data / "report" / "report.html").read_text(encoding="utf-8")
    assert "Median reaction times are of all responses, right or wrong." in page
    assert "of correct responses alone. Median: of all of these." in page
    assert " trials are included" in page
    assert " episodes included" not in page
    text = re.sub(r"<(style|script).*?</\1>|<[^>]*>", " ", page, flags=re.DOTALL)
    return re.sub(r"\s+", " ", html.unescape(text))


def test_the_report_of_trials_answers_what_a_stroop_study_asks(report):
    assert "interaction of group and condition: no \N{MINUS SIGN} yes, old \N{MINUS SIGN} young is" in report
    assert "Levels no and yes of congruent. Each comparison is over the participants with a value in" in report
    assert re.search(r"trimmed \(ms\) primary no \S yes 8 ", report)
    assert re.search(r"stroop congruent accuracy \(share of trials\)", report)
    assert re.search(r"congruent: no \S yes response time, mean of correct", report), "the interaction with the group"
    assert "quarter = 4" in report
    assert "Leys et al., 2013" in report


def test_the_report_of_trials_has_no_words_of_ways_to_a_goal(report):
    assert not re.findall(r"SPL|shortest path|excess steps|did not reach the goal|Paths|Kaplan", report)


def test_the_methods_say_of_trials_what_all_of_them_have_in_common(report):
    methods = report[report.index("took part") :]
    assert (
        "Block stroop: 24 trials of minihuman/Stimulus-v0, responses = ['red', 'green']; stimuli from the "
        "table 'words.csv', in an order drawn for each participant, at most 3 trials with the same congruent in "
        "a row; the stimulus stayed until the response, at most 2000 ms"
    ) in methods
    assert "text =" not in methods


def test_a_switch_cost_is_the_difference_after_another_task():
    trials = make_trials([("go", "go", time, "") for time in (400.0, 500.0, 410.0, 520.0, 430.0, 300.0)])
    trials["labels"] = [f'{{"task": "{task}"}}' for task in "AABBAA"]
    trials.loc[5, "trial"] = 8  # the trial before it is excluded, so that it is neither
    measured = measure_conditions(trials).set_index(["label", "level"])["response_median_ms"]
    assert measured["task_switch", "repeat"] == pytest.approx((500 + 520) / 2)
    assert measured["task_switch", "switch"] == pytest.approx((410 + 430) / 2)
