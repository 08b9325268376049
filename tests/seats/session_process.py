"""A session as a process of its own, on a real clock and a real disk, to be sent signals. Run as a script."""

import os
import signal
import sys
import time
from pathlib import Path

from minihuman.admin.next_session import plan_next_session
from minihuman.display.windows.window import Window
from minihuman.experiment.machine.inputs import Input, KeyDown, ScreenShown
from minihuman.experiment.machine.screens import PlayScreen, Screen, TextScreen
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.runtime.host import host_session
from minihuman.runtime.machine import SessionClock


class EagerWindow(Window):
    """Someone who presses Enter at every text and walks on at every picture, every five milliseconds."""

    def __init__(self, clock: SessionClock, key: str) -> None:
        self._clock = clock
        self._key = key
        self._screen: Screen = TextScreen("", "", "")

    def show(self, screen: Screen) -> ScreenShown:
        if isinstance(screen, PlayScreen) and screen.step == 20:
            os.write(1, b"playing\n")
        self._screen = screen
        now_ns = self._clock()
        return ScreenShown(now_ns, now_ns, now_ns)

    def wait(self, until_ns: int | None) -> list[Input]:
        time.sleep(0.005)
        playing = isinstance(self._screen, PlayScreen)
        return [KeyDown(self._clock(), self._key if playing else "enter")]

    def facts(self) -> dict[str, str]:
        return {"window": "eager"}

    def close(self) -> None:
        pass


def main(protocol: Path, data: Path, action: str) -> None:
    clock = SessionClock()
    plan = plan_next_session(decode_protocol(protocol.read_bytes()), data)
    key = next(key for key, name in plan.episodes[0].key_map.keys.items() if name == action)
    host_session(plan, EagerWindow(clock, key), clock, data)


if __name__ == "__main__":
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # one that comes when the session is over says nothing
    main(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3])
