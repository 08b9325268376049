"""A session as a process of its own, on a real clock and a real disk, to be sent signals. Run as a script."""

import os
import sys
import time
from pathlib import Path

from minihuman.lab.next_session import next_session
from minihuman.seats.machine import SessionClock
from minihuman.seats.sitting import sit
from minihuman.study.inputs import Input, KeyDown, Shown
from minihuman.study.protocol import decode
from minihuman.study.screens import PlayScreen, Screen, TextScreen
from minihuman.windows.port import Window


class EagerWindow(Window):
    """Someone who presses Enter at every text and walks on at every picture, every five milliseconds."""

    def __init__(self, clock: SessionClock, key: str) -> None:
        self._clock = clock
        self._key = key
        self._screen: Screen = TextScreen("", "", "")

    def show(self, screen: Screen) -> Shown:
        if isinstance(screen, PlayScreen) and screen.step == 20:
            os.write(1, b"playing\n")
        self._screen = screen
        now_ns = self._clock()
        return Shown(now_ns, now_ns, now_ns)

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
    plan = next_session(decode(protocol.read_bytes()), data)
    key = next(key for key, name in plan.episodes[0].key_map.keys.items() if name == action)
    sit(plan, EagerWindow(clock, key), clock, data)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3])
