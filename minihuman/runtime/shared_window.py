"""One window for several people at one machine: what each of them sees, and to whom a key belongs.

Each session runs in a thread of its own, in front of a window that is a part of this one. Only the thread that runs
this window touches the display. While all play, their pictures are side by side, and a key goes to the seat whose key
map has it. Outside of play one person after the other is asked, until all wait for each other.
"""

import queue
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from minihuman.display.windows.window import Clock, Window
from minihuman.experiment.keys import RESERVED_KEYS
from minihuman.experiment.machine.inputs import FocusChanged, Input, KeyDown, KeyUp, ScreenShown, Stop
from minihuman.experiment.machine.screens import PageScreen, PlayScreen, QuestionScreen, Screen, TextScreen
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.machine.transitions import Phase
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.experiment.protocol.protocol import Protocol
from minihuman.experiment.words import InterfaceWords
from minihuman.operating_system import receive_end_signals
from minihuman.runtime.agent_host import make_agent_host
from minihuman.runtime.host import host_session
from minihuman.runtime.machine import SessionClock
from minihuman.runtime.team_host import TeamTable

POLL_NS = 4_000_000  # the longest time for which the display's thread waits for keys before it shows new screens
GAP_PX = 12  # between pictures
GAP_COLOUR = (22, 25, 30)
_STOP_KEYS = RESERVED_KEYS - {"enter"}
# phases in which a question concerns all sessions
_QUESTION_PHASES = (Phase.PAUSED, Phase.UNFOCUSED, Phase.QUIT_QUESTION, Phase.ABORT_QUESTION)

Result = TypeVar("Result")


class SeatWindow(Window):
    """One person's part of a shared window. Its screens are shown while it is in front, which `wait` then reports.

    Args:
        window: the shared window.
        clock: the clock of all sessions.
        number: the number of the seat, from 1.
        seats: how many seats share the window.
    """

    def __init__(self, window: Window, clock: Clock, number: int, seats: int) -> None:
        self.session: SessionMachine | None = None  # the seat's session, once it has begun
        self.screen: Screen | None = None
        self.label = f"{number}"
        self._window = window  # the shared one
        self._clock = clock
        self._seats = seats
        self._keys: Mapping[str, str] = {}  # key to action, as of the latest screen that had any
        self._inputs: queue.SimpleQueue[Input | tuple[Screen, ScreenShown] | None] = queue.SimpleQueue()

    def begin(self, session: SessionMachine) -> None:
        """Set the session of this seat."""
        words = InterfaceWords(session.plan.language, session.plan.words, session.plan.fonts)
        self.session = session
        self.label = words.fill("team.person", number=self.label)

    @property
    def has_nothing_to_do(self) -> bool:
        """Return whether the seat has no screen yet, or shows a text that asks its person for nothing."""
        screen = self.screen
        return screen is None or (isinstance(screen, TextScreen) and not screen.prompt and not screen.keys)

    def has_key(self, key: str) -> bool:
        """Return whether a key has an action in the running episode or, between episodes, had one in the last."""
        play = None if self.session is None else self.session.play
        if play is not None:
            self._keys = play.plan.key_map.keys
        return key in self._keys

    def put(self, message: Input | tuple[Screen, ScreenShown] | None = None) -> None:
        """Pass an input or a displayed screen to the seat's session; None only wakes it up."""
        self._inputs.put(message)

    def show(self, screen: Screen) -> None:  # type: ignore[override]
        """Set the screen to be shown; `wait` returns once it has been shown."""
        self.screen = screen

    def show_after(self, screen: Screen, settle_log: Callable[[], None]) -> None:
        """Set the screen to be shown once the events that led to it are written."""
        settle_log()
        self.show(screen)

    def wait(self, until_ns: int | None) -> list[Input]:
        """Wait until the seat's person does something, its screen was shown, another seat wakes it up, or ``until_ns``.

        Return a list of one input, so that a screen's time is later than what the session did before, or [].
        """
        try:
            timeout_s = None if until_ns is None else max(0.0, (until_ns - self._clock()) / 1e9)
            message = self._inputs.get(timeout=timeout_s)
        except queue.Empty:
            return []
        if message is None:
            return []
        if not isinstance(message, tuple):
            return [message]
        screen, screen_shown = message
        if screen is not self.screen:
            return []
        return [replace(screen_shown, t_ns=self._clock())]

    def facts(self) -> dict[str, str]:
        """Return the facts about the shared window, and how many seats share it."""
        return self._window.facts() | {"seats_at_window": str(self._seats)}

    @property
    def picture_px(self) -> tuple[int, int] | None:
        """Return the seat's share of the size that the shared window has for pictures; None if that is unknown."""
        picture_px = self._window.picture_px
        if picture_px is None:
            return None
        width_px, height_px = picture_px
        return (width_px - GAP_PX * (self._seats - 1)) // self._seats, height_px

    def close(self) -> None:
        """Do nothing, since the seat does not own the shared window."""


