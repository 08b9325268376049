"""Simulated trials: what they write, and that a run that was broken off goes on."""

import json

from minihuman.learn.teaching.preference_learner import PreferenceSettings, RewardFitting
from teaching_study import feedback, minutes, takeovers
from teaching_study.feedback import run_comparisons, run_ratings
from teaching_study.minutes import run_minutes
from teaching_study.takeovers import run_takeovers

EMPTY = "minihuman/MiniGrid-Empty-5x5-v0"


def twice(run, folder):
    """The table of a run, once from nothing and once with its rows there already; and the times of the rows' files."""
    first = run(folder)
    written = {path: path.stat().st_mtime_ns for path in (folder / "rows").iterdir()}
    again = run(folder)
    assert {path: path.stat().st_mtime_ns for path in (folder / "rows").iterdir()} == written
    assert first == again
    return first


def test_takeovers_are_tabled_by_way_and_budget(tmp_path, monkeypatch):
    ways = ("cloning", "hg-dagger", "corrections", "intervention-weighted")
    trial = takeovers.TakeoverTrial("Small", EMPTY, 3, (8, 24), ways, "remembered", most_steps=20, fitting="updates=2")
    monkeypatch.setitem(takeovers.TAKEOVER_TRIALS, "Small", trial)
    table = twice(lambda out: run_takeovers(out, ["Small"], 1, workers=1, command="it", episodes=3), tmp_path)
    rows = json.loads((tmp_path / "takeovers.json").read_text())["rows"]
    assert [(row["arm"], row["budget"]) for row in rows] == [(way, budget) for way in ways for budget in (8, 24)]
    assert {row["success"] for row in rows if row["budget"] == 8} == {rows[0]["success"]}  # the same demonstrations
    assert "| hg-dagger |" in table
    assert (tmp_path / "takeovers.png").stat().st_size > 0


def test_ratings_are_tabled_with_the_delay_that_was_found(tmp_path, monkeypatch):
    trial = feedback.RatedTrial("Small", EMPTY, most_steps=20, marks=(0.4,))
    monkeypatch.setitem(feedback.RATED, "Small", trial)
    table = twice(lambda out: run_ratings(out, ["Small"], 1, workers=1, command="it", episodes=3), tmp_path)
    assert "| Small | tamer | 0.4 |" in table
    assert "of 600 ms" in table


def test_comparisons_are_tabled_beside_the_true_reward(tmp_path, monkeypatch):
    trial = feedback.ComparedTrial(
        "Small",
        EMPTY,
        3,
        steps=3,
        most_steps=20,
        rounds=(5, 5),
        shown=40,
        held_out=10,
        settings=PreferenceSettings(steps=64, n_steps=64, n_epochs=1),
        fitting=RewardFitting(members=2, updates=2),
    )
    monkeypatch.setitem(feedback.COMPARED, "Small", trial)
    table = twice(
        lambda out: run_comparisons(out, ["Small"], ["disputed"], 1, workers=1, command="it", episodes=3), tmp_path
    )
    assert "| Small | disputed | 1 | 5 |" in table
    assert "| Small | disputed | 1 | 10 |" in table


def test_what_a_minute_teaches_is_tabled_by_way(tmp_path, monkeypatch):
    trial = minutes.MinutesTrial("Small", EMPTY, 3, most_steps=20, marks=(0.3, 0.6))
    monkeypatch.setitem(minutes.MINUTES_TRIALS, "Small", trial)
    monkeypatch.setattr(minutes, "SHOWN_STEPS", 40)
    monkeypatch.setattr(minutes, "FITTING", "updates=2")
    monkeypatch.setattr(minutes, "REWARD", RewardFitting(members=2, updates=2))
    monkeypatch.setattr(minutes, "PREFERENCES", PreferenceSettings(steps=64, n_steps=64, n_epochs=1))
    table = twice(lambda out: run_minutes(out, ["Small"], 1, workers=1, command="it", episodes=3), tmp_path)
    rows = json.loads((tmp_path / "minutes.json").read_text())["rows"]
    assert [(row["way"], row["minutes"]) for row in rows] == [
        (way, mark) for way in minutes.WAYS for mark in (0.3, 0.6)
    ]
    given = {way: [row["given"] for row in rows if row["way"] == way] for way in minutes.WAYS}
    assert all(0 < early <= late for early, late in given.values()), given
    assert "| way to teach | 0.3 min | 0.6 min | given |" in table
