"""Processes that each run one world, and a pool of them, on the host's side.

A process is reused for the same world only, so that what a world leaves behind, such as the state of global random
generators, cannot affect another world. A process that failed is ended.
"""

import atexit
import multiprocessing
import sys
import threading
from collections import deque
from dataclasses import dataclass
from multiprocessing.context import BaseContext
from multiprocessing.shared_memory import SharedMemory
from typing import Any, Final, TypeVar

import msgspec

from minihuman.operating_system import end_group, name_signal
from minihuman.worlds.adapters.foreign_code import RemoteCodeError
from minihuman.worlds.isolation import messages
from minihuman.worlds.isolation.child import run_child

T = TypeVar("T")
MIB: Final = 2**20
_END_S = 5.0  # the longest wait for a process to end


@dataclass(frozen=True, slots=True)
class WorldLimits:
    """The time and memory that a world may use before its session ends."""

    step_s: float = 5.0  # a step, a picture, a copy
    construction_s: float = 60.0  # its construction, and each reset
    memory_mib: int = 4096


DEFAULT_LIMITS: Final = WorldLimits()


@dataclass(slots=True)
class WorldUse:
    """The resources that world processes have used so far."""

    worlds: int = 0
    cpu_s: float = 0.0
    peak_bytes: int = 0  # the most memory that one of them used

    def add(self, cpu_s: float, peak_bytes: int) -> None:
        """Add the resources of a world that has been closed."""
        self.worlds += 1
        self.cpu_s += cpu_s
        self.peak_bytes = max(self.peak_bytes, peak_bytes)

    def __str__(self) -> str:
        if not self.worlds:
            return ""
        if self.peak_bytes:
            memory = f", {self.peak_bytes / MIB:.0f} MiB of memory at most"
        else:
            memory = ""
        return (
            f"worlds in processes of their own: {self.worlds}, each with {self.cpu_s / self.worlds:.1f} s of CPU time "
            f"on average{memory}"
        )


class WorldProcess:
    """A process that runs one world at a time."""

    def __init__(self, limits: WorldLimits) -> None:
        self.limits = limits
        self.ran = ""  # the id of the world that it ran last; "" for none
        self.is_running = False  # whether a world is open
        self.cpu_before_s = 0.0  # CPU time that it had used when the world was opened
        self.is_healthy = True
        self.reply = messages.Reply(b"")  # the latest reply
        self.memory: SharedMemory | None = None  # for pictures
        self._lock = threading.RLock()  # held during a request, while another thread may end the process
        context = _get_context()
        self._connection, other_end = context.Pipe()
        # Not a daemon: worlds may start processes themselves. The pool ends it.
        self._process = context.Process(
            target=run_child, args=(other_end, limits.memory_mib * MIB), name="minihuman-world"
        )
        self._process.start()
        other_end.close()

    @property
    def pid(self) -> int:
        """Return the id of the process."""
        pid: int = self._process.pid
        return pid

    def ask(self, request: messages.AnyRequest, answer: type[T], *, world_id: str, call: str, limit_s: float) -> T:
        """Send a request and return the answer.

        Args:
            request: the request to send
            answer: the type of the answer
            world_id: the world's id, for errors
            call: the call that the request runs, such as "step()", for errors
            limit_s: the time limit in seconds

        Raises:
            RemoteCodeError: if the world fails, takes longer than the limit, or ends its process.
        """
        with self._lock:
            return self._ask(request, answer, world_id=world_id, call=call, limit_s=limit_s)

    def _ask(self, request: messages.AnyRequest, answer: type[T], *, world_id: str, call: str, limit_s: float) -> T:
        """Send a request and return the answer; end the process if it takes too long."""
        if not self.is_healthy:
            raise RemoteCodeError(f"{world_id}: its process has ended, so that {call} cannot run")
        try:
            self._connection.send_bytes(msgspec.msgpack.encode(request))
            if not self._connection.poll(limit_s):
                self.end()
                raise RemoteCodeError(f"{world_id}: {call} took more than {limit_s:g} s, so its process was ended")
            self.reply = msgspec.msgpack.decode(self._connection.recv_bytes(), type=messages.Reply)
        except (EOFError, OSError):
            raise RemoteCodeError(f"{world_id}: {self._clean_up_and_describe(call)}") from None
        if self.reply.error:
            raise RemoteCodeError(self.reply.error, self.reply.cause)
        return msgspec.msgpack.decode(self.reply.answer, type=answer)

    def _clean_up_and_describe(self, call: str) -> str:
        """Clean up after a process that a call has ended, and return an error text that says how it ended."""
        self.is_healthy = False
        self._process.join(_END_S)
        status = self._process.exitcode
        self.end()
        if status is None or status >= 0:
            return f"{call} ended its process with status {status}; end the episode instead"
        return f"{call} ended its process by {name_signal(-status)}, as a fault in compiled code does"

    def reserve_memory(self, size_bytes: int) -> None:
        """Replace the memory that is shared with the process by one of another size."""
        self._release_memory()
        self.memory = SharedMemory(None, True, size_bytes)  # new memory, whose name the system chooses

    def _release_memory(self) -> None:
        if self.memory is not None:
            self.memory.close()
            self.memory.unlink()
            self.memory = None

    def end(self) -> None:
        """End the process, and the processes that it started."""
        self.is_healthy = False
        end_group(self.pid)
        self._process.kill()
        with self._lock:
            self._process.join(_END_S)
            self._connection.close()
            self._release_memory()


