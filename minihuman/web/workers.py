"""Other processes beside the server: workers that own seats of their own, and the experimenter's page."""

import signal
import subprocess
import sys
import threading
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from minihuman.errors import LogError

_PATIENCE_S = 30.0  # so long a worker may take to bring its logs to the disk
_AGAIN_S = 1.0  # before one that died is started again


def other_processes(
    protocol: Path, study_dir: Path, *, port: int, workers: int, watch: bool
) -> Iterator[tuple[str, ...]]:
    """The words of each process beside the first worker; each worker has a port of its own, one after the other."""
    if watch:
        study_dir.mkdir(parents=True, exist_ok=True)
        yield "watch", str(study_dir)
    if workers > 1 and not port:
        raise LogError("workers have ports one after the other; say the first with --port")
    for number in range(1, workers):
        data = str(study_dir.parent)
        yield "serve", str(protocol), "--data", data, "--port", str(port + number), "--links", "0"


@contextmanager
def beside(commands: Iterable[Sequence[str]]) -> Iterator[None]:
    """Keep processes running as long as this lasts: `minihuman` with these words. One that dies is started again.

    They end with this process, also where it is told to terminate.
    """
    signal.signal(signal.SIGTERM, _leave)
    kept = [_Kept(words) for words in commands]
    try:
        yield
    finally:
        for one in kept:
            one.stop()


def _leave(*_: object) -> None:
    raise SystemExit(0)


class _Kept:
    def __init__(self, words: Sequence[str]) -> None:
        self._command = [sys.executable, "-m", "minihuman", *words]
        self._stopped = threading.Event()
        self._starting = threading.Lock()  # held while it is started again: never once it was told to stop
        self._process = self._started()
        self._thread = threading.Thread(target=self._keep, name=f"minihuman-{words[0]}", daemon=True)
        self._thread.start()

    def _started(self) -> subprocess.Popen[bytes]:
        return subprocess.Popen(self._command, stdin=subprocess.DEVNULL)

    def _keep(self) -> None:
        while not self._stopped.is_set():
            self._process.wait()
            self._stopped.wait(_AGAIN_S)
            with self._starting:
                if not self._stopped.is_set():
                    self._process = self._started()

    def stop(self) -> None:
        with self._starting:
            self._stopped.set()
        self._process.terminate()
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(_PATIENCE_S)
        self._process.kill()
        self._thread.join()
