"""Was it a person? The evidence in a log's key times, the facts beside it, and the reviewer's decision."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner, Result

from minihuman import simulate
from minihuman.cli.command_line import make_command_line
from minihuman.dataset.selection import SelectedSession
from minihuman.experiment.machine.events import Noted, TextChanged, TextTyped
from minihuman.experiment.replay import BROWSER_NOTE
from minihuman.log.model.session_log import SessionLog
from minihuman.log.read.session_reader import read_log
from minihuman.reporting.bots import (
    BINS,
    BOUND,
    MEASURES,
    PressTimes,
    find_same_times,
    load_model,
    measure_key_times,
    place_in_bin,
    weigh_measures,
    weigh_sessions,
)

STUDY = """
[study]
name = "online"
version = "1"
seed = 3
participants = 9
closing = ""
[keys]
keyboard_check = false
pool = ["1", "2", "3", "4"]
[[groups]]
name = "all"
blocks = ["rooms"]
[[blocks]]
name = "rooms"
world = "minihuman/MiniGrid-FourRooms-v0"
actions = ["left", "right", "forward"]
episodes = 4
max_steps = 60
"""


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated person, and the planner, whose times are constant."""
    data = tmp_path_factory.mktemp("data")
    (data / "online.toml").write_text(STUDY)
    for player in ("human-like", "optimal"):
        list(simulate(data / "online.toml", participants=1, data=data, player=player))
    return data / "online"


@pytest.fixture(scope="module")
def logs(study: Path) -> list[SessionLog]:
    return [read_log(path) for path in sorted(study.rglob("*.mcap"))]


def weigh(*logs: SessionLog, typing: bool = False) -> list[tuple[bool, tuple[str, ...]]]:
    sessions = [SelectedSession(log, (), (), ()) for log in logs]
    return [(one.flagged, one.facts) for one in weigh_sessions(sessions, typing=typing)]


def run(*arguments: object) -> Result:
    result = CliRunner().invoke(make_command_line(), [str(argument) for argument in arguments])
    assert result.exit_code == 0, result.output
    return result


def test_constant_times_are_flagged_a_simulated_person_is_not_and_a_decision_is_shown(study: Path) -> None:
    result = run("bots", study)
    first, second, *why = result.stdout.splitlines()
    assert first.startswith("sub-01 session 1: -  person : program = ")
    assert second == "sub-02 session 1: FLAGGED  person : program = 1 : 1e+03"
    assert {reason.split(":")[0].strip() for reason in why[:3]} < {words for words, _, _ in MEASURES.values()}
    assert "not calibrated on people" in result.stderr
    log = study / "sub-02" / "ses-01" / "sub-02_ses-01.mcap"
    assert str(log) in why[-1]
    run("annotate", log, "--tag", "exclude", "--note", "a program")
    found = [json.loads(line) for line in run("bots", study, "--json").stdout.splitlines()]
    assert [(one["flagged"], one["decision"]) for one in found] == [(False, ""), (True, "exclude")]
    assert found[1]["log10_ratio"] == -BOUND


def test_facts_flag_by_themselves(logs: list[SessionLog]) -> None:
    person = logs[0]
    (segment,) = person.segments
    middle_ns = person.episodes[1].t_ns[0]
    scripted = Noted(1, BROWSER_NOTE, "key 1 down at 1 ns was made by a script")
    away = (Noted(middle_ns, "focus", "lost"), Noted(person.episodes[2].t_ns[0], "focus", "found"))
    typed = (TextTyped(1, "x" * 60),)

    def change(**changes: object) -> SessionLog:
        return replace(person, segments=(replace(segment, **changes),))

    assert weigh(person) == [(False, ())]
    assert weigh(change(notes=(scripted,))) == [(True, ("1 key events were made by a script (isTrusted)",))]
    blind = sum(key.down and away[0].t_ns < key.t_ns <= away[1].t_ns for key in person.keys)
    assert weigh(change(notes=away)) == [(True, (f"{blind} keys were pressed while the page had no focus",))]
    assert weigh(change(part_events=typed)) == [(False, ())]
    assert weigh(change(part_events=typed), typing=True)[0][0]
    for keys, is_flagged in ((60, False), (3, True)):
        changed = (TextChanged(1, 0, "why", "x" * 60, ("typed",), keys),)
        assert weigh(change(part_events=changed), typing=True)[0][0] == is_flagged


def test_a_session_with_the_times_of_another_names_it(logs: list[SessionLog]) -> None:
    person, program = logs
    copied = weigh(person, program, person)
    assert copied[1][1] == ()
    assert copied[0][1] == copied[2][1] == ("5 times in a row within 2 ms of those of sub-01 session 1",)


def make_times(intervals_ms: np.ndarray, same: np.ndarray) -> PressTimes:
    return PressTimes(intervals_ms, same, intervals_ms[:6] + 400, np.full(len(intervals_ms), 90.0), 0.0)


def test_each_measure_is_what_its_words_say() -> None:
    rng = np.random.default_rng(1)
    same = rng.random(400) < 0.5
    slow = np.convolve(rng.normal(0, 0.3, 409), np.ones(10) / 10**0.5, "valid")
    times = make_times(np.exp(slow) * np.where(same, 150.0, 300.0) * np.linspace(1.3, 0.8, 400), same)
    found = measure_key_times(times)
    assert found["median"] == pytest.approx(np.log10(np.median(times.intervals_ms)))
    assert found["repetition"] == pytest.approx(np.log10(0.5), abs=0.05)
    ordered = pd.Series(times.intervals_ms).corr(pd.Series(range(400)), method="spearman")
    assert found["practice"] == pytest.approx(ordered)
    assert found["autocorrelation"] > 0.6
    assert measure_key_times(make_times(rng.permutation(times.intervals_ms), same))["autocorrelation"] < 0.3
    assert found["hold_spread"] == -3.0
    assert found["first"] == pytest.approx(np.log10(np.median(times.firsts_ms) / np.median(times.intervals_ms)))
    assert measure_key_times(make_times(times.intervals_ms[:19], same[:19])) == {}
    assert find_same_times([times, make_times(times.intervals_ms[::-1], same)]) == {}


def test_the_model_gives_probabilities_and_a_measure_that_is_missing_weighs_nothing() -> None:
    model = load_model()
    for kinds in (model["people"], model["programs"]):
        assert sum(one["weight"] for one in kinds) == pytest.approx(1, abs=1e-3)
        for one in kinds:
            assert one["log10"].keys() == MEASURES.keys()
            assert all(sum(10 ** np.array(bins)) == pytest.approx(1, abs=0.01) for bins in one["log10"].values())
    _, shares = weigh_measures({"median": 2.5, "spread": np.nan}, model)
    assert shares.keys() == {"median"}
    assert [place_in_bin("overlap", value) for value in (-9.0, 9.0)] == [0, BINS - 1]
