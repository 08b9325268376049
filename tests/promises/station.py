"""A session as a process of its own that tells what was shown and what was acknowledged, until it is killed."""

import os
import time
from collections.abc import Callable, Sequence
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path

from minihuman.admin.next_session import plan_next_session
from minihuman.display.windows.blocking_window import open_window
from minihuman.display.windows.window import Window
from minihuman.experiment.machine.events import Event, Stepped
from minihuman.experiment.machine.inputs import Input, KeyDown, ScreenShown
from minihuman.experiment.machine.screens import PlayScreen, Screen
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.log.record.disk import RecorderSettings
from minihuman.log.record.finalization import recover_log
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.runtime.machine import SessionClock
from minihuman.runtime.session_loop import run_session
from minihuman.worlds.adapters.world import World


class Told(McapRecorder):
    """Counts the steps that it is given."""

    given = 0

    def begin(self, events: Sequence[Event]) -> None:
        super().begin(events)
        self.given += sum(isinstance(event, Stepped) for event in events)


class Hurried(Window):
    """Somebody who answers every picture at once, every ``key_s`` seconds; tells what was shown when it was."""

    def __init__(
        self, clock: SessionClock, session: SessionMachine, recorder: Told, told: Connection, key_s: float
    ) -> None:
        self._clock, self._session, self._recorder, self._told, self._key_s = clock, session, recorder, told, key_s
        self._presses = 0
        self._playing = False

    def show(self, screen: Screen) -> ScreenShown:
        self._playing = isinstance(screen, PlayScreen)
        now_ns = self._clock()
        self._told.send((self._recorder.given, self._recorder.durable_steps))
        return ScreenShown(now_ns, now_ns, now_ns)

    def wait(self, until_ns: int | None) -> list[Input]:
        time.sleep(self._key_s)
        play = self._session.play
        self._presses += 1
        if play is None:
            return [KeyDown(self._clock(), "enter")]
        keys = list(play.plan.key_map.keys)
        return [KeyDown(self._clock(), keys[self._presses % 2])]  # left and right, for ever

    def facts(self) -> dict[str, str]:
        return {"window": "hurried"}

    def close(self) -> None:
        pass


class Telling(Window):
    """A window of the package's own that tells what was shown when it was; somebody else presses the keys."""

    def __init__(self, window: Window, recorder: Told, told: Connection) -> None:
        self._window, self._recorder, self._told = window, recorder, told

    def show(self, screen: Screen) -> ScreenShown:
        return self.show_after(screen, lambda: None)

    def show_after(self, screen: Screen, written: Callable[[], None]) -> ScreenShown:
        shown = self._window.show_after(screen, written)
        self._told.send((self._recorder.given, self._recorder.durable_steps))
        return shown

    def wait(self, until_ns: int | None) -> list[Input]:
        return self._window.wait(until_ns)

    def facts(self) -> dict[str, str]:
        return self._window.facts()

    @property
    def picture_px(self) -> tuple[int, int] | None:
        return self._window.picture_px

    def close(self) -> None:
        self._window.close()


def play_in_window(toml: bytes, data: Path, told: Connection, display: str) -> None:
    """Sit down at a window on a display, and play until somebody ends it."""
    os.environ["DISPLAY"] = display
    plan = plan_next_session(decode_protocol(toml), data, participant="sub-01")
    clock = SessionClock()
    recorder = Told(data, plan, started_ns=clock.started_unix_ns)
    window = Telling(open_window("auto", clock, size_px=(320, 240)), recorder, told)
    session = SessionMachine(plan, World, window.facts(), picture_px=window.picture_px)
    run_session(session, window, recorder, clock)


def play(toml: bytes, data: Path, told: Connection, key_s: float, fsync_s: float) -> None:
    """Sit down at once, and play until somebody ends it."""
    plan = plan_next_session(decode_protocol(toml), data, participant="sub-01")
    clock = SessionClock()
    recorder = Told(
        data, plan, started_ns=clock.started_unix_ns, settings=RecorderSettings(sync=partial(_slow_sync, fsync_s))
    )
    session = SessionMachine(plan, World, {"player": "hurried"}, picture_px=None)
    run_session(session, Hurried(clock, session, recorder, told, key_s), recorder, clock)


def _slow_sync(seconds: float, fd: int) -> None:
    time.sleep(seconds)
    os.fsync(fd)


def finish(part: Path) -> None:
    """Recover a cut-off log."""
    recover_log(part)