class SharedWindow:
    """Shows several seats in one window.

    Args:
        window: the open window, used only by the thread that calls `run`.
        clock: the clock of all sessions.
        seats: the number of seats.
    """

    def __init__(self, window: Window, clock: Clock, seats: int) -> None:
        self.seats = tuple(SeatWindow(window, clock, number, seats) for number in range(1, seats + 1))
        self._window = window
        self._clock = clock
        self._displayed: list[tuple[SeatWindow, Screen]] = []
        self._down: dict[str, Sequence[SeatWindow]] = {}  # the seats that received the press of each key that is down

    def run(self, plays: Sequence[Callable[[], Result]]) -> list[Result]:
        """Call each seat's function in a thread of its own, and return their results once all have returned.

        Raises:
            Exception: the first error of one of them; the other sessions were ended.
        """
        with (
            receive_end_signals(lambda name: self._stop("signal", name)),
            ThreadPoolExecutor(len(plays), "minihuman-seat") as pool,
        ):
            runs = [pool.submit(play) for play in plays]
            try:
                while not all(run.done() for run in runs):
                    self._show_screens()
                    for happened in self._window.wait(self._clock() + POLL_NS):
                        self._route(happened)
                    if any(run.done() and run.exception() for run in runs):
                        self._stop("window_closed", "another seat's session failed")
            except BaseException as error:
                self._stop("window_closed", type(error).__name__)
                raise
        return [run.result() for run in runs]

    def _stop(self, reason: Literal["window_closed", "signal"], detail: str) -> None:
        """End the sessions of all seats."""
        for seat in self.seats:
            seat.put(Stop(self._clock(), reason, detail))

    @property
    def _active_seats(self) -> list[SeatWindow]:
        """Return the seats whose sessions are not over; all seats if every session is."""
        return [seat for seat in self.seats if seat.session is None or not seat.session.over] or [*self.seats]

    @property
    def _front(self) -> SeatWindow:
        """Return the seat whose person has something to do; the first active seat if all of them wait."""
        return next((seat for seat in self._active_seats if not seat.has_nothing_to_do), self._active_seats[0])

    def _show_screens(self) -> None:
        """Show the screens in view if any of them is new, and pass each new one and its time to its seat."""
        in_view = [seat for seat in self._active_seats if isinstance(seat.screen, PlayScreen)]
        if self._front not in in_view:
            in_view = [self._front]
        visible = [(seat, seat.screen) for seat in in_view if seat.screen is not None]
        displayed = {(seat, id(screen)) for seat, screen in self._displayed}  # by identity: an equal screen may be new
        new = [(seat, screen) for seat, screen in visible if (seat, id(screen)) not in displayed]
        if not new and len(visible) == len(displayed):
            return
        labels = [seat.label for seat, _ in visible]
        screens = [screen for _, screen in visible]
        frame = self._window.show(_compose_screens(labels, screens))
        for seat, screen in new:
            screen_shown = frame
            if isinstance(screen, PlayScreen):
                screen_shown = replace(frame, step=screen.step)
            seat.put((screen, screen_shown))
        self._displayed = visible

    def _route(self, happened: Input) -> None:
        """Pass an input to the seats that it concerns; a key's release goes to the seats that received its press."""
        match happened:
            case KeyDown(key=key):
                if not happened.repeat or key not in self._down:
                    self._down[key] = self._find_owners(key)
                seats = self._down[key]
            case KeyUp(key=key):
                seats = self._down.pop(key, self.seats)
            case Stop() | FocusChanged():
                seats = self.seats
            case _:
                seats = (self._front,)
        for seat in seats:
            seat.put(happened)

    def _find_owners(self, key: str) -> Sequence[SeatWindow]:
        """Return the seats that receive a key, judging by what people see.

        Keys that stop a session, and all keys while a question about the sessions is shown, go to every active seat.
        During play, other keys go to the seats that have them; outside of play, to the seats whose screens are shown.
        """
        phases = {seat.session.phase for seat in self._active_seats if seat.session is not None}
        if key in _STOP_KEYS or phases.intersection(_QUESTION_PHASES):
            return self._active_seats
        visible_seats = [seat for seat, screen in self._displayed if isinstance(screen, PlayScreen)]
        if not visible_seats:
            return [seat for seat, _ in self._displayed] or [self._front]
        return [seat for seat in self._active_seats if seat.has_key(key)] or visible_seats


