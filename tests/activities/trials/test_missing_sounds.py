"""Sounds that were due and never began: their rows in the table of sounds."""

import numpy as np

from minihuman.admin.next_session import plan_next_session
from minihuman.admin.verify.log import find_log_differences
from minihuman.dataset.tables import select
from minihuman.display.windows.window import VirtualClock
from minihuman.experiment.machine.session import SessionMachine
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.runtime.devices.sound import SimulatedOutput
from minihuman.runtime.session_loop import run_session
from minihuman.runtime.simulated_session import simulate
from minihuman.runtime.simulated_window import SimulatedWindow
from minihuman.simulation.participant import make_participant
from minihuman.worlds.adapters.world import World
from tests.activities.trials.test_sounds import ROWS, TONE
from tests.activities.trials.test_timelines import decode
from tests.golden.sounds import build_sounds
from tests.recompute.tables import read_session, sound_rows

_FAILED = "select count(*) as failed from episodes where outcome = 'failure' and block = 'words'"


class DeafOutput(SimulatedOutput):
    """A device that never begins a tone of 1500 Hz or a feedback tone, as where it is interrupted."""

    def follow(self, cues):
        super().follow([cue for cue in cues if cue.content.hz not in (220, 1500)])


def test_a_sound_that_was_due_and_never_began_has_a_row_without_an_onset(tmp_path):
    plan = plan_next_session(build_sounds(), tmp_path, participant="sub-01", session=1)
    clock = VirtualClock()
    session = SessionMachine(plan, World, {"player": "random"}, picture_px=None)
    window = SimulatedWindow(make_participant("random", np.random.default_rng(5)), session, clock)
    path = run_session(session, window, McapRecorder(tmp_path, plan, started_ns=0), clock, sound=DeafOutput(clock))
    assert list(find_log_differences(path, World)) == []
    tables = select(tmp_path / "sounds")
    rows = tables.query("select * from trial_sounds").to_pylist()
    missing = [row for row in rows if row["onset_ns"] is None]
    assert {row["sound"] for row in missing} == {"tone", "feedback"}
    assert [row["episode"] for row in missing if row["sound"] == "tone"] == [11, 14]
    assert all(row["scheduled_ns"] is row["late_ms"] is row["uncertainty_ms"] is None for row in missing)
    [failed] = tables.query(
        "select count(*) as n from episodes where outcome = 'failure' and block = 'words'"
    ).to_pylist()
    assert len(missing) == 2 + failed["n"]
    assert [row["t_ns"] for row in rows] == sorted(row["t_ns"] for row in rows)
    assert {row["due_ns"] - row["t_ns"] for row in missing} == {0}
    expected = list(sound_rows(read_session([path])))
    assert [{name: row[name] for name in expected[0]} for row in rows] == expected


def test_a_sound_that_was_not_due_before_the_trial_was_over_has_no_row(tmp_path):
    timeline = TONE.replace('timeline.target = "tone"', 'timeline.target = "fixation"').replace("300", "450")
    [_] = simulate(decode(timeline, ROWS), tmp_path, participants=1, seed=1, player="human-like")
    tables = select(tmp_path / "trials")
    sounds = tables.query("select episode, onset_ns from trial_sounds").to_pylist()
    trials = tables.query("select episode, response_ms from trials").to_pylist()
    slow = [row["episode"] for row in trials if row["response_ms"] is None or row["response_ms"] > 450]
    assert 0 < len(slow) < len(trials)
    assert [row["episode"] for row in sounds if row["onset_ns"] is not None] == slow
    assert len(sounds) == len(slow)
