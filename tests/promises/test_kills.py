"""What was shown survives a kill, whatever the disk does; a recovery that is killed loses nothing either."""

import time
from contextlib import closing
from multiprocessing.connection import Connection
from multiprocessing.context import ForkServerContext
from multiprocessing.process import BaseProcess
from pathlib import Path

import numpy as np
import pytest

from minihuman.admin.verify.log import verify_session
from minihuman.experiment.machine.events import Stepped
from minihuman.log.read.session_reader import read_events
from minihuman.log.record.finalization import find_leftovers, recover_log
from tests.counts import PATIENCE_S, count
from tests.lab.station import stations
from tests.promises import station
from tests.promises.sessions import TOML
from tests.xserver import Typist

pytestmark = [pytest.mark.nightly(sample=True), pytest.mark.program]

LONG_PLAY = TOML.format(episodes=200, steps=100).replace("[keys]", "[keys]\nkeyboard_check = false").encode()


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
        assert [line for line, fine in verify_session(log) if not fine] == []
        seen, kept, durable, cut = seen + shown, kept + steps, durable + acknowledged, cut + (shown > 0)
    print(
        f"\n{kills} kills ({cut} in play) and {recoveries} of recoveries, fsync {fsync_s} s more: "
        f"0 of {seen} shown steps lost, 0 of {durable} acknowledged ones; {kept} kept"
    )
    assert seen > 0


def test_kill_9_loses_no_step_that_a_window_showed(tmp_path: Path, display: str) -> None:
    context = stations()
    context.set_forkserver_preload(["tests.lab.station", station.__name__])
    rng = np.random.default_rng(4)
    kills = count(2, 60)
    seen = kept = durable = 0
    with closing(Typist(display)) as typist:
        for trial in range(kills):
            data = tmp_path / str(trial)
            told, tell = context.Pipe(duplex=False)
            process = context.Process(target=station.play_in_window, args=(LONG_PLAY, data, tell, display))
            process.start()
            tell.close()
            told.recv()  # the first screen
            last = _typed(typist, told, rng)
            shown, acknowledged = _ended(process, told, last)
            for part in find_leftovers(data):
                recover_log(part)
            (log,) = data.rglob("*.mcap")
            steps = sum(isinstance(event, Stepped) for event in read_events(log))
            assert steps >= shown >= acknowledged
            assert [line for line, fine in verify_session(log) if not fine] == []
            seen, kept, durable = seen + shown, kept + steps, durable + acknowledged
    print(f"\n{kills} kills through a window: 0 of {seen} shown steps lost, 0 of {durable} acknowledged; {kept} kept")
    assert seen > 0


def _typed(typist: Typist, told: Connection, rng: np.random.Generator) -> tuple[int, int]:
    """Roll over every key until a step was shown, and some time longer; what was told by then."""
    last, until_s, patient_s = (0, 0), None, time.monotonic() + PATIENCE_S
    while until_s is None or time.monotonic() < until_s:
        assert time.monotonic() < patient_s, "nothing that was typed made a step"
        typist.tap("enter", *rng.permutation(["1", "2", "3", "4", "q"]).tolist())
        time.sleep(0.03)  # a station that is slower than its keyboard only falls behind
        while told.poll():
            last = told.recv()
        if until_s is None and last[0]:
            until_s = time.monotonic() + float(rng.uniform(0, 0.9))
    return last


def _killed(context: ForkServerContext, data: Path, key_s: float, fsync_s: float, after_s: float) -> tuple[int, int]:
    """Let somebody play for a while, then kill; how many steps were shown by then, and acknowledged."""
    told, tell = context.Pipe(duplex=False)
    process = context.Process(target=station.play, args=(LONG_PLAY, data, tell, key_s, fsync_s))
    process.start()
    tell.close()
    last = told.recv()  # the first screen
    while after_s > 0.1 and not last[0] and told.poll(PATIENCE_S):  # a few are killed before anything is played
        last = told.recv()
    until_s = time.monotonic() + after_s
    while (left_s := until_s - time.monotonic()) > 0 and told.poll(left_s):
        last = told.recv()
    return _ended(process, told, last)


def _ended(process: BaseProcess, told: Connection, last: tuple[int, int]) -> tuple[int, int]:
    """Kill a station; the last that it told."""
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
    for part in find_leftovers(data):
        process = context.Process(target=station.finish, args=(part,))
        process.start()
        time.sleep(float(rng.uniform(0, 0.06)))
        process.kill()
        process.join()
        killed += 1
    for part in find_leftovers(data):
        recover_log(part)
    return killed
