"""A real window in a process of its own, driven over a pipe through the port.

Window toolkits keep state for a whole process (pyglet's display, its headless switch, SDL's environment), and other
tests use the same toolkits differently; here each window gets a clean one. Clocks agree: the machine has one monotonic.
"""

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from minihuman.display.windows.blocking_window import open_window
from minihuman.display.windows.window import Window
from minihuman.experiment.machine.inputs import Input, ScreenShown
from minihuman.experiment.machine.screens import Screen
from tests.counts import PATIENCE_S


class HostedWindow(Window):
    """The near end: a Window whose toolkit runs elsewhere."""

    def __init__(
        self, kind: str, display: str, *, size_px: tuple[int, int], python_path: str = "", fullscreen: bool = False
    ) -> None:
        self._line, far = Pipe()  # where the process ends, whatever waits for it hears the end of the line
        paths = os.pathsep.join(filter(None, (python_path, str(Path(__file__).parents[1]))))
        environment = {**os.environ, "DISPLAY": display, "PYTHONPATH": paths}
        with far:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "tests.window_host", *map(str, (far.fileno(), kind, *size_px, int(fullscreen)))],
                env=environment,
                pass_fds=(far.fileno(),),
            )
        self._open = True
        self._answer()

    def _answer(self) -> Any:
        answer = self._line.recv()
        if isinstance(answer, BaseException):
            raise answer
        return answer

    def _ask(self, method: str, *arguments: Any) -> Any:
        self._line.send((method, arguments))
        return self._answer()

    def show(self, screen: Screen) -> ScreenShown:
        return self._ask("show", screen)

    def wait(self, until_ns: int | None) -> list[Input]:
        return self._ask("wait", until_ns)

    def open_gamepad(self) -> dict[str, str]:
        return self._ask("open_gamepad")

    def facts(self) -> dict[str, str]:
        return self._ask("facts")

    @property
    def picture_px(self) -> tuple[int, int] | None:
        return self._ask("picture_px")

    def close(self) -> None:
        self._ask("close")

    def end(self) -> None:
        """Let the process go."""
        if self._open:
            self._open = False
            self._line.send(("end", ()))
            self._process.wait(timeout=PATIENCE_S)
            self._line.close()


@contextmanager
def hosted(kind: str, display: str, *, size_px: tuple[int, int]) -> Iterator[HostedWindow]:
    """A window whose process ends with the ``with``, however that ends."""
    window = HostedWindow(kind, display, size_px=size_px)
    try:
        yield window
    finally:
        window.end()


def _serve(line: Connection, kind: str, size_px: tuple[int, int], *, fullscreen: bool) -> None:
    try:
        window = open_window(kind, time.monotonic_ns, size_px=size_px, fullscreen=fullscreen)
    except Exception as error:
        line.send(error)
        return
    line.send("open")
    while True:
        method, arguments = line.recv()
        if method == "end":
            window.close()
            return
        try:
            attribute = getattr(window, method)
            line.send(attribute(*arguments) if callable(attribute) else attribute)
        except Exception as error:
            line.send(error)


if __name__ == "__main__":
    handle, kind, width, height, fullscreen = sys.argv[1:]
    with Connection(int(handle)) as line:
        _serve(line, kind, (int(width), int(height)), fullscreen=fullscreen == "1")
