"""Calls to the operating system that differ between Linux, macOS and Windows; no other module makes them.

Files opened here can be renamed and removed while they are open, as on POSIX systems and, on request, on Windows. A
lock is held by the kernel and ends with the process, however that ends. Linux is tested; Windows and macOS are only
type-checked.
"""

import contextlib
import ctypes
import errno
import os
import signal
import socket
import stat
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Any

from minihuman.errors import name_file_in_errors
from minihuman.moved import forward_names

if sys.platform == "win32":
    import _winapi
    import msvcrt
else:
    import fcntl
    import resource

MAX_PROCESSES = 61  # that one Windows process can wait for
LOWER_PRIORITY = 10  # what is added to the niceness of work that participants do not wait for
REPLACE_ATTEMPTS = 50  # a virus scanner or an indexer has let go of a file by then
REPLACE_INTERVAL_S = 0.1
_RESEND_DELAY_S = 0.1  # until SIGTERM is sent again after Python dropped the exception that it had raised
_SHARING_VIOLATIONS = frozenset({5, 32, 33})  # Windows: access denied, open elsewhere, locked elsewhere
_LOCK_OFFSET_HIGH = 0x4000_0000  # Windows locks bytes against reading: lock one that no file has


def is_sharing_violation(error: OSError) -> bool:
    """Return whether Windows refused a call because another program has the file open, so that a retry may succeed."""
    return getattr(error, "winerror", None) in _SHARING_VIOLATIONS


OWNER_ONLY_FOLDER = 0o700  # whatever the umask: only the owner may read what people did
OWNER_ONLY_FILE = 0o600


def make_private_folder(folder: Path, mode: int = OWNER_ONLY_FOLDER) -> None:
    """Create a folder and its missing parents, readable only by their owner; an existing folder is left unchanged.

    Args:
        folder: the folder.
        mode: the permissions of the new folders, if others may read them.

    Raises:
        OSError: if the folder cannot be created.
    """
    missing = []
    while not folder.is_dir():
        if folder.exists() and not folder.is_dir():  # asked in this order, as another process may make it meanwhile
            raise NotADirectoryError(errno.ENOTDIR, os.strerror(errno.ENOTDIR), os.fspath(folder))
        missing.append(folder)
        if folder.parent == folder:
            break
        folder = folder.parent
    for path in reversed(missing):
        path.mkdir(mode, exist_ok=True)


def keep_private(file: Path) -> None:
    """Restrict a file that a library created to its owner; nothing is done if the system does not allow it."""
    with contextlib.suppress(OSError):
        if stat.S_IMODE(os.stat(file).st_mode) != OWNER_ONLY_FILE:  # a chmod would look like a change to caches
            os.chmod(file, OWNER_ONLY_FILE)


def open_file(path: Path, flags: int, mode: int = 0o600) -> int:
    """Open a file in binary mode and return its descriptor.

    The flags and the mode are those of ``os.open``. Child processes do not inherit it, and the file can be renamed.

    Raises:
        OSError: as for ``os.open``.
    """
    if sys.platform == "win32":
        read_write = 0xC000_0000 if flags & (os.O_RDWR | os.O_WRONLY) else 0x8000_0000
        share_read_write_delete = 7
        normal = 0x80
        with name_file_in_errors(path):
            handle = _winapi.CreateFile(
                str(path), read_write, share_read_write_delete, 0, windows_disposition(flags), normal, 0
            )
        return msvcrt.open_osfhandle(handle, flags | os.O_BINARY | os.O_NOINHERIT)
    return os.open(path, flags | os.O_CLOEXEC, mode)


def windows_disposition(flags: int) -> int:
    """Return the creation disposition for Windows' CreateFile that corresponds to flags of ``os.open``."""
    create_new = 1
    create_always = 2
    open_existing = 3
    open_always = 4
    truncate_existing = 5
    if flags & os.O_CREAT:
        if flags & os.O_EXCL:
            return create_new
        if flags & os.O_TRUNC:
            return create_always
        return open_always
    if flags & os.O_TRUNC:
        return truncate_existing
    return open_existing


def open_without_waiting(path: Path) -> int:
    """Open a file for reading and return its descriptor; opening a pipe does not wait for its writer.

    Raises:
        OSError: as for ``os.open``.
    """
    if sys.platform == "win32":
        return open_file(path, os.O_RDONLY)
    return open_file(path, os.O_RDONLY | os.O_NONBLOCK)


