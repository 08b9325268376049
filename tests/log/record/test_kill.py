"""Power cuts: whenever the recording process dies, every acknowledged step is in the log that is recovered."""

import contextlib
import time
from pathlib import Path

import numpy as np
import pytest

from minihuman.admin.verify.episodes import verify_episodes
from minihuman.experiment.machine.events import Event, Stepped
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.log.read.session_reader import read_events, read_log
from minihuman.log.record.finalization import find_leftovers, recover_log
from tests.counts import count
from tests.lab.station import play_and_tell, stations
from tests.log.played import played_events
from tests.log.samples import session_plan

PAUSE_S = 0.002  # between events: a hurried participant, of whom the disk is often a step or two behind


@pytest.mark.nightly(sample=True)
def test_kill_9_at_a_random_moment_loses_no_acknowledged_step(tmp_path: Path) -> None:
    plan = session_plan(episodes=2)
    events = played_events(plan, steps=20)
    rng = np.random.default_rng(9)
    cut_off = 0  # with a step in it, but before its end
    for trial in range(count(4, 100)):
        data = tmp_path / str(trial)
        acknowledged = _kill_at(rng.uniform(0, 1.2), data, plan, events)
        finished_itself = any(data.rglob("*.mcap"))  # at most the removal of its live file was left to do
        for part in find_leftovers(data):
            finished = recover_log(part)
            assert not (finished.readable and finished.damage) or finished.damage.startswith("cut off"), finished
        logs = list(data.rglob("*.mcap"))
        if not logs:  # killed before the plan was on the disk
            assert acknowledged == 0
            continue
        log = read_log(logs[0])
        kept = list(read_events(logs[0]))
        assert kept == events[: len(kept)]
        assert sum(isinstance(event, Stepped) for event in kept) >= acknowledged
        assert verify_episodes(log).difference == ""
        assert log.clean == finished_itself
        cut_off += log.end_reason == "cut_off" and acknowledged > 0
    assert cut_off > count(4, 100) / 3, "too few were cut off in mid-session; the moments are badly chosen"


def _kill_at(moment: float, data: Path, plan: SessionPlan, events: list[Event]) -> int:
    """Kill a recording process ``moment`` of its way through the events; beyond 1 it is finishing. Say what it told."""
    context = stations()
    told, tell = context.Pipe(duplex=False)
    process = context.Process(target=play_and_tell, args=(data, plan, events, tell, PAUSE_S))
    process.start()
    tell.close()
    acknowledged = 0
    written = min(int(moment * len(events)), len(events))
    with contextlib.suppress(EOFError):
        for _ in range(written):
            acknowledged = told.recv()
        time.sleep((moment * len(events) - written) * PAUSE_S)
        process.kill()
        while True:
            acknowledged = told.recv()
    process.join()
    return acknowledged
