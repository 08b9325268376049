"""The server's processes: the server itself on a local port, its further workers, and the dashboard.

The server prints its links and runs until it is stopped. Each worker hosts sessions of its own.
"""

import gc
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

import uvicorn
from starlette.types import ASGIApp

from minihuman.admin.local_copies import obey_withdrawals
from minihuman.errors import LogError, MinihumanError, ProtocolError
from minihuman.experiment.machine.activity import find_kind
from minihuman.experiment.protocol.protocol import Protocol
from minihuman.log.record.session_leases import SessionLeases
from minihuman.operating_system import claim_address, exit_when_terminated, make_private_folder, raise_file_limit
from minihuman.storage.lease import open_lease_table
from minihuman.storage.remote_store import RemoteStoreError
from minihuman.web.arrival_signature import read_arrival_key
from minihuman.web.arrivals import Arrivals, build_link, build_platform_link
from minihuman.web.message_codec import MAX_MESSAGE_BYTES
from minihuman.web.server.app import WebServer
from minihuman.web.server.request_timeout import ACCEPTED_AT_ONCE, QueueingServer, TimedHttpProtocol
from minihuman.web.traffic_limits import count_handles
from minihuman.worlds.isolation.isolated_world import IsolatedWorlds
from minihuman.worlds.isolation.process_pool import WorldLimits

HOST = "127.0.0.1"
_WAITING = 1024  # connections that the system keeps until they are accepted


class ServeError(MinihumanError, OSError):
    """The server cannot run."""


def require_browser_support(protocol: Protocol) -> None:
    """Refuse a study with a part that cannot be shown in a browser.

    Raises:
        ProtocolError: if the study has such a part.
    """
    kinds = [(block.name, block.kind) for block in protocol.blocks]
    kinds += [(activity.name, activity.kind) for activity in protocol.activities]
    for name, kind in kinds:
        if not find_kind(kind).browser:
            raise ProtocolError(
                f"part {name!r} is of kind {kind!r}, which cannot be shown in a browser; use `minihuman run`"
            )


def open_listening_socket(port: int, host: str = HOST) -> socket.socket:
    """Open a listening socket on a port of a local address, the loopback by default; port 0 selects a free port.

    Raises:
        ServeError: if the port is taken.
    """
    listening_socket = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    claim_address(listening_socket)
    try:
        listening_socket.bind((host, port))
    except OSError as error:
        listening_socket.close()
        raise ServeError(
            f"port {port} of {host} is not available ({error.strerror}); choose another with --port"
        ) from error
    listening_socket.listen(_WAITING)  # early connections wait until the server is ready
    return listening_socket


def _require_handles(max_sessions: int) -> None:
    """Raise this process's limit of open files to what a server of ``max_sessions`` concurrent sessions needs.

    Raises:
        ServeError: if the system allows too few.
    """
    needed = count_handles(max_sessions)
    allowed = raise_file_limit(needed)
    if allowed < needed:
        raise ServeError(
            f"max_concurrent_sessions is {max_sessions}, for which a server needs {needed} open files and sockets, but "
            f"the system's hard limit is {allowed}; raise it (LimitNOFILE of a systemd unit, `ulimit -Hn`) or lower "
            "max_concurrent_sessions"
        )


def run_server(
    protocol: Protocol,
    data: Path,
    listening_socket: socket.socket,
    *,
    links: int,
    say: Callable[[str], None],
    address: str = "",
    worlds: IsolatedWorlds | None = None,
) -> None:
    """Serve a study until SIGTERM or Ctrl-C. Unfinished sessions can be resumed by the next server.

    Args:
        protocol: the study.
        data: the folder that contains the studies' folders.
        listening_socket: the socket on which to serve.
        links: the number of new links to create.
        say: receives each link, and other lines for the user.
        address: the public base URL for links; "" for this machine's address.
        worlds: runs foreign worlds in processes of their own, and is left open; None to run all worlds in this process.

    Raises:
        ArrivalKeyError: if the study requires signed arrivals and there is no key.
        ServeError: if the system allows this process too few open files for the study's sessions.
    """
    _require_handles(protocol.web.max_concurrent_sessions)
    try:
        obey_withdrawals(data / protocol.study.name, ask_store=True, say=say)
    except RemoteStoreError as error:  # people can take part all the same; `gather` asks again
        say(str(error))
    arrivals = _open_arrivals(protocol, data)
    if address:
        address = f"{address.rstrip('/')}/"
    else:
        address = f"http://{HOST}:{listening_socket.getsockname()[1]}/"
    _issue_links(arrivals, links, address, say)
    _run_until_stopped(WebServer(arrivals, data, worlds=worlds), listening_socket)


