"""Windows and macOS: what differs stands in one module, and its rules hold as functions."""

import ast
import errno
import os
import socket
import subprocess
import sys
import time
from pathlib import Path

import msgspec
import pytest

import minihuman
from minihuman import operating_system
from minihuman.admin.enrolment_log import take_slot
from minihuman.errors import AllocationError, LogError
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.operating_system import (
    is_sharing_violation,
    lock_descriptor,
    open_file,
    read_at,
    replace_file,
    retry_when_shared,
    windows_disposition,
)
from minihuman.portable_names import explain_unportable_name, find_case_twin
from minihuman.storage.durable_files import write_atomically
from tests.counts import PATIENCE_S
from tests.disks import fill, small_disk
from tests.log.samples import STARTED_NS, session_plan
from tests.sources import parse_source

PACKAGE = Path(minihuman.__file__).parent
ONE_MODULE = PACKAGE / "operating_system.py"
SYSTEM_MODULES = frozenset(
    {"fcntl", "msvcrt", "signal", "resource", "pwd", "grp", "termios", "tty", "pty", "_winapi", "winreg"}
    | {"selectors", "portalocker", "psutil", "posix", "nt"}
)
SYSTEM_CALLS = frozenset(
    {"fork", "forkpty", "nice", "sysconf", "pread", "pwrite", "set_blocking", "killpg", "setsid", "getuid", "fsync"}
    | {"geteuid", "getlogin", "mkfifo", "sched_setscheduler", "replace", "rename", "O_NONBLOCK", "O_CLOEXEC", "open"}
    | {"O_BINARY", "uname", "kill", "statvfs", "posix_fadvise", "register_at_fork", "umask", "fchmod"}
)
CTYPES = {  # a library of C, each at home in one module
    "operating_system.py": "the kernel",
    "display/windows/keyboard.py": "X11",
    "display/windows/x11_input.py": "X11's input extension",
    "display/windows/pyglet_native.py": "OpenGL",
    "worlds/kernels.py": "the compiled kernels",
    "worlds/grid/own/library.py": "the compiled rules of a laboratory's worlds",
}


def parse_package() -> dict[str, ast.Module]:
    """Return every module of the package that is not generated, parsed, by its path."""
    return {
        path.relative_to(PACKAGE).as_posix(): parse_source(path)
        for path in PACKAGE.rglob("*.py")
        if not path.stem.endswith("_pb2")
    }


def parse_other_modules() -> dict[str, ast.Module]:
    """Return every module but the one of the operating system, parsed, by its path."""
    return {name: tree for name, tree in parse_package().items() if PACKAGE / name != ONE_MODULE}


def _imports(tree: ast.Module) -> set[str]:
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {one.name.partition(".")[0] for one in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module.partition(".")[0])
    return found


def _calls_of_os(tree: ast.Module) -> set[str]:
    return {
        node.attr
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "os"
    }


def test_calls_of_the_operating_system_stand_in_one_module():
    assert {"fcntl", "msvcrt", "signal", "resource"} <= _imports(parse_package()["operating_system.py"])
    assert {
        name: found for name, tree in parse_other_modules().items() if (found := _imports(tree) & SYSTEM_MODULES)
    } == {}
    calls = {
        name: found for name, tree in parse_other_modules().items() if (found := _calls_of_os(tree) & SYSTEM_CALLS)
    }
    assert {name: found for name, found in calls.items() if name not in EXCEPTIONS or found != EXCEPTIONS[name]} == {}


EXCEPTIONS = {
    "cli/__init__.py": {"open"},  # the null device
}


def test_a_library_of_c_is_called_in_one_module_each():
    assert {name for name, tree in parse_package().items() if "ctypes" in _imports(tree)} == CTYPES.keys()


_OF_LINUX = ("/proc/", "/sys/")


def test_no_path_of_linux_stands_elsewhere():
    texts = {
        name: [
            node.value
            for node in ast.walk(tree)
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and node.value.startswith(_OF_LINUX)
        ]
        for name, tree in parse_other_modules().items()
    }
    assert {name: found for name, found in texts.items() if found} == {}


def test_every_text_file_says_its_encoding_and_every_written_one_its_newline():
    """Windows would take its code page, and write CRLF, so that a digest differs from one system to the next."""
    wrong = []
    for name, tree in parse_package().items():
        for node in ast.walk(tree):
            if isinstance(node, ast.Call) and (missing := _missing_of_text(node)):
                wrong.append(f"{name}:{node.lineno} lacks {missing}")
    assert wrong == []


