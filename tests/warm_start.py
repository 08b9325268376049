"""Starts `minihuman` from a process that has imported what serving needs: nearly all that a server's start costs.

A program that is started so is a process like any other: a child of the process that runs tests, with an environment, a
working directory and streams of its own; it can be stopped and killed. Where a test changes how Python itself starts,
it starts anew, as do the programs of the tests of the command line, of stations and of desks.

Run as a script, this is the process that has imported it, and forks whenever it is asked to.
"""

import atexit
import gc
import importlib
import json
import os
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import IO

_IMPORTED = (
    "minihuman.cli",
    "minihuman.admin.legibility",
    "minihuman.admin.protocol_file",
    "minihuman.experiment.plan.dry_run",
    "minihuman.web.server.process",
    "minihuman.worlds.grid.env",
)
_READ_AT_START = ("PYTHON", "NUMBA", "COVERAGE", "MINIHUMAN_KERNELS", "LD_", "LC_", "LANG")  # variables' names
_STARTS_ANEW = {"COVERAGE_PROCESS_START", "PYTHONSAFEPATH"}  # under these every program does
_MOST_BYTES = 1 << 17  # of a request


class WarmProgram:
    """A started program, as far as tests use `subprocess.Popen`."""

    def __init__(self, pid: int, stdout: IO[str]) -> None:
        self.pid = pid
        self.stdout = stdout
        self.returncode: int | None = None

    def poll(self) -> int | None:
        """Return its exit status, None while it runs."""
        if self.returncode is None:
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            self.returncode = os.waitstatus_to_exitcode(status) if pid else None
        return self.returncode

    def wait(self, timeout: float | None = None) -> int:
        """Wait until it has ended, and return its exit status."""
        while self.poll() is None:
            ending = os.pidfd_open(self.pid)
            try:
                ended, _, _ = select.select([ending], [], [], timeout)
            finally:
                os.close(ending)
            if not ended:
                raise subprocess.TimeoutExpired("minihuman", timeout or 0.0)
        assert self.returncode is not None
        return self.returncode

    def send_signal(self, number: int) -> None:
        """Send it a signal, unless it has ended."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def terminate(self) -> None:
        """Ask it to end."""
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        """End it at once."""
        self.send_signal(signal.SIGKILL)

    def __enter__(self) -> "WarmProgram":
        return self

    def __exit__(self, *_: object) -> None:
        self.stdout.close()
        self.wait()


class _WarmProcess:
    """The process that has imported it, of this one; it ends with it."""

    def __init__(self) -> None:
        from tests import processes  # not in the programs that are forked: it imports pytest

        processes.adopt_descendants()  # as pytest's processes do; programs outside of tests start servers, too
        self._one_at_a_time = threading.Lock()
        self._line, other_end = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        command = [sys.executable, "-m", __name__, str(other_end.fileno())]
        with other_end, processes.kept_for_the_run():
            self._process = subprocess.Popen(command, cwd=Path(__file__).parents[1], pass_fds=[other_end.fileno()])
        atexit.register(self._end)

    def _end(self) -> None:
        self._line.close()  # on which it ends
        self._process.wait()

    def start(self, arguments: tuple[str, ...], errors: int) -> WarmProgram:
        """Start a program with these arguments and this standard error."""
        request = {"arguments": arguments, "folder": os.getcwd(), "environment": dict(os.environ)}
        reading, writing = os.pipe()
        with self._one_at_a_time:
            socket.send_fds(self._line, [json.dumps(request).encode()], [writing, errors])
            os.close(writing)
            answer = self._line.recv(_MOST_BYTES)
        return WarmProgram(int(answer), os.fdopen(reading))


_WARM: list[_WarmProcess] = []  # of this process: one, once it was asked for


def start_program(*arguments: str, stderr: IO[str] | None = None) -> "subprocess.Popen[str] | WarmProgram":
    """Start `minihuman` with these arguments; its standard output is a pipe."""
    is_changed = _choose_start_variables(os.environ) != _START_VARIABLES or _STARTS_ANEW & os.environ.keys()
    if sys.platform == "linux" and not is_changed:
        if not _WARM:
            _WARM.append(_WarmProcess())
        return _WARM[0].start(arguments, 2 if stderr is None else stderr.fileno())
    command = [sys.executable, "-m", "minihuman", *arguments]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=stderr, text=True)


def _choose_start_variables(environment: Mapping[str, str]) -> dict[str, str]:
    return {name: text for name, text in environment.items() if name.startswith(_READ_AT_START)}


_START_VARIABLES = _choose_start_variables(os.environ)  # before any test


def fork_on_request(line: socket.socket) -> None:
    """Start a process for each request, and return in it, with the arguments and the streams that were asked for.

    It is forked twice, so that it becomes the child of the process that runs tests, which adopts what others leave.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # a terminal sends it to this process, too
    while True:
        content, descriptors, _, _ = socket.recv_fds(line, _MOST_BYTES, 2)
        if not content:  # the process that runs tests has ended
            os._exit(0)
        parent = os.fork()
        if parent == 0:
            break
        os.waitpid(parent, 0)
        for descriptor in descriptors:
            os.close(descriptor)
    parent = os.getpid()
    if os.fork() != 0:
        os._exit(0)
    while os.getppid() == parent:
        time.sleep(0.0005)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    _become(json.loads(content), descriptors)
    line.send(str(os.getpid()).encode())
    line.close()


def _become(request: dict[str, object], descriptors: list[int]) -> None:
    """Take on the arguments, the environment, the working directory and the streams of a request."""
    for stream, descriptor in enumerate(descriptors, start=1):
        os.dup2(descriptor, stream)
        os.close(descriptor)
    environment = request["environment"]
    assert isinstance(environment, dict)
    os.environ.clear()
    os.environ.update(environment)
    os.chdir(str(request["folder"]))
    arguments = request["arguments"]
    assert isinstance(arguments, list)
    sys.argv = ["minihuman", *arguments]
    sys.modules["__main__"].__spec__ = find_spec("minihuman.__main__")  # by which processes that it spawns begin


if __name__ == "__main__":
    for module in _IMPORTED:
        importlib.import_module(module)
    gc.freeze()
    fork_on_request(socket.socket(fileno=int(sys.argv[1])))
    importlib.import_module("minihuman.cli").main()