def _open_arrivals(protocol: Protocol, data: Path) -> Arrivals:
    """Return the arrivals of a study, with session leases if its journals are in a database.

    Raises:
        ArrivalKeyError: if the study requires signed arrivals and there is no key.
    """
    table = open_lease_table(data / protocol.study.name)
    arrival_key = b""
    if protocol.web.require_signed_arrival:
        arrival_key = read_arrival_key()
    leases = None
    if table is not None:
        leases = SessionLeases(table)
    return Arrivals(protocol, data, leases, arrival_key=arrival_key)


def _run_until_stopped(server: WebServer, listening_socket: socket.socket) -> None:
    """Run a server until SIGTERM or Ctrl-C. Garbage collection ignores the objects that were loaded before.

    A full collection looks at 95,000 of them, and keeps all pages waiting for tens of milliseconds.
    """
    gc.collect()
    gc.freeze()
    with suppress(KeyboardInterrupt):  # uvicorn has shut down, and raises the signal again
        QueueingServer(_configure(server.app())).run(sockets=[listening_socket])


def _configure(app: ASGIApp) -> uvicorn.Config:
    """Return uvicorn's configuration for a study's application."""
    return uvicorn.Config(
        app,
        http=TimedHttpProtocol,
        ws="websockets-sansio",
        ws_max_size=MAX_MESSAGE_BYTES,
        ws_ping_interval=20.0,
        ws_per_message_deflate=False,
        backlog=ACCEPTED_AT_ONCE,
        access_log=False,  # addresses are personal data
        log_level="warning",
        timeout_graceful_shutdown=2,
    )


def _issue_links(arrivals: Arrivals, count: int, address: str, say: Callable[[str], None]) -> None:
    """Issue ``count`` links and pass them to ``say``, or the address itself if 0; then pass each platform's link."""
    for token in arrivals.recruits.issue(count):
        say(build_link(address, token))
    if not count:
        say(address)
    for platform in arrivals.protocol.web.recruitment_platforms:
        say(f"for {platform}: {build_platform_link(platform, address)}")


_STOP_TIMEOUT_S = 30.0  # for a worker to make its logs durable
_RESTART_DELAY_S = 1.0  # before a process that died is started again


def list_process_commands(
    protocol: Path,
    study_dir: Path,
    *,
    port: int,
    workers: int,
    watch: bool,
    host: str = HOST,
    options: Sequence[str] = (),
) -> Iterator[tuple[str, ...]]:
    """Yield the arguments of each process that runs in addition to the first worker: dashboard and further workers.

    The ``workers`` include the first one, whose port is ``port``; the ports of the others follow it. They listen at
    ``host`` and get ``options``. If ``watch``, there is a dashboard, and the study's folder is created if necessary.

    Raises:
        LogError: if there are several workers and ``port`` is 0.
    """
    if watch:
        make_private_folder(study_dir)
        yield "watch", str(study_dir)
    if workers > 1 and not port:
        raise LogError("--port is 0, but several workers need consecutive ports; set the first port with --port")
    for number in range(1, workers):
        data = str(study_dir.parent)
        yield (
            "serve",
            str(protocol),
            "--data",
            data,
            "--port",
            str(port + number),
            "--links",
            "0",
            "--host",
            host,
            *options,
        )


def list_limit_options(limits: WorldLimits) -> tuple[str, ...]:
    """Return the options of `minihuman serve` that set the limits of worlds in processes of their own."""
    times = ("--world-step-timeout", f"{limits.step_s:g}", "--world-start-timeout", f"{limits.construction_s:g}")
    return (*times, "--world-memory", str(limits.memory_mib))


@contextmanager
def keep_processes_running(commands: Iterable[Sequence[str]]) -> Iterator[None]:
    """Run `minihuman` with each list of arguments while the context lasts, and restart a process that dies.

    The processes end with this process, also on SIGTERM.
    """
    exit_when_terminated()
    processes = [_KeptProcess(words) for words in commands]
    try:
        yield
    finally:
        for process in processes:
            process.stop()


class _KeptProcess:
    """A process that a thread restarts whenever it ends, until it is stopped."""

    def __init__(self, words: Sequence[str]) -> None:
        self._command = [sys.executable, "-m", "minihuman", *words]
        self._stopped = threading.Event()
        self._starting = threading.Lock()  # held while the process is restarted or stopped
        self._process = self._start()
        self._thread = threading.Thread(target=self._keep, name=f"minihuman-{words[0]}", daemon=True)
        self._thread.start()

    def _start(self) -> subprocess.Popen[bytes]:
        return subprocess.Popen(self._command, stdin=subprocess.DEVNULL)

    def _keep(self) -> None:
        while not self._stopped.is_set():
            self._process.wait()
            self._stopped.wait(_RESTART_DELAY_S)
            with self._starting:
                if not self._stopped.is_set():
                    self._process = self._start()

    def stop(self) -> None:
        with self._starting:
            self._stopped.set()
        self._process.terminate()
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(_STOP_TIMEOUT_S)
        self._process.kill()
        self._thread.join()