def _missing_of_text(call: ast.Call) -> str:
    named = {keyword.arg for keyword in call.keywords}
    if isinstance(call.func, ast.Attribute) and call.func.attr in ("read_text", "write_text"):
        written = call.func.attr == "write_text"
    elif isinstance(call.func, ast.Name) and call.func.id == "open":
        written = _mode(call, 1)
    elif isinstance(call.func, ast.Attribute) and call.func.attr in ("open", "fdopen"):
        owner = call.func.value
        is_os = isinstance(owner, ast.Name) and owner.id == "os"
        if is_os and call.func.attr == "open":
            return ""
        if isinstance(owner, ast.Name) and owner.id in ("Image", "tarfile", "wave", "zipfile", "gzip", "msgspec"):
            return ""
        mode = _mode(call, 1 if is_os else 0)
        if mode is None or (not call.args and not call.keywords and not _is_path(owner)):
            return ""
        written = mode
    else:
        return ""
    if written is None:
        return ""
    lacks = {"encoding"} | ({"newline"} if written else set())
    return " and ".join(sorted(lacks - named))


def _is_path(node: ast.expr) -> bool:
    return isinstance(node, ast.BinOp) or (isinstance(node, ast.Name) and node.id in ("path", "file"))


def _mode(call: ast.Call, place: int) -> bool | None:
    """Whether it opens a text file for writing; None where it opens bytes, or no file."""
    mode = (
        call.args[place] if len(call.args) > place else next((k.value for k in call.keywords if k.arg == "mode"), None)
    )
    if mode is None:
        return False
    if not isinstance(mode, ast.Constant) or not isinstance(mode.value, str) or not set(mode.value) <= set("rwxabt+"):
        return None
    return None if "b" in mode.value else bool(set(mode.value) & set("wxa+"))


@pytest.mark.parametrize("name", ["con", "CON", "nul.mcap", "com1", "Lpt9.txt", "maze.", "maze ", "a:b", "a?", "a\tb"])
def test_a_name_that_windows_cannot_keep_is_refused_with_the_reason(name: str) -> None:
    assert explain_unportable_name(name)


@pytest.mark.parametrize("name", ["fourrooms", "sub-07", "console", "com10", "a.b", "null", "aux-study"])
def test_a_name_that_every_system_keeps_is_taken(name: str) -> None:
    assert explain_unportable_name(name) == ""


@pytest.mark.parametrize("study", ["nul", "maze."])
def test_a_study_is_not_begun_under_such_a_name(tmp_path: Path, study: str) -> None:
    with pytest.raises(LogError, match=r"cannot be a folder name on every system: Windows .*; choose another name"):
        McapRecorder(tmp_path, msgspec.structs.replace(session_plan(), study=study), started_ns=STARTED_NS)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "names", "twin"),
    [("maze", ["Maze", "other"], "Maze"), ("maze", ["maze", "Maze"], ""), ("maze", ["mazes"], ""), ("maze", [], "")],
)
def test_a_name_that_differs_in_case_only_is_found(name: str, names: list[str], twin: str) -> None:
    assert find_case_twin(name, names) == twin


def test_two_studies_do_not_differ_in_case_only(tmp_path: Path) -> None:
    protocol = decode_protocol((Path(__file__).parents[2] / "protocols" / "fourrooms-transfer.toml").read_bytes())
    take_slot(protocol, tmp_path / "maze")
    take_slot(protocol, tmp_path / "maze")
    with pytest.raises(AllocationError, match="study 'Maze' would share its folder with 'maze' on Windows and macOS"):
        take_slot(protocol, tmp_path / "Maze")


class Refusing:
    """A call that Windows refuses a few times, with one of its error numbers."""

    def __init__(self, times: int, winerror: int | None) -> None:
        self.left, self.calls, self._winerror = times, 0, winerror

    def __call__(self) -> None:
        self.calls += 1
        if self.calls <= self.left:
            error = PermissionError(errno.EACCES, "Permission denied")
            if self._winerror is not None:
                error.winerror = self._winerror  # type: ignore[attr-defined] # Windows alone has it
            raise error


@pytest.mark.parametrize(("winerror", "shared"), [(5, True), (32, True), (33, True), (2, False), (112, False)])
def test_only_a_file_that_is_open_elsewhere_is_tried_again(winerror: int, shared: bool) -> None:
    call = Refusing(2, winerror)
    if shared:
        retry_when_shared(call, interval_s=0.0)
    else:
        with pytest.raises(PermissionError):
            retry_when_shared(call, interval_s=0.0)
    assert call.calls == (3 if shared else 1)


