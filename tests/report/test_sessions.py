"""Session as a factor: each session's values, and the change from the first to each later one."""

import math
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import scipy

from minihuman.dataset.tables import select
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.experiment.protocol.specs import AnalysisSpec
from minihuman.figures.figure_data import collect_learning_curves
from minihuman.reporting.block_measures import MEASURES
from minihuman.reporting.block_results import BlockResults, compute_block_results
from minihuman.reporting.result_tables import session_changes_table, session_table
from minihuman.runtime.simulated_session import simulate
from tests.report.reports import write_report

PEOPLE = 8
MEASURE = "reward_mean"


def two_days() -> tuple[pd.DataFrame, pd.DataFrame]:
    """A block's rows and episodes: two groups over two days, one of whose participants missed the second."""
    rng = np.random.default_rng(2)
    who = [
        (group, f"{group}-{number}", session)
        for group in ("a", "b")
        for number in range(PEOPLE)
        for session in (1, 2)
        if (group, number, session) != ("a", 0, 2)
    ]
    rows = pd.DataFrame(
        {"group": group, "participant": name, "session": session, "block": "grid", "episodes": 2, "reward_sd": 0.1}
        | dict.fromkeys(MEASURES, np.nan)
        | {"keys_total": 0, MEASURE: 0.4 + 0.2 * (session == 2) * (group == "a") + rng.normal(0, 0.1)}
        for group, name, session in who
    )
    episodes = pd.DataFrame(
        {"group": group, "participant": name, "session": session, "world": "w", "episode_in_block": at, "reward": 0.5}
        | {
            "playing_s": 10.0,
            "steps": 40,
            "success": True,
            "exclusion_reason": None,
            "max_steps": 40,
            "outcome": "goal",
        }
        for group, name, session in who
        for at in (1, 2)
    )
    return rows, episodes


def results() -> BlockResults:
    return compute_block_results("grid", *two_days(), ["a", "b"], AnalysisSpec())


def values(rows: pd.DataFrame, group: str) -> pd.DataFrame:
    """A participant in each row, a session in each column."""
    return rows[rows["group"] == group].pivot(index="participant", columns="session", values=MEASURE)


def test_each_session_has_its_own_value_and_who_missed_one_is_in_the_other() -> None:
    rows, _ = two_days()
    by_session = results().by_session.set_index(["measure", "group", "session"])
    for group in ("a", "b"):
        for session in (1, 2):
            theirs = values(rows, group)[session].dropna()
            n, mean, sd = by_session.loc[(MEASURE, group, session), ["n", "mean", "sd"]]
            assert (n, mean, sd) == (len(theirs), pytest.approx(theirs.mean()), pytest.approx(theirs.std()))


def test_the_change_is_over_those_who_came_both_days() -> None:
    rows, _ = two_days()
    for change in results().changes:
        both = values(rows, change.group).dropna()
        differences = (both[2] - both[1]).to_numpy()
        expected = scipy.stats.permutation_test(
            (differences,), np.mean, permutation_type="samples", n_resamples=np.inf, vectorized=True
        )
        assert change.n == len(both) == (PEOPLE - 1 if change.group == "a" else PEOPLE)
        assert change.sessions == (1, 2)
        assert change.estimate == pytest.approx((both[2] - both[1]).mean())
        assert change.p == pytest.approx(expected.pvalue)
        for bound in change.interval:  # of the values that the same test does not reject
            shifted = scipy.stats.permutation_test(
                (differences - bound,), np.mean, permutation_type="samples", n_resamples=np.inf, vectorized=True
            )
            assert shifted.pvalue == pytest.approx(0.05, abs=2.1 / 2 ** len(both))
    assert [(one.measure, one.group) for one in results().changes] == [(MEASURE, "a"), (MEASURE, "b")]


def test_groups_are_compared_on_their_change() -> None:
    rows, _ = two_days()
    [(sessions, compared)] = results().changes_compared
    change = {group: (values(rows, group)[2] - values(rows, group)[1]).dropna() for group in ("a", "b")}
    assert sessions == (1, 2)
    assert compared.n == (PEOPLE - 1, PEOPLE)
    assert compared.difference == pytest.approx(change["a"].mean() - change["b"].mean())
    low, high = scipy.stats.ttest_ind(change["a"], change["b"], equal_var=False).confidence_interval(0.95)
    assert compared.interval == pytest.approx((low, high), abs=0.15 * (high - low))  # a permutation's, near Welch's
    assert (compared.p < 0.05) != (compared.interval[0] <= 0 <= compared.interval[1])


