import os
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from minihuman.operating_system import LOWER_PRIORITY, count_processes
from minihuman.runtime.watch.running_sessions import LowPriorityWorker


def niceness_of_this_thread() -> int:
    return os.getpriority(os.PRIO_PROCESS, threading.get_native_id())


@contextmanager
def busy_cores() -> Iterator[None]:
    programs = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(2 * count_processes())]
    try:
        yield
    finally:
        for program in programs:
            program.kill()
            program.wait()


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no priorities of threads")
def test_work_gives_way_to_the_callers_thread():
    work = LowPriorityWorker()
    before = niceness_of_this_thread()
    assert work(niceness_of_this_thread) == min(before + LOWER_PRIORITY, 19)
    assert work(niceness_of_this_thread) == min(before + LOWER_PRIORITY, 19)
    assert niceness_of_this_thread() == before


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no priorities of threads")
def test_work_keeps_a_share_of_a_machine_whose_cores_are_all_busy():
    """A thread of the idle class had none, and the experimenter's page then waited for as long as two programs ran."""
    with busy_cores():
        assert LowPriorityWorker()(lambda: os.sched_getscheduler(0)) == os.SCHED_OTHER
        assert LowPriorityWorker()(lambda: sum(range(1_000_000))) == 499_999_500_000


def test_what_the_work_raises_reaches_who_asked():
    def fail() -> None:
        raise LookupError("gone")

    with pytest.raises(LookupError, match="gone"):
        LowPriorityWorker()(fail)
