"""Virtual time: callbacks in order of their time, and an asyncio loop for what a server does. Nothing ever waits."""

import asyncio
import heapq
import random
from collections.abc import Callable
from itertools import count
from typing import Any

from minihuman.storage.system import SystemClock

STARTED_NS = 1_760_000_000_000_000_000
_JOB_S = 0.002  # a job on another thread, at most


class ProcessKilled(SystemExit):
    """The process is gone: nothing catches it, and an event loop lets it through."""


class Schedule:
    """The time of everything, and what happens when.

    Args:
        seed: of all that happens.
    """

    def __init__(self, seed: int) -> None:
        self.rng = random.Random(seed)
        self.now_ns = 0
        self.trace: list[str] = []
        self._due: list[tuple[int, int, Callable[[], None]]] = []
        self._order = count()

    @property
    def next_ns(self) -> int | None:
        """When the next callback is due."""
        return self._due[0][0] if self._due else None

    def after(self, delay_s: float, do: Callable[[], None]) -> None:
        """Call something later."""
        heapq.heappush(self._due, (self.now_ns + round(delay_s * 1e9), next(self._order), do))

    def run_next(self) -> None:
        """Go to the next callback's time and call it."""
        at_ns, _, do = heapq.heappop(self._due)
        self.now_ns = max(self.now_ns, at_ns)
        do()

    def note(self, what: str) -> None:
        """Write down what happened."""
        self.trace.append(f"{self.now_ns / 1e9:.6f} {what}")

    def chance(self, probability: float) -> bool:
        """Whether something happens."""
        return self.rng.random() < probability


class MachineClock(SystemClock):
    """A machine's clocks; its wall clock is set now and then.

    Args:
        schedule: the time.
    """

    def __init__(self, schedule: Schedule) -> None:
        self.schedule = schedule
        self.wall_offset_ns = STARTED_NS

    def wall_ns(self) -> int:
        """The wall clock."""
        return self.schedule.now_ns + self.wall_offset_ns

    def monotonic_ns(self) -> int:
        """The monotonic clock."""
        return self.schedule.now_ns

    def monotonic(self) -> float:
        """As the module ``time`` has it."""
        return self.schedule.now_ns / 1e9


class ServerLoop(asyncio.BaseEventLoop):
    """The event loop of one server process, run up to where it would wait.

    ``asyncio`` promises nothing of ``_selector``, ``_ready``, ``_process_events`` and ``_write_to_self``: without them
    it would be no loop at all, and no test of this folder would run.

    Args:
        schedule: the time.
    """

    def __init__(self, schedule: Schedule) -> None:
        super().__init__()
        self.schedule = schedule
        self.idle_until_ns: int | None = None
        self.turns_left: int | None = None  # the process is killed then, between two callbacks
        self.errors: list[str] = []
        self.is_abandoned = False  # its process was killed
        self._left: list[asyncio.Task[Any]] = []  # tasks of then: nothing of them runs, not even its end
        self._selector = self
        self.set_exception_handler(self._keep_error)

    def _keep_error(self, _: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
        if not isinstance(error := context.get("exception"), ProcessKilled) and not self.is_abandoned:
            self.errors.append(f"{context.get('message')}: {error!r}")

    def time(self) -> float:
        """The monotonic clock."""
        return self.schedule.now_ns / 1e9

    def select(self, timeout: float | None) -> list[Any]:
        """Stop where a loop would wait."""
        if self.turns_left is not None:
            self.turns_left -= 1
            if self.turns_left < 0:
                raise ProcessKilled
        if timeout is None or timeout > 0:
            self.idle_until_ns = None if timeout is None else self.schedule.now_ns + max(1, round(timeout * 1e9))
            self.stop()
        return []

    @property
    def has_work(self) -> bool:
        """Whether a callback can be called now."""
        ready: bool = bool(self._ready)  # type: ignore[attr-defined]
        return ready or (self.idle_until_ns is not None and self.idle_until_ns <= self.schedule.now_ns)

    def run_until_idle(self) -> None:
        """Do all that can be done now."""
        self.run_forever()

    def run_in_executor(self, executor: Any, func: Any, *args: Any) -> Any:
        """Do a thread's work in a moment, all at once."""
        future = self.create_future()

        def work() -> None:
            if future.cancelled():
                return
            try:
                future.set_result(func(*args))
            except Exception as error:
                future.set_exception(error)

        self.call_later(self.schedule.rng.random() * _JOB_S, work)
        return future

    def abandon(self) -> None:
        """Be killed: no task goes on."""
        self.is_abandoned, self.turns_left = True, None
        self._left = list(asyncio.all_tasks(self))
        for task in self._left:
            task._log_destroy_pending = False  # type: ignore[attr-defined]

    def _process_events(self, event_list: Any) -> None:
        pass

    def _write_to_self(self) -> None:
        pass
