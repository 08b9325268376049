"""Power cuts on a disk that keeps only what was fsynced: no acknowledged step is lost, however the rest is torn."""

import os
from pathlib import Path

import numpy as np
import pytest

from minihuman.experiment.machine.events import Stepped
from minihuman.log.read.session_reader import read_events
from minihuman.log.record.disk import RecorderSettings
from minihuman.log.record.finalization import recover_log
from minihuman.log.record.mcap_recorder import McapRecorder
from tests.counts import count
from tests.log.samples import STARTED_NS, session_events, session_plan

SECTOR_BYTES = 512


class Cache:
    """A disk's write cache: what is flushed stays; of the rest any sectors may, in any order."""

    def __init__(self, rng: np.random.Generator) -> None:
        self._rng = rng
        self._content = bytearray()
        self._flushed = 0

    def put(self, fd: int, data: memoryview) -> int:
        self._content += data
        return os.write(fd, data)

    def sync(self, fd: int) -> None:
        self._flushed = len(self._content)

    def after_a_cut(self) -> bytes:
        """What is on the disk when the power comes back: none, all or some of what was not flushed."""
        rest = self._content[self._flushed :]
        kept_bytes = int(self._rng.choice([0, len(rest), self._rng.integers(len(rest) + 1)]))
        torn = rest[:kept_bytes]
        for at in range(0, kept_bytes, SECTOR_BYTES):
            if self._rng.random() < 0.3:  # the file is that long already, its data are not there
                size = len(torn[at : at + SECTOR_BYTES])
                torn[at : at + SECTOR_BYTES] = bytes(size)
        return bytes(self._content[: self._flushed] + torn)


@pytest.mark.nightly(sample=True)
def test_a_power_cut_loses_no_acknowledged_step(tmp_path: Path) -> None:
    plan = session_plan(episodes=2)
    events = session_events(plan, steps=20)
    rng = np.random.default_rng(6)
    states, acknowledged, kept_steps = count(20, 300), 0, 0
    for trial in range(states):
        cache = Cache(rng)
        recorder = McapRecorder(
            tmp_path / str(trial),
            plan,
            started_ns=STARTED_NS,
            settings=RecorderSettings(sync=cache.sync, put=cache.put),
        )
        for event in events[: int(rng.integers(2, len(events)))]:
            recorder.write([event])
            if rng.random() < 0.2:
                recorder.drain()
        durable = recorder.durable_steps  # read first: what is acknowledged later is not asked for
        part = tmp_path / f"{trial}.mcap.part"
        part.write_bytes(cache.after_a_cut())
        recorder.close()
        finished = recover_log(part)
        kept = list(read_events(finished.path)) if finished.readable else []
        assert [event for event in events if event in kept] == kept
        steps = sum(isinstance(event, Stepped) for event in kept)
        assert steps >= durable, trial
        acknowledged, kept_steps = acknowledged + durable, kept_steps + steps
    print(f"\n{states} power cuts: 0 of {acknowledged} acknowledged steps lost, {kept_steps} kept")