def test_the_tables_name_the_sessions() -> None:
    table, compared = session_table(results()), session_changes_table(results())
    assert table is not None
    assert compared is not None
    assert table.heads == ("measure", "group", "session 1", "session 2", "n", "change", "p")
    assert [row[1] for row in table.rows] == ["a", "b"]
    assert table.rows[0][4] == str(PEOPLE - 1)
    assert compared.rows[0][1] == "a \N{MINUS SIGN} b"


def test_a_block_of_one_session_has_no_such_table() -> None:
    rows, episodes = two_days()
    alone = compute_block_results(
        "grid", rows[rows["session"] == 1], episodes[episodes["session"] == 1], ["a", "b"], AnalysisSpec()
    )
    assert alone.by_session["session"].unique().tolist() == [1]
    assert (alone.changes, alone.changes_compared) == ((), ())
    assert session_table(alone) is None
    assert session_changes_table(alone) is None


def test_a_change_that_one_participant_tells_has_no_interval() -> None:
    rows, episodes = two_days()
    few = rows["participant"].isin(["a-1", "b-1"])
    found = compute_block_results("grid", rows[few], episodes, ["a", "b"], AnalysisSpec())
    assert [one.n for one in found.changes] == [1, 1]
    assert all(math.isnan(bound) for one in found.changes for bound in (*one.interval, one.p))


def test_a_learning_curve_is_of_one_session() -> None:
    _, episodes = two_days()
    episodes["reward"] = np.where(episodes["session"] == 2, 0.9, 0.1)
    curves = collect_learning_curves(episodes)
    assert list(curves) == ["a, session 1", "a, session 2", "b, session 1", "b, session 2"]
    assert [curve.shape for curve in curves.values()] == [(8, 2), (7, 2), (8, 2), (8, 2)]
    assert [set(curve.ravel()) for curve in curves.values()] == [{0.1}, {0.9}] * 2
    assert list(collect_learning_curves(episodes[episodes["session"] == 1])) == ["a", "b"]


PROTOCOL = b"""
[study]
name = "days"
version = "1"
seed = 3
participants = 8
[keys]
check = false
[[groups]]
name = "early"
[[groups]]
name = "late"
[[sessions]]
name = "first"
parts = ["once", "both"]
[[sessions]]
name = "second"
parts = ["both"]
[[blocks]]
name = "once"
world = "minihuman/MiniGrid-Empty-5x5-v0"
episodes = 2
actions = ["left", "right", "forward"]
max_steps = 20
[[blocks]]
name = "both"
world = "minihuman/MiniGrid-Empty-5x5-v0"
episodes = 2
actions = ["left", "right", "forward"]
max_steps = 20
"""


@pytest.mark.program
def test_a_report_of_two_days_shows_each_and_the_change(tmp_path: Path) -> None:
    for _ in simulate(decode_protocol(PROTOCOL), tmp_path, participants=6, seed=1, player="random"):
        pass
    written = write_report(select(tmp_path / "days", processes=1), tmp_path / "out")
    text = written[0].read_text()
    assert text.count("<summary>Sessions</summary>") == 1, "the block that was played once has no sessions to compare"
    assert "<details open><summary>Sessions</summary>" in text, "the question is about the change"
    assert "B: the difference of the means, with the interval of the comparison" in text
    assert text.index("difference of the changes, early") < text.index("<nav>")
    (which,) = re.findall(r"all its comparisons are exploratory(.*?)\.", text.partition('id="block-both"')[2], re.S)
    assert which == "", "no p stands above"
    (once,) = re.findall(r"exploratory,\s+(.*?)\.", text.partition('id="block-once"')[2].partition("<h2")[0], re.S)
    assert once == "and the p above is not corrected"
    assert "<th>session 1</th><th>session 2</th>" in text
    assert "their mean over the sessions" in text
    figures = {path.name for path in written}
    assert "both_sessions.png" in figures
    assert "once_sessions.png" not in figures
