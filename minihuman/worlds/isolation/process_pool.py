"""Processes that each run one world, and a pool of them; the host's side. Knows no session.

A process that has answered is used again, for the same world alone: what a world leaves in a process, as in the global
random generators, reaches no other world. A process that failed is ended.
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
_END_S = 5.0  # that a process may take to be gone


@dataclass(frozen=True, slots=True)
class WorldLimits:
    """What a world may take before its session ends."""

    step_s: float = 5.0  # a step, a picture, a copy
    construction_s: float = 60.0  # its construction, and each reset
    memory_mib: int = 4096


DEFAULT_LIMITS: Final = WorldLimits()


@dataclass(slots=True)
class WorldUse:
    """What processes of worlds have used so far."""

    worlds: int = 0
    cpu_s: float = 0.0
    peak_bytes: int = 0  # the most that one of them had

    def add(self, cpu_s: float, peak_bytes: int) -> None:
        """Count a world whose process is done with it."""
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
        self.ran = ""  # the world that it ran last; "" for none
        self.is_running = False  # a world is open
        self.cpu_before_s = 0.0  # what it had used when the world was opened
        self.is_healthy = True
        self.reply = messages.Reply(b"")  # the latest
        self.memory: SharedMemory | None = None  # for pictures
        self._lock = threading.RLock()  # held while an answer is waited for; the pool may end the process meanwhile
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
        """Return the process's number."""
        pid: int = self._process.pid
        return pid

    def ask(self, request: messages.AnyRequest, answer: type[T], *, world_id: str, call: str, limit_s: float) -> T:
        """Request something and wait for the answer.

        Args:
            request: the request.
            answer: the type of the answer.
            world_id: for errors.
            call: what runs there, for errors: "step()".
            limit_s: how long it may take.

        Raises:
            RemoteCodeError: if the world fails, takes longer, or ends its process.
        """
        with self._lock:
            return self._ask(request, answer, world_id=world_id, call=call, limit_s=limit_s)

    def _ask(self, request: messages.AnyRequest, answer: type[T], *, world_id: str, call: str, limit_s: float) -> T:
        if not self.is_healthy:
            raise RemoteCodeError(f"{world_id}: its process has ended, so that {call} cannot run")
        try:
            self._connection.send_bytes(msgspec.msgpack.encode(request))
            if not self._connection.poll(limit_s):
                self.end()
                raise RemoteCodeError(f"{world_id}: {call} took more than {limit_s:g} s, so its process was ended")
            self.reply = msgspec.msgpack.decode(self._connection.recv_bytes(), type=messages.Reply)
        except (EOFError, OSError):
            raise RemoteCodeError(f"{world_id}: {self._describe_end(call)}") from None
        if self.reply.error:
            raise RemoteCodeError(self.reply.error, self.reply.cause)
        return msgspec.msgpack.decode(self.reply.answer, type=answer)

    def _describe_end(self, call: str) -> str:
        self.is_healthy = False
        self._process.join(_END_S)
        status = self._process.exitcode
        self.end()
        if status is None or status >= 0:
            return f"{call} ended its process with status {status}; end the episode instead"
        return f"{call} ended its process by {name_signal(-status)}, as a fault in compiled code does"

    def reserve_memory(self, size: int) -> None:
        """Share so much memory with the process from now on."""
        self._release_memory()
        self.memory = SharedMemory(None, True, size)

    def _release_memory(self) -> None:
        if self.memory is not None:
            self.memory.close()
            self.memory.unlink()
            self.memory = None

    def end(self) -> None:
        """End the process, and those that it started."""
        self.is_healthy = False
        end_group(self.pid)
        self._process.kill()
        with self._lock:
            self._process.join(_END_S)
            self._connection.close()
            self._release_memory()


class WorldProcessPool:
    """Processes for worlds.

    Args:
        limits: of each world.
        idle: how many processes without a world are kept at most.
    """

    def __init__(self, limits: WorldLimits = DEFAULT_LIMITS, *, idle: int = 4) -> None:
        self.limits = limits
        self.use = WorldUse()
        self._most_idle = idle
        self._idle: deque[WorldProcess] = deque()
        self._all: set[WorldProcess] = set()
        self._lock = threading.Lock()  # sessions run in several threads
        atexit.register(self.close)  # before multiprocessing would wait for them

    def take(self, world_id: str) -> WorldProcess:
        """Take a process for a world: one that ran it before, or a new one."""
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
        """Give a process back whose world is closed, or that has failed."""
        surplus = process
        with self._lock:
            process.is_running = False
            self.use.add(process.reply.cpu_s - process.cpu_before_s, process.reply.peak_bytes)
            if process.is_healthy:
                self._idle.append(process)
                if len(self._idle) <= self._most_idle:
                    return
                surplus = self._idle.popleft()  # the longest idle
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
    """Return what starts processes: forks of a process that has loaded this package, where the system has that."""
    if sys.platform == "win32":
        return multiprocessing.get_context("spawn")
    context: BaseContext = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["minihuman.worlds.isolation.fork_server"])
    return context