def read_at(fd: int, count: int, offset: int) -> bytes:
    """Read up to ``count`` bytes at a byte offset, fewer at the end of the file, without moving the file's position.

    Raises:
        OSError: if the bytes cannot be read.
    """
    if sys.platform != "win32":
        return os.pread(fd, count, offset)
    with _SEEKING:
        previous_position = os.lseek(fd, 0, os.SEEK_CUR)
        try:
            os.lseek(fd, offset, os.SEEK_SET)
            return os.read(fd, count)
        finally:
            os.lseek(fd, previous_position, os.SEEK_SET)


_SEEKING = threading.Lock()


def lock_descriptor(fd: int, *, wait: bool = True) -> None:
    """Lock an open file exclusively against all other descriptors that request a lock.

    Raises:
        BlockingIOError: if another descriptor holds the lock, and ``wait`` is False.
        OSError: if the file system does not support locks.
    """
    if sys.platform == "win32":
        exclusive = 2
        at_once = 1
        lock_violation = 33
        flags = exclusive if wait else exclusive | at_once
        lock_file = ctypes.WinDLL("kernel32", use_last_error=True).LockFileEx
        lock_file.argtypes = [ctypes.c_void_p, *[ctypes.c_uint32] * 4, ctypes.c_void_p]
        overlapped = (ctypes.c_uint64 * 4)(0, 0, _LOCK_OFFSET_HIGH << 32)  # the third field is the offset
        if not lock_file(msvcrt.get_osfhandle(fd), flags, 0, 1, 0, overlapped):
            if ctypes.get_last_error() == lock_violation:
                raise BlockingIOError(f"descriptor {fd} is locked by another process")
            raise ctypes.WinError(ctypes.get_last_error())
    else:
        fcntl.flock(fd, fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB)


def sync_file(fd: int) -> None:
    """Make what was written to an open file durable; macOS needs a special call to flush the disk's cache.

    Raises:
        OSError: if it cannot be done.
    """
    if sys.platform == "darwin":
        try:
            fcntl.fcntl(fd, fcntl.F_FULLFSYNC)
            return
        except OSError:  # a network's file system has none
            pass
    os.fsync(fd)


def sync_folder(folder: Path) -> None:
    """Make a folder's entries durable: a new or renamed file is durable only when its folder is.

    Windows cannot do this for a folder, but its file system journals entries itself.

    Raises:
        OSError: if it cannot be done; the error names the folder.
    """
    if sys.platform == "win32":
        return
    with name_file_in_errors(folder):
        fd = os.open(folder, os.O_RDONLY)
        try:
            sync_file(fd)
        finally:
            os.close(fd)


def sync_file_system(fd: int) -> None:
    """Make everything durable on the file system that holds an open file.

    Raises:
        OSError: if something could not be written, or the system does not support the call.
    """
    if sys.platform == "win32":
        sync_function = None
    else:
        sync_function = getattr(ctypes.CDLL(None, use_errno=True), "syncfs", None)
    if sync_function is None:
        raise OSError("this operating system does not support syncfs")
    if sync_function(fd):
        error_number = ctypes.get_errno()
        raise OSError(error_number, os.strerror(error_number))


def is_owned_by_user(status: os.stat_result) -> bool:
    """Return whether this process's user owns a file; always True on Windows, where files have no user id."""
    return sys.platform == "win32" or status.st_uid == os.geteuid()


def replace_file(source: Path, target: Path) -> None:
    """Rename ``source`` to ``target`` in one step, replacing the file there; on Windows, even while that file is open.

    Raises:
        OSError: as for ``os.replace``.
    """
    retry_when_shared(lambda: _replace_open_file(source, target))


def remove_file(path: Path, *, missing_ok: bool = False) -> None:
    """Remove a file, retrying on Windows while another program reads it; ``missing_ok`` is that of ``Path.unlink``.

    Raises:
        OSError: as for ``os.unlink``.
    """
    retry_when_shared(lambda: path.unlink(missing_ok=missing_ok))


def retry_when_shared(call: Callable[[], object], *, interval_s: float = REPLACE_INTERVAL_S) -> None:
    """Make a call, and repeat it while Windows refuses it because another program has the file open.

    Raises:
        OSError: immediately for any other error; for a refusal, after ``REPLACE_ATTEMPTS`` attempts.
    """
    for _ in range(REPLACE_ATTEMPTS - 1):
        try:
            call()
            return
        except OSError as error:
            if not is_sharing_violation(error):
                raise
        time.sleep(interval_s)
    call()


