"""The loop around a session: wait for inputs, receive them, write the events, show the screen.

All effects are here; all decisions are the session's. The command inbox passes the experimenter's requests to the
session, as one JSON line each in a file beside the log. Only this file connects the two, so the sender may die at any
time.
"""

import logging
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Literal

import msgspec

from minihuman.display.windows.window import Clock, Window
from minihuman.errors import LogError, PlayerFailedError, WorldError
from minihuman.experiment.machine.activity import RequestHandler
from minihuman.experiment.machine.events import EndReason, Event, SessionEnded
from minihuman.experiment.machine.inputs import ExperimenterCommand, Input, KeyDown, ScreenShown, Stop, Tick
from minihuman.experiment.machine.screen_texts import build_end_screen, find_stop_code
from minihuman.experiment.machine.screens import Screen
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.sounds import SoundCue
from minihuman.experiment.words import InterfaceWords
from minihuman.log.paths import LOG_SUFFIX
from minihuman.log.record.recorder import Recorder
from minihuman.operating_system import receive_end_signals
from minihuman.runtime.devices.sound import SimulatedOutput, SoundOutput, list_sound_cues
from minihuman.storage.durable_files import append_durably

CommandKind = Literal["pause", "go_on", "abort", "note"]


class CommandRequest(msgspec.Struct, frozen=True):
    """An experimenter's request to a running session."""

    what: CommandKind
    text: str = ""  # the note, or the reason
    at: str = ""  # ISO 8601 UTC


def inbox_path(log: Path) -> Path:
    """Return the path of the file with requests to a log's session: ``sub-07_ses-01.asked.jsonl``."""
    return log.with_name(log.name.removesuffix(LOG_SUFFIX) + ".asked.jsonl")


def send_command(log: Path, request: CommandRequest) -> None:
    """Send a request to a log's session, which reads its inbox several times per second."""
    append_durably(inbox_path(log), msgspec.json.encode(request) + b"\n")


class CommandInbox:
    """Reads the requests that are sent to a session from now on.

    Args:
        path: the file of requests, which need not exist.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._position = self._measure_size()  # of the first unread byte; requests to earlier segments are skipped

    def read_new(self) -> list[CommandRequest]:
        """Return the new requests. Unreadable lines are skipped; an incomplete line is read once it is complete."""
        if self._measure_size() <= self._position:
            return []
        with self._path.open("rb") as file:
            file.seek(self._position)
            content = file.read()
        complete_lines = content[: content.rfind(b"\n") + 1]
        self._position += len(complete_lines)
        requests = []
        for line in complete_lines.splitlines():
            try:
                requests.append(msgspec.json.decode(line, type=CommandRequest))
            except msgspec.DecodeError:
                continue
        return requests

    def _measure_size(self) -> int:
        """Return the size of the file in bytes; 0 if it cannot be found."""
        try:
            return os.stat(self._path).st_size
        except OSError:
            return 0


LOG = logging.getLogger("minihuman")
# While a toolkit waits in C, no Python signal handler runs; so a wait is interrupted this often.
SIGNAL_CHECK_INTERVAL_NS = 200_000_000
# With Python's default of 5 ms, the log's thread could delay a picture by that time.
SWITCH_INTERVAL_S = 0.0002
_NS_PER_S = 1_000_000_000


def run_session(
    session: SessionMachine,
    window: Window,
    recorder: Recorder,
    clock: Clock,
    *,
    inbox: CommandInbox | None = None,
    agent: RequestHandler | None = None,
    sound: SoundOutput | None = None,
    finished: Callable[[Path], object] | None = None,
    last_screen_s: float = 60.0,
) -> Path | None:
    """Run a session to its end, whatever ends it; the log is finished before this returns or raises.

    Args:
        inbox: the experimenter's commands, if there are any.
        agent: answers the parts' requests, if any part makes them. It is closed at the end.
        sound: plays the session's sounds; None for simulated participants, who hear each exactly when it is due.
        finished: called with the finished log's path, while signals are still deferred.
        last_screen_s: for how many seconds a screen that reports a failure waits for a key.

    Returns:
        The log's path; None if it was kept in memory.

    Raises:
        LogError: if the log could not be written; what was written before is kept.
        Exception: an error of the window, or a defect of this package.
    """
    loop = _SessionLoop(session, window, recorder, clock, inbox, agent, sound or SimulatedOutput(clock))
    with receive_end_signals(loop.note_signal):  # to the end, so that a second Ctrl-C does not cut the log off
        try:
            with _short_switch_interval():
                loop.run_or_stop()
                loop.hold_last_screen(last_screen_s)
        finally:
            _close_session(session, agent)
            path = _finish_log(recorder, finished)
    if loop.log_error:
        raise loop.log_error
    return path


def _finish_log(recorder: Recorder, finished: Callable[[Path], object] | None) -> Path | None:
    """Close a recorder, call ``finished`` with the log's path, and return the path; None if there is no file."""
    path = recorder.close()
    if finished is not None and path is not None:
        finished(path)
    return path


