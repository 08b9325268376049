import os
import sys

import pytest

from minihuman.runtime.watch.running_sessions import IdleWorker


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no idle class")
def test_work_gives_way_until_it_comes_too_late_and_again_after_a_while():
    now_s = [100.0]
    aside = IdleWorker(clock=lambda: now_s[0])

    def gave_way(takes_s: float = 0.0) -> bool:
        now_s[0] += takes_s
        return os.sched_getscheduler(0) == os.SCHED_IDLE

    assert aside(gave_way)
    assert aside(lambda: gave_way(0.6))
    assert not aside(lambda: gave_way(29.0))
    now_s[0] += 2.0
    assert aside(gave_way)
    assert os.sched_getscheduler(0) != os.SCHED_IDLE


def test_what_the_work_raises_reaches_who_asked():
    def fail() -> None:
        raise LookupError("gone")

    with pytest.raises(LookupError, match="gone"):
        IdleWorker()(fail)