def _compose_screens(labels: Sequence[str], screens: Sequence[Screen]) -> Screen:
    """Compose one screen: the pictures side by side, or one person's screen with the label of their seat."""
    first = screens[0]
    label = labels[0]
    if isinstance(first, TextScreen | PageScreen | QuestionScreen):
        title = label
        if first.title:
            title = f"{label}: {first.title}"
        return replace(first, title=title)
    plays = [screen for screen in screens if isinstance(screen, PlayScreen)]
    if not plays:
        return first
    first_play = plays[0]
    controllers = []
    for seat_label, play in zip(labels, plays, strict=True):
        if play.controller_text:
            controllers.append(f"{seat_label}: {play.controller_text}")
    progress = first_play.progress
    if len(plays) > 1:
        progress = "   ".join((label, progress, *labels[1:]))
    return replace(
        first_play,
        progress=progress,
        picture=_join_pictures([play.picture for play in plays]),
        legend=tuple(chain.from_iterable(play.legend for play in plays)),
        labels=tuple(chain.from_iterable(play.labels for play in plays)),
        controller="person" if controllers else "",
        controller_text="   ".join(controllers),
    )


def _join_pictures(pictures: Sequence[NDArray[np.uint8]]) -> NDArray[np.uint8]:
    """Put pictures of the same height side by side with gaps between them; return the first one if it is empty."""
    first, *others = pictures
    if not first.size:
        return first
    gap = np.full((len(first), GAP_PX, 3), GAP_COLOUR, np.uint8)
    row = [first]
    for picture in others:
        row += [gap, picture]
    return np.concatenate(row, axis=1)


def host_team(
    protocol: Protocol,
    plans: Sequence[SessionPlan],
    shared: SharedWindow,
    clock: SessionClock,
    data: Path,
    *,
    markers: bool = False,
) -> list[Path | None]:
    """Run the sessions of people who share this machine; return each session's log as `host_session` does.

    Raises:
        Exception: the error that `host_session` raised for one of them; the others were ended, and their logs finished.
    """
    table = TeamTable(protocol, data, gather=len(plans))

    def play(plan: SessionPlan, seat: SeatWindow) -> Path | None:
        agent = make_agent_host(protocol, plan, data, teams=table, changed=seat.put)
        try:
            return host_session(plan, seat, clock, data, markers=markers, agent=agent, on_begin=seat.begin)
        finally:
            table.depart()

    return shared.run([partial(play, *plan_and_seat) for plan_and_seat in zip(plans, shared.seats, strict=True)])
