"""Stop-signal reaction times: as the consensus guide estimates them, from a planted race, and in a simulated study."""

import html
import math
import re

import numpy as np
import pandas as pd
import pytest
import scipy

from minihuman.activities.trials.report import _tabulate_stop_signals
from minihuman.activities.trials.stop_signal import estimate_stop_signal
from minihuman.admin.protocol_file import read_protocol
from minihuman.admin.verify.log import verify_session
from minihuman.dataset.tables import select
from minihuman.reporting.build import build_report
from minihuman.runtime.simulated_session import simulate
from tests.activities.trials.test_trials import SHIPPED

GO_MS = np.arange(401.0, 501.0)  # 100 go trials
CORRECT = np.ones(100, bool)


def stop_trials(responded: int, withheld: int, *, failed_ms: float = 380.0) -> np.ndarray:
    return np.array([failed_ms] * responded + [math.nan] * withheld)


def test_the_estimate_is_the_go_time_at_the_response_rate_minus_the_mean_delay():
    # Verbruggen et al. (2019), appendix 3: the nth go time, n = p(respond | signal) x number of go times
    estimate = estimate_stop_signal(GO_MS, CORRECT, stop_trials(30, 30), np.full(60, 200.0))
    assert estimate.response_rate == 0.5
    assert estimate.ssrt_ms == 450.0 - 200.0
    assert estimate.remark == ""


def test_go_omissions_count_as_the_slowest_response_and_errors_as_they_are():
    go_ms = np.where(np.arange(100) < 40, math.nan, GO_MS)
    estimate = estimate_stop_signal(go_ms, CORRECT, stop_trials(45, 15), np.full(60, 200.0))
    # 60 responses from 441 on, 40 omissions as 500 ms; place 75 of 100
    assert estimate.ssrt_ms == 500.0 - 200.0
    assert estimate.go_omissions == 0.4
    wrong = estimate_stop_signal(GO_MS, CORRECT & (GO_MS > 430), stop_trials(30, 30), np.full(60, 200.0))
    assert wrong.ssrt_ms == 250.0
    assert wrong.go_accuracy == 0.7


@pytest.mark.parametrize(
    ("stop_ms", "remark"),
    [
        (stop_trials(25, 24), "fewer than 50 stop trials"),
        (stop_trials(30, 30, failed_ms=600.0), "failed stops are not faster"),
    ],
)
def test_no_estimate_is_given_where_the_guide_forbids_it(stop_ms, remark):
    estimate = estimate_stop_signal(GO_MS, CORRECT, stop_ms, np.full(len(stop_ms), 200.0))
    assert math.isnan(estimate.ssrt_ms)
    assert estimate.remark.startswith(remark)


def test_a_response_rate_far_from_a_half_is_flagged():
    estimate = estimate_stop_signal(GO_MS, CORRECT, stop_trials(10, 50), np.full(60, 200.0))
    assert not math.isnan(estimate.ssrt_ms)
    assert "outside 0.25 to 0.75" in estimate.remark


def test_a_planted_race_is_recovered():
    rng = np.random.default_rng(7)
    go_ms = rng.normal(400, 40, 20_000) + rng.exponential(100, 20_000)
    racing_ms = rng.normal(400, 40, 20_000) + rng.exponential(100, 20_000)
    # One delay and one stop time: with a staircase the mean delay hides their spread, and the guide's estimate is low.
    stop_ms = np.where(racing_ms > 250.0 + 220.0, math.nan, racing_ms)
    estimate = estimate_stop_signal(go_ms, np.ones(20_000, bool), stop_ms, np.full(20_000, 250.0))
    assert estimate.response_rate == pytest.approx(0.45, abs=0.1)
    assert estimate.ssrt_ms == pytest.approx(220, abs=2)