def _replace_open_file(source: Path, target: Path) -> None:
    """Rename ``source`` to ``target``, replacing the file ``target``.

    Windows refuses to replace a file that is open, so a rename with POSIX semantics is tried first there.
    """
    if sys.platform == "win32":
        delete_and_synchronize = 0x0011_0000
        share_all = 7
        open_existing = 3
        normal = 0x80
        rename_info_ex = 22
        replace_and_posix = 3
        name = str(target.absolute()).encode("utf-16-le")
        handle = _winapi.CreateFile(str(source), delete_and_synchronize, share_all, 0, open_existing, normal, 0)
        try:  # FILE_RENAME_INFO: flags, a folder's handle, the name's length, the name
            info = b"".join((replace_and_posix.to_bytes(8, "little"), bytes(8), len(name).to_bytes(4, "little"), name))
            set_file_information = ctypes.WinDLL("kernel32").SetFileInformationByHandle
            set_file_information.argtypes = [ctypes.c_void_p, ctypes.c_int, ctypes.c_char_p, ctypes.c_uint32]
            if set_file_information(handle, rename_info_ex, info, len(info)):
                return
        finally:
            _winapi.CloseHandle(handle)
    os.replace(source, target)


def claim_address(listener: socket.socket) -> None:
    """Let a server reuse its port immediately after it ended, and prevent a second server from sharing it."""
    if sys.platform == "win32":  # there SO_REUSEADDR would let two servers share a port
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_EXCLUSIVEADDRUSE, 1)
    else:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)


def raise_file_limit(needed: int) -> int:
    """Raise this process's limit on open files and sockets to ``needed``, as far as the system's hard limit allows.

    Returns:
        The resulting limit; ``needed`` if the system sets no limit.
    """
    if sys.platform == "win32":  # there is none for sockets
        return needed
    else:
        soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
        if soft == resource.RLIM_INFINITY:
            return needed
        if soft >= needed:
            return soft
        allowed = needed
        if hard != resource.RLIM_INFINITY:
            allowed = min(needed, hard)
        resource.setrlimit(resource.RLIMIT_NOFILE, (allowed, hard))
        return allowed


def count_processes() -> int:
    """Return how many processes to run in parallel: one per CPU core, at most ``MAX_PROCESSES``."""
    return min(os.cpu_count() or 1, MAX_PROCESSES)


def lower_process_priority() -> None:
    """Lower this process's priority below the user's other processes."""
    if sys.platform == "win32":
        below_normal = 0x4000
        kernel = ctypes.WinDLL("kernel32")
        kernel.SetPriorityClass.argtypes = [ctypes.c_void_p, ctypes.c_uint32]
        kernel.SetPriorityClass(_winapi.GetCurrentProcess(), below_normal)
    else:
        os.nice(LOWER_PRIORITY)


def lower_thread_priority() -> None:
    """Lower this thread's priority below the user's other threads; only Linux has priorities of threads."""
    if sys.platform == "linux":
        os.nice(LOWER_PRIORITY)  # which Linux changes for the calling thread alone


@contextlib.contextmanager
def keep_scheduling() -> Iterator[None]:
    """Undo the real-time priority that a library gives to its caller or its own threads in the enclosed code.

    The AV1 encoder does so if root starts it, as in a container; it would then slow everything else on the machine.
    """
    if sys.platform != "linux":
        yield
        return
    policy = os.sched_getscheduler(0)
    parameter = os.sched_getparam(0)
    try:
        yield
    finally:
        if policy not in (os.SCHED_FIFO, os.SCHED_RR):
            for thread in map(int, os.listdir("/proc/self/task")):
                with contextlib.suppress(ProcessLookupError):
                    if os.sched_getscheduler(thread) in (os.SCHED_FIFO, os.SCHED_RR):
                        os.sched_setscheduler(thread, policy, parameter)


def limit_memory(share: float) -> None:
    """Limit this process to a share (0 to 1) of the machine's memory, and let it be killed first if memory is short.

    Only Linux does both. macOS may refuse the limit, and Windows has no limit for a process that already runs.
    """
    if sys.platform != "win32":
        limit_memory_bytes(int(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") * share))


def limit_memory_bytes(limit: int) -> None:
    """Limit this process to ``limit`` bytes of memory, on the same systems as ``limit_memory``."""
    if sys.platform != "win32":
        with contextlib.suppress(OSError):
            Path("/proc/self/oom_score_adj").write_text("1000", encoding="ascii", newline="\n")
        with contextlib.suppress(OSError, ValueError):
            resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))


