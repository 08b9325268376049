"""Power cuts: whenever the recording process dies, every acknowledged step is in the log that is recovered."""

import time
from pathlib import Path

import numpy as np
import pytest

from minihuman.log.finish import leftovers, recover
from minihuman.log.read import open_log, read_events
from minihuman.log.verify import verify
from minihuman.study.events import Stepped
from tests.counts import count
from tests.log.played import played_events
from tests.log.samples import session_plan
from tests.log.station import play_and_tell, stations

LONGEST_S = 0.5  # about how long the session and its finishing take


@pytest.mark.long
def test_kill_9_at_a_random_moment_loses_no_acknowledged_step(tmp_path: Path) -> None:
    plan = session_plan(episodes=2)
    events = played_events(plan, steps=20)
    rng = np.random.default_rng(9)
    cut_off = 0
    for trial in range(count(6, 100)):
        data = tmp_path / str(trial)
        acknowledged = _kill_after(rng.uniform(0, LONGEST_S), data, plan, events)
        parts = leftovers(data)
        for part in parts:
            finished = recover(part)
            assert not (finished.readable and finished.stopped) or finished.stopped.startswith("cut off"), finished
        logs = list(data.rglob("*.mcap"))
        if not logs:  # killed before the plan was on the disk
            assert acknowledged == 0
            continue
        log = open_log(logs[0])
        kept = list(read_events(logs[0]))
        assert kept == events[: len(kept)]
        assert sum(isinstance(event, Stepped) for event in kept) >= acknowledged
        assert verify(log).difference == ""
        assert log.clean == (not parts)
        cut_off += log.end_reason == "cut_off"
    assert cut_off > 0, "no trial was cut off in mid-session; the moments are badly chosen"


def _kill_after(delay_s: float, data: Path, plan: object, events: object) -> int:
    context = stations()
    told, tell = context.Pipe(duplex=False)
    process = context.Process(target=play_and_tell, args=(data, plan, events, tell, 0.001))
    process.start()
    tell.close()
    acknowledged = 0
    if told.poll(60):
        deadline = time.monotonic() + delay_s
        while told.poll(max(0.0, deadline - time.monotonic())):
            try:
                acknowledged = told.recv()
            except EOFError:
                break
    process.kill()
    process.join()
    while told.poll():
        try:
            acknowledged = told.recv()
        except EOFError:
            break
    return acknowledged