def _close_session(session: SessionMachine, agent: RequestHandler | None) -> None:
    """Stop the agent's processes, and close the session's world."""
    if agent is not None:
        agent.close()
    try:
        session.close()
    except Exception as error:  # the log must still be finished
        LOG.warning("the world did not close: %s: %s", type(error).__name__, error)


def describe_world_failure(session: SessionMachine, log: Path | None) -> WorldError:
    """Return the error for a session that ended because its world failed, with the failure and the log's path."""
    log_note = "" if log is None else f"; what was recorded up to then is in {log}"
    return WorldError(f"the world failed ({session.end_detail}){log_note}")


class _SessionLoop:
    """The loop between a session, its window and its log."""

    def __init__(
        self,
        session: SessionMachine,
        window: Window,
        recorder: Recorder,
        clock: Clock,
        inbox: CommandInbox | None,
        agent: RequestHandler | None,
        sound: SoundOutput,
    ) -> None:
        self.log_error: LogError | None = None
        self.signal_name = ""
        self._session = session
        self._window = window
        self._recorder = recorder
        self._clock = clock
        self._inbox = inbox
        self._agent = agent
        self._sound = sound
        self._cues: tuple[SoundCue, ...] = ()  # the sounds that the output has
        self._next_read_ns = 0  # when the inbox is read again
        self._last_screen: Screen | None = None
        self._failed = False

    def note_signal(self, name: str) -> None:
        """Record a signal, which ends the session at its next input."""
        self.signal_name = name

    def run_or_stop(self) -> None:
        """Run until the session is over; an error first ends the session in its log, then is raised.

        Raises:
            Exception: an error of the window or the player, or a defect of this package.
        """
        try:
            self.run()
        except PlayerFailedError as error:
            self.take(Stop(self._clock(), "player_failed", error.reason))
            raise
        except Exception as error:
            self.take(Stop(self._clock(), "internal_error", f"{type(error).__name__}: {error}"))
            raise

    def run(self) -> None:
        """Run until the session is over."""
        self.take(Tick(self._clock()))
        while not self._session.over:
            self._show()
            self._answer()
            for happened in self._next_inputs():
                self.take(happened)
                if not self._session.over:
                    self._show()  # each step's picture, even if the next key has arrived already
                    self._answer()
        try:
            self._settle_log()
        except LogError as error:
            self._stop_for_log(error)

    def take(self, happened: Input) -> None:
        """Pass an input to the session, begin to write its events, and update the sounds that play.

        The next picture waits until the events are written. If the log cannot be written, the session is stopped.
        """
        events = self._session.receive(happened)
        self._failed |= any(isinstance(event, SessionEnded) and event.reason == "world_error" for event in events)
        if not self.log_error:
            self._begin_writing(events)
        self._play_sounds()

    def _begin_writing(self, events: Sequence[Event]) -> None:
        """Begin to write events to the log; stop the session if that fails."""
        try:
            self._recorder.begin(events)
        except LogError as error:
            self._stop_for_log(error)

    def hold_last_screen(self, last_screen_s: float) -> None:
        """Keep a failure of the world or the log, if there was one, on the screen for ``last_screen_s`` at most.

        A key press, a signal and the closing of the window end this earlier.
        """
        if not (self._failed or self.log_error):
            return
        try:
            self._settle_log()
        except LogError as error:
            self._stop_for_log(error)
        if self.log_error:  # this includes a log that lacks only the session's end
            self._show_stop("disk_full", str(self.log_error))
        else:
            self._show_stop(self._session.end_reason, self._session.end_detail)
        until_ns = self._clock() + round(last_screen_s * _NS_PER_S)
        while self._clock() < until_ns and not self.signal_name:
            inputs = self._window.wait(min(until_ns, self._clock() + SIGNAL_CHECK_INTERVAL_NS))
            if any(isinstance(happened, KeyDown | Stop) for happened in inputs):
                return

    def _show_stop(self, reason: EndReason, detail: str) -> None:
        """Show a screen that says why the session stopped, with a code that is also written to the program's log."""
        plan = self._session.plan
        LOG.warning("the session stopped, code %s on its screen: %s", find_stop_code(reason, detail), detail)
        self._window.show(build_end_screen(InterfaceWords(plan.language, plan.words), reason, detail))

    def _show(self) -> None:
        """Show the session's screen if it is new; the events that led to it are written before it is flipped."""
        screen = self._session.screen
        if screen is self._last_screen:
            return
        self._last_screen = screen
        screen_shown = self._display(screen)
        if screen_shown is not None:
            self.take(screen_shown)

    def _display(self, screen: Screen) -> ScreenShown | None:
        """Draw a screen while the log is written, then display it; return None if the log could not be written."""
        try:
            return self._window.show_after(screen, self._settle_log)
        except LogError as error:
            self._stop_for_log(error)
            return None

    def _settle_log(self) -> None:
        """Wait until the events are written, unless the log has failed before."""
        if not self.log_error:
            self._recorder.settle()

    def _stop_for_log(self, error: LogError) -> None:
        """Stop the session, because its events cannot be logged."""
        self.log_error = error
        self.take(Stop(self._clock(), "disk_full", str(error)))

    def _play_sounds(self) -> None:
        """Hand the session's sounds to the output, if they have changed."""
        cues = list_sound_cues(self._session)
        if cues != self._cues:
            self._cues = cues
            self._sound.follow(cues)

    def _answer(self) -> None:
        """Answer the running part's requests; called after the picture was shown, so that no answer delays it."""
        while self._agent is not None and not self._session.over:
            request = self._session.request
            if request is None:
                return
            answer = self._agent.answer(request, self._session.play, self._clock())
            if answer is None:
                return
            self.take(answer)
            self._show()

    def _next_inputs(self) -> list[Input]:
        """Wait for the next inputs and return them, with the session's tick if it is due and the stop of a signal.

        Return [] if nothing came within `SIGNAL_CHECK_INTERVAL_NS`.
        """
        tick_ns = self._session.next_tick_ns
        until_ns = self._clock() + SIGNAL_CHECK_INTERVAL_NS
        if tick_ns is not None:
            until_ns = min(until_ns, tick_ns)
        if (report_ns := self._sound.next_report_ns) is not None:
            until_ns = min(until_ns, report_ns)
        inputs = self._window.wait(until_ns)
        inputs[:0] = self._sound.read()
        if self.signal_name:
            inputs.append(Stop(self._clock(), "signal", self.signal_name))
        elif commands := self._read_commands():
            inputs += commands
        elif not inputs and tick_ns is not None and self._clock() >= tick_ns:
            inputs.append(Tick(self._clock()))
        return inputs

    def _read_commands(self) -> list[ExperimenterCommand]:
        """Return the experimenter's new requests; [] without an inbox, or if it was read a moment ago."""
        now_ns = self._clock()
        if self._inbox is None or now_ns < self._next_read_ns:
            return []
        self._next_read_ns = now_ns + SIGNAL_CHECK_INTERVAL_NS
        return [ExperimenterCommand(now_ns, request.what, request.text) for request in self._inbox.read_new()]


@contextmanager
def _short_switch_interval() -> Iterator[None]:
    """Shorten the interpreter's thread switch interval while the context lasts, so that the loop soon gets its turn."""
    usual_interval_s = sys.getswitchinterval()
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    try:
        yield
    finally:
        sys.setswitchinterval(usual_interval_s)