class WorldProcessPool:
    """A pool of processes for worlds.

    Args:
        limits: the limits of each world
        idle: the largest number of processes without a world that are kept
    """

    def __init__(self, limits: WorldLimits = DEFAULT_LIMITS, *, idle: int = 4) -> None:
        self.limits = limits
        self.use = WorldUse()
        self._most_idle = idle
        self._idle: deque[WorldProcess] = deque()
        self._all: set[WorldProcess] = set()
        self._lock = threading.Lock()  # sessions run in several threads
        atexit.register(self.close)  # runs before multiprocessing waits for the processes

    def take(self, world_id: str) -> WorldProcess:
        """Return a process for a world, which then counts as running: one that ran the world before, or a new one."""
        with self._lock:
            for process in self._idle:
                if process.ran == world_id:
                    self._idle.remove(process)
                    process.is_running = True
                    process.cpu_before_s = process.reply.cpu_s
                    return process
        process = WorldProcess(self.limits)
        process.ran = world_id
        process.is_running = True
        with self._lock:
            self._all.add(process)
        return process

    def give_back(self, process: WorldProcess) -> None:
        """Give a process whose world is closed, or that has failed, back to the pool.

        A failed process is ended, as is the one that is idle for longest if there are too many.
        """
        surplus = process
        with self._lock:
            process.is_running = False
            self.use.add(process.reply.cpu_s - process.cpu_before_s, process.reply.peak_bytes)
            if process.is_healthy:
                self._idle.append(process)
                if len(self._idle) <= self._most_idle:
                    return
                surplus = self._idle.popleft()  # the one that is idle for longest
            self._all.discard(surplus)
        surplus.end()

    def close(self) -> None:
        """End all processes."""
        atexit.unregister(self.close)
        with self._lock:
            processes = list(self._all)
            self._all.clear()
            self._idle.clear()
        for process in processes:
            if process.is_running:  # a session that is left has not closed its world
                self.use.add(process.reply.cpu_s - process.cpu_before_s, process.reply.peak_bytes)
            process.end()


def _get_context() -> Any:
    """Return the multiprocessing context: a fork server that has loaded this package, if the system supports it."""
    if sys.platform == "win32":
        return multiprocessing.get_context("spawn")
    context: BaseContext = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["minihuman.worlds.isolation.fork_server"])
    return context
