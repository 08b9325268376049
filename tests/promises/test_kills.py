"""What was shown survives a kill, whatever the disk does; a recovery that is killed loses nothing either."""

import time
from multiprocessing.context import ForkServerContext
from pathlib import Path

import numpy as np
import pytest

from minihuman.lab.proofs import proofs
from minihuman.log.read.open_log import read_events
from minihuman.log.record.finish import leftovers, recover
from minihuman.study.events import Stepped
from tests.counts import count
from tests.lab.station import stations
from tests.promises import station
from tests.promises.sessions import TOML

pytestmark = [pytest.mark.long, pytest.mark.program]

LONG_PLAY = TOML.format(episodes=200, steps=100).replace("[keys]", "[keys]\ncheck = false").encode()


@pytest.mark.parametrize(
    ("kills", "key_s", "fsync_s", "longest_s"),
    [(count(3, 300), 0.004, 0.0, 0.9), (count(2, 40), 0.1, 2.0, 3.0)],
    ids=["4 ms a key", "fsync of 2 s"],
)
def test_kill_9_loses_no_shown_step(tmp_path: Path, kills: int, key_s: float, fsync_s: float, longest_s: float) -> None:
    context = stations()
    context.set_forkserver_preload(["tests.lab.station", station.__name__])
    rng = np.random.default_rng(3)
    seen = kept = durable = recoveries = cut = 0
    for trial in range(kills):
        data = tmp_path / str(trial)
        shown, acknowledged = _killed(context, data, key_s, fsync_s, float(rng.uniform(0.05, longest_s)))
        recoveries += _recovered(context, data, rng)
        logs = list(data.rglob("*.mcap"))
        if not logs:  # killed before the plan was written, when nothing had been shown
            assert shown == 0
            continue
        (log,) = logs
        steps = sum(isinstance(event, Stepped) for event in read_events(log))
        assert steps >= shown >= acknowledged
        assert [line for line, fine in proofs(log) if not fine] == []
        seen, kept, durable, cut = seen + shown, kept + steps, durable + acknowledged, cut + (shown > 0)
    print(
        f"\n{kills} kills ({cut} in play) and {recoveries} of recoveries, fsync {fsync_s} s more: "
        f"0 of {seen} shown steps lost, 0 of {durable} acknowledged ones; {kept} kept"
    )
    assert seen > 0


def _killed(context: ForkServerContext, data: Path, key_s: float, fsync_s: float, after_s: float) -> tuple[int, int]:
    """Let somebody play for a while, then kill; how many steps were shown by then, and acknowledged."""
    told, tell = context.Pipe(duplex=False)
    process = context.Process(target=station.play, args=(LONG_PLAY, data, tell, key_s, fsync_s))
    process.start()
    tell.close()
    last = told.recv()  # the first screen
    while after_s > 0.1 and not last[0] and told.poll(60):  # a few are killed before anything is played
        last = told.recv()
    until_s = time.monotonic() + after_s
    while (left_s := until_s - time.monotonic()) > 0 and told.poll(left_s):
        last = told.recv()
    process.kill()
    process.join()
    try:
        while True:
            last = told.recv()
    except EOFError:
        return last


def _recovered(context: ForkServerContext, data: Path, rng: np.random.Generator) -> int:
    """Recover what was left, killing the first recovery at some moment; how many were."""
    killed = 0
    for part in leftovers(data):
        process = context.Process(target=station.finish, args=(part,))
        process.start()
        time.sleep(float(rng.uniform(0, 0.06)))
        process.kill()
        process.join()
        killed += 1
    for part in leftovers(data):
        recover(part)
    return killed
