"""A recording station as a process of its own, to be killed, starved of disk or raced. Run by a fork server."""

import multiprocessing
import os
import resource
import signal
import time
from collections.abc import Sequence
from multiprocessing.connection import Connection
from multiprocessing.context import ForkServerContext
from multiprocessing.synchronize import Barrier
from pathlib import Path

from minihuman.errors import LogError
from minihuman.experiment.machine.events import Event
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.log.record.mcap_recorder import McapRecorder
from tests.counts import PATIENCE_S
from tests.log.samples import STARTED_NS


def stations() -> ForkServerContext:
    """Processes that start with this module loaded, and nothing of the test's own state."""
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([__name__])
    return context


def play_and_tell(data: Path, plan: SessionPlan, events: Sequence[Event], told: Connection, pause_s: float) -> None:
    """Write events one by one, telling after each how many steps are durable; then close.

    The start is given time, as a participant who reads the first screen gives it.
    """
    recorder = McapRecorder(data, plan, started_ns=STARTED_NS)
    recorder.write(events[:1])
    recorder.drain()
    told.send(recorder.durable_steps)
    for event in events[1:]:
        recorder.write([event])
        time.sleep(pause_s)
        told.send(recorder.durable_steps)
    recorder.close()


def play_until_full(
    data: Path, plan: SessionPlan, events: Sequence[Event], told: Connection, file_bytes: int | None
) -> None:
    """Write events until the recorder refuses, no file growing past ``file_bytes``; tell what it said and kept."""
    if file_bytes is not None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)  # then the write fails instead, as on a full disk
        resource.setrlimit(resource.RLIMIT_FSIZE, (file_bytes, file_bytes))
    recorder = McapRecorder(data, plan, started_ns=STARTED_NS)
    said = []
    for event in events:
        try:
            recorder.write([event])
            recorder.drain()
        except LogError as error:
            said.append(str(error))
            break
    try:
        recorder.close()
    except LogError as error:
        said.append(str(error))
    told.send((said, recorder.durable_steps))


def try_to_record(data: Path, plan: SessionPlan, events: Sequence[Event], told: Connection, ready: Barrier) -> None:
    """Together with others, try to record the same session; tell the error or where the log is."""
    ready.wait(timeout=PATIENCE_S)
    try:
        recorder = McapRecorder(data, plan, started_ns=STARTED_NS + os.getpid())
        recorder.write(events)
        told.send(("log", str(recorder.close())))
    except LogError as error:
        told.send(("error", str(error)))