def measure_own_use() -> tuple[float, int]:
    """Return the CPU time in seconds and the peak memory in bytes that this process has used.

    The memory is 0 on Windows, where it cannot be measured.
    """
    if sys.platform != "win32":
        usage = resource.getrusage(resource.RUSAGE_SELF)
        bytes_per_unit = 1 if sys.platform == "darwin" else 1024  # the unit of ru_maxrss
        return usage.ru_utime + usage.ru_stime, usage.ru_maxrss * bytes_per_unit
    return time.process_time(), 0


def ignore_termination() -> None:
    """Ignore SIGTERM in this process and in the processes that it starts."""
    signal.signal(signal.SIGTERM, signal.SIG_IGN)


def outlive_termination() -> None:
    """Ignore SIGTERM in this process, but not in the programs that it starts, which inherit no handlers."""
    signal.signal(signal.SIGTERM, lambda *_: None)


def name_signal(number: int) -> str:
    """Return a signal's name, e.g. "SIGKILL", or "signal 99" if no signal has that number."""
    with contextlib.suppress(ValueError):
        return signal.Signals(number).name
    return f"signal {number}"


def lead_own_group() -> None:
    """Make this process lead a new process group, which Ctrl-C in the terminal does not reach; not on Windows."""
    if sys.platform != "win32":
        os.setsid()


def end_group(pid: int) -> None:
    """Kill the process group that a process leads; do nothing if there is no such group, or on Windows."""
    if sys.platform != "win32":
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(pid, signal.SIGKILL)


def end_with_parent() -> None:
    """Make the system kill this process as soon as its parent ends; only Linux supports this."""
    if sys.platform == "linux":
        pr_set_pdeathsig = 1
        ctypes.CDLL(None).prctl(pr_set_pdeathsig, signal.SIGKILL)


@contextlib.contextmanager
def receive_end_signals(remember: Callable[[str], None]) -> Iterator[None]:
    """Call ``remember`` with the name of each signal that asks the program to end, instead of ending the program.

    The signals are SIGINT (Ctrl-C), SIGTERM, and SIGHUP (or SIGBREAK on Windows) when the terminal is closed. Only
    the main thread receives signals; in another thread, nothing changes.
    """

    def receive(number: int, _: FrameType | None) -> None:
        remember(signal.Signals(number).name)

    if threading.current_thread() is not threading.main_thread():
        yield
        return
    previous_handlers: dict[int, Any] = {number: signal.signal(number, receive) for number in _END_SIGNALS}
    try:
        yield
    finally:
        for number, handler in previous_handlers.items():
            signal.signal(number, handler)


if sys.platform == "win32":
    _END_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGBREAK)
else:
    _END_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@contextlib.contextmanager
def interrupt_after(limit_s: float) -> Iterator[None]:
    """Interrupt the enclosed Python code if it takes longer than ``limit_s`` seconds.

    This works only in the main thread and on systems with interval timers; Windows has none, so there is no limit.

    Raises:
        TimeoutError: in the enclosed code, if it takes longer.
    """
    if sys.platform == "win32" or threading.current_thread() is not threading.main_thread():
        yield
        return

    def expire(_number: int, _frame: FrameType | None) -> None:
        raise TimeoutError(f"no answer within {limit_s:g} s")

    previous_handler = signal.signal(signal.SIGALRM, expire)
    signal.setitimer(signal.ITIMER_REAL, limit_s)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, previous_handler)


def exit_when_terminated() -> None:
    """Turn SIGTERM into SystemExit, so that ``finally`` blocks run.

    Python drops exceptions raised in a finalizer or a weak reference's callback; then the signal is sent again.
    """
    report_unraisable = sys.unraisablehook

    def exit_program(*_: object) -> None:
        raise SystemExit(0)

    def resend_if_dropped(dropped: "sys.UnraisableHookArgs") -> None:
        if dropped.exc_type is SystemExit:
            threading.Timer(_RESEND_DELAY_S, os.kill, (os.getpid(), signal.SIGTERM)).start()
        else:
            report_unraisable(dropped)

    sys.unraisablehook = resend_if_dropped
    signal.signal(signal.SIGTERM, exit_program)


if not TYPE_CHECKING:
    __getattr__ = forward_names(__name__)