def test_a_refusal_of_another_system_is_none_of_windows() -> None:
    assert not is_sharing_violation(PermissionError(errno.EACCES, "Permission denied"))


def test_what_stays_open_elsewhere_is_an_error_in_the_end() -> None:
    call = Refusing(1_000, 32)
    with pytest.raises(PermissionError):
        retry_when_shared(call, interval_s=0.0)
    assert call.calls == operating_system.REPLACE_ATTEMPTS


def test_flags_of_os_open_have_their_disposition_on_windows() -> None:
    create_new, create_always, open_existing, open_always, truncate_existing = 1, 2, 3, 4, 5
    assert windows_disposition(os.O_CREAT | os.O_EXCL | os.O_RDWR | os.O_APPEND) == create_new
    assert windows_disposition(os.O_CREAT | os.O_TRUNC | os.O_WRONLY) == create_always
    assert windows_disposition(os.O_CREAT | os.O_RDWR | os.O_APPEND) == open_always
    assert windows_disposition(os.O_RDONLY) == open_existing
    assert windows_disposition(os.O_TRUNC | os.O_WRONLY) == truncate_existing


def test_a_file_is_replaced_while_it_is_open_and_its_reader_keeps_the_old_one(tmp_path: Path) -> None:
    old, new = tmp_path / "log", tmp_path / "log.new"
    old.write_bytes(b"old\r\nline")
    new.write_bytes(b"new")
    fd = open_file(old, os.O_RDWR | os.O_APPEND)
    lock_descriptor(fd)
    replace_file(new, old)
    os.write(fd, b"!")
    assert read_at(fd, 100, 3) == b"\r\nline!"
    assert old.read_bytes() == b"new"
    os.close(fd)


def test_a_file_for_which_the_disk_has_no_room_is_as_it_was(tmp_path: Path) -> None:
    with small_disk(tmp_path, 1 << 16):
        kept, absent = tmp_path / "kept", tmp_path / "absent"
        write_atomically("old", kept)
        ballast = fill(tmp_path, but=0)
        for path in (kept, absent):
            with pytest.raises(OSError, match="No space left on device") as refused:
                write_atomically("new" * 10_000, path)
            assert refused.value.filename == str(path)
        assert {path.name for path in tmp_path.iterdir()} == {"kept", ballast.name}
        assert kept.read_text() == "old"


def test_a_lock_that_is_not_waited_for_says_who_has_it(tmp_path: Path) -> None:
    first, second = (open_file(tmp_path / "x", os.O_CREAT | os.O_RDWR) for _ in range(2))
    lock_descriptor(first)
    with pytest.raises(BlockingIOError):
        lock_descriptor(second, wait=False)
    os.close(first)
    lock_descriptor(second, wait=False)
    assert not os.get_inheritable(second)
    os.close(second)


def test_two_servers_cannot_take_one_port() -> None:
    with socket.socket() as first, socket.socket() as second:
        for one in (first, second):
            operating_system.claim_address(one)
        first.bind(("127.0.0.1", 0))
        first.listen()
        with pytest.raises(OSError, match="in use"):
            second.bind(first.getsockname())


def test_a_session_is_timed_by_the_finest_clock() -> None:
    """``time.monotonic`` moves in steps of 16 ms on Windows before Python 3.13; elsewhere the two are one clock."""
    coarse = {
        name
        for name, tree in parse_other_modules().items()
        if any(isinstance(node, ast.Attribute) and ast.unparse(node) == "time.monotonic_ns" for node in ast.walk(tree))
    }
    assert coarse == {"display/windows/x11_input.py"}  # lays the X server's clock beside it
    assert time.get_clock_info("perf_counter").monotonic


DROPS_IT = """
import signal, time
from minihuman.operating_system import exit_when_terminated

class Finalized:
    def __del__(self):
        signal.raise_signal(signal.SIGTERM)

exit_when_terminated()
try:
    Finalized()
    print("went on", flush=True)
    time.sleep(600)
finally:
    print("finally")
"""


@pytest.mark.program
def test_a_termination_is_obeyed_though_it_comes_where_python_drops_what_is_raised():
    done = subprocess.run([sys.executable, "-c", DROPS_IT], capture_output=True, text=True, timeout=PATIENCE_S)
    assert (done.returncode, done.stdout, done.stderr) == (0, "went on\nfinally\n", "")