def test_participants_whose_groups_come_in_turn_have_one_row_each_and_one_for_each_group():
    trials = pd.DataFrame(
        [
            {"block": "b", "group": group, "participant": f"sub-{number}", "response_ms": 400.0, "is_correct": True}
            | {"stimulus": f'{{"delay_ms": {delay_ms}}}', "correct": correct}
            for number, group in enumerate(("old", "young", "old", "young"))
            for delay_ms, correct in ((200, "left"), (200, "none"))
        ]
    )
    table, remarks = _tabulate_stop_signals(trials)
    assert [row[1:3] for row in table.table.rows] == [
        ("old", "sub-0"),
        ("old", "sub-2"),
        ("old", "all with an SSRT: 0 of 2"),
        ("young", "sub-1"),
        ("young", "sub-3"),
        ("young", "all with an SSRT: 0 of 2"),
    ]
    assert [row[2:] for row in remarks.table.rows] == [
        (participant, "fewer than 50 stop trials") for participant in ("sub-0", "sub-2", "sub-1", "sub-3")
    ]


def test_the_mean_has_the_t_interval_over_participants_and_groups_are_compared_on_it():
    groups = {"old": [251.0, 262.0, 248.0, 255.0, 270.0, 259.0], "young": [240.0, 236.0, 249.0, 244.0, 231.0, 246.0]}
    rows = []
    for group, ssrts in groups.items():
        for number, ssrt_ms in enumerate(ssrts):
            go_ms = GO_MS + ssrt_ms - 250  # half of the responses are stopped, at a delay of 200 ms
            row = {"block": "b", "group": group, "participant": f"{group}-{number}", "is_correct": True}
            rows += [row | {"stimulus": "{}", "correct": "left", "response_ms": time_ms} for time_ms in go_ms]
            stop = row | {"stimulus": '{"delay_ms": 200}', "correct": "none"}
            rows += [stop | {"response_ms": time_ms} for time_ms in stop_trials(30, 30)]
    table, comparison, *_ = _tabulate_stop_signals(pd.DataFrame(rows))
    for group, ssrts in groups.items():
        shown = [row[-1] for row in table.table.rows if row[1] == group]
        assert [float(cell) for cell in shown[:-1]] == ssrts
        mean = np.mean(ssrts)
        low, high = scipy.stats.t.interval(0.95, 5, mean, scipy.stats.sem(ssrts))
        assert shown[-1] == f"{mean:.0f} ({np.std(ssrts, ddof=1):.2f}), {low:.0f} to {high:.0f}"
    ((block, pair, n, difference, p, p_holm),) = comparison.table.rows
    assert (block, pair, n, p) == ("b", "old \N{MINUS SIGN} young", "6, 6", p_holm)
    assert difference.startswith(f"+{np.mean(groups['old']) - np.mean(groups['young']):.1f} (+")
    every_regrouping = scipy.stats.permutation_test(
        (groups["old"], groups["young"]),
        lambda old, young: abs(scipy.stats.ttest_ind(old, young, equal_var=False).statistic),
        n_resamples=np.inf, alternative="greater",
    )  # fmt: skip
    assert float(p) == pytest.approx(every_regrouping.pvalue, abs=5e-4)


@pytest.mark.program
def test_a_simulated_study_has_a_stop_signal_reaction_time_and_methods_that_are_true_of_it(tmp_path):
    protocol = read_protocol(SHIPPED / "stop-signal.toml", trust=True)
    [log] = simulate(protocol, tmp_path, participants=1, seed=3, player="human-like")
    assert all(is_proven for _, is_proven in verify_session(log))
    with select(tmp_path / "stop-signal") as tables:
        build_report(tables, tmp_path / "out")
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    text = re.sub(r"\s+", " ", html.unescape(re.sub(r"<(style|script).*?</\1>|<[^>]*>", " ", page, flags=re.DOTALL)))
    row = re.search(r"stop-signal everyone sub-01 156 (\S+) (\S+) \d+ 52 (\S+) \d+ \d+ (\d+) ", text)
    assert row, text
    assert 0.3 < float(row[3]) < 0.7
    assert 150 < float(row[4]) < 290, "the planted stop process takes 220 ms"
    assert "'stop' the time in column 'delay_ms' after the onset of 'go' until the response" in text
    assert "the stimulus stayed until the response" not in text
