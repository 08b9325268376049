"""A disk that fails at any place: safe steps stay, and what is said is one sentence that names the file."""

import errno
import os
import random
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

from minihuman.errors import MinihumanError
from minihuman.experiment.machine.events import Stepped
from minihuman.log.read.session_reader import read_events
from minihuman.log.record.disk import RecorderSettings
from minihuman.log.record.finalization import find_leftovers, recover_log
from minihuman.log.record.mcap_recorder import McapRecorder
from tests.counts import count
from tests.log.samples import STARTED_NS, session_events, session_plan

PLAN = session_plan(episodes=2)
EVENTS = session_events(PLAN, steps=6)
ERRORS = (errno.ENOSPC, errno.EIO, errno.EDQUOT, errno.EROFS)


class Failing:
    """A system call that fails from its nth time on, or once; before that it may take only a part."""

    def __init__(self, call: Callable[..., Any], code: int, at: int, *, once: bool, short: bool = False) -> None:
        self._call, self._code, self._at, self._once, self._short = call, code, at, once, short
        self.count = 0

    def __call__(self, *given: Any, **named: Any) -> Any:
        self.count += 1
        if self.count == self._at or (self.count > self._at and not self._once):
            raise OSError(self._code, os.strerror(self._code))
        if self._short and isinstance(given[-1], memoryview):
            return self._call(*given[:-1], given[-1][: max(1, len(given[-1]) // 3)])
        return self._call(*given, **named)


@pytest.mark.nightly(sample=True)
def test_no_fault_of_the_disk_loses_a_safe_step_or_says_more_than_a_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = random.Random(7)
    met = safe = 0
    for trial in range(count(30, 200)):
        data = tmp_path / str(trial)
        call = rng.choice(["put", "put", "sync", "os.fsync", "os.replace", "os.open", "fcntl.flock"])
        code = errno.ENOLCK if call == "fcntl.flock" else errno.EMFILE if call == "os.open" else rng.choice(ERRORS)
        at = rng.randint(1, 60 if call in ("put", "sync") else 6)
        durable, failed = _recorded(data, monkeypatch, call, code, at, once=rng.random() < 0.5, rng=rng)
        monkeypatch.undo()
        met += failed
        for part in find_leftovers(data):
            recover_log(part)  # the fault is over
        kept = [event for log in data.rglob("*.mcap") for event in read_events(log)]
        assert [event for event in EVENTS if event in kept] == kept
        assert sum(isinstance(event, Stepped) for event in kept) >= durable
        safe += durable
    print(f"\n{met} faults met: 0 of {safe} safe steps lost")
    assert met > count(30, 200) / 4


def _recorded(
    data: Path, monkeypatch: pytest.MonkeyPatch, call: str, code: int, at: int, *, once: bool, rng: random.Random
) -> tuple[int, bool]:
    """Record a session on such a disk: how many steps were safe, and whether it was told of the fault."""
    hooks: dict[str, Any] = {}
    if call == "put":
        hooks["put"] = Failing(os.write, code, at, once=once, short=rng.random() < 0.5)
    elif call == "sync":
        hooks["sync"] = Failing(os.fsync, code, at, once=once)
    else:
        module, _, name = call.partition(".")
        real = getattr(__import__(module), name)
        monkeypatch.setattr(call, Failing(real, code, at, once=once))
    recorder: McapRecorder | None = None
    told: Exception | None = None
    try:
        recorder = McapRecorder(data, PLAN, started_ns=STARTED_NS, settings=RecorderSettings(**hooks))
        for event in EVENTS:
            recorder.write([event])
            if rng.random() < 0.3:
                recorder.drain()
        recorder.close()
    except (MinihumanError, OSError) as error:
        told = error
    if recorder is not None and told is not None:
        with suppress(MinihumanError):
            recorder.close()
    if isinstance(told, OSError):
        assert told.filename is not None, "the command line names the file"
    elif told is not None:
        assert "\n" not in str(told)
        assert str(data) in str(told), "it names the file"
    return (recorder.durable_steps if recorder else 0), told is not None
