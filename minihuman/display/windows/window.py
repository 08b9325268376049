"""The window interface, and a scripted window that plays inputs at given times on a virtual clock.

The pygame, pyglet and scripted windows implement the interface, and one contract suite tests them all. The scripted
window serves tests and the replay of sessions.
"""

import abc
from collections.abc import Callable, Iterable, Sequence

from minihuman.errors import WindowError
from minihuman.experiment.machine.inputs import Input, ScreenShown, Stop
from minihuman.experiment.machine.screens import Screen

Clock = Callable[[], int]  # ns on the session's monotonic clock, 0 at session start


class Window(abc.ABC):
    """A window that shows screens and returns inputs, each stamped by the session's clock when it is received."""

    @abc.abstractmethod
    def show(self, screen: Screen) -> ScreenShown:
        """Draw and display a screen; return the times at which it was submitted and the flip returned."""

    def show_after(self, screen: Screen, await_log: Callable[[], None]) -> ScreenShown | None:
        """Display a screen once ``await_log`` has returned; before that, a window can draw it but not display it.

        The result is None if another thread displays the screen; then `wait` returns an input that says when it was
        shown.

        Raises:
            LogError: if ``await_log`` raises it; the screen is not shown then.
        """
        await_log()
        return self.show(screen)

    @abc.abstractmethod
    def wait(self, until_ns: int | None) -> list[Input]:
        """Wait until inputs arrive or the clock reaches ``until_ns`` (None: no limit); return [] at the deadline.

        All inputs that have arrived are returned in order of arrival, without loss or duplicates.
        """

    @abc.abstractmethod
    def facts(self) -> dict[str, str]:
        """Return facts for the log: toolkit, version, display size, refresh rate, and how keys are identified.

        The facts must not contain names of persons.
        """

    def open_gamepad(self) -> dict[str, str]:
        """Receive inputs of a gamepad from now on; return its name, axes, dead zone and polling rate for the log.

        Raises:
            WindowError: if no gamepad is connected, or the window's toolkit does not support gamepads.
        """
        raise WindowError(f"a {type(self).__name__} reads no gamepad, which the protocol needs; use --window pygame")

    @property
    def picture_px(self) -> tuple[int, int] | None:
        """The largest width and height of a world's picture in pixels; None if the window draws no picture."""
        return None

    @abc.abstractmethod
    def close(self) -> None:
        """Close the window; a second call does nothing."""


class VirtualClock:
    """A clock that moves only by ``advance_to``; calling it returns its time in nanoseconds."""

    def __init__(self) -> None:
        self.now_ns = 0

    def __call__(self) -> int:
        """Return the time in nanoseconds."""
        return self.now_ns

    def advance_to(self, t_ns: int) -> None:
        """Advance the clock to a time; a time in the past changes nothing."""
        self.now_ns = max(self.now_ns, t_ns)


class ScriptedWindow(Window):
    """A window that returns a script's inputs when the clock reaches them, and stops the session at the script's end.

    Args:
        script: the inputs to return
        clock: the virtual clock of the session, which waiting advances
        frame_ns: the duration of a flip in nanoseconds
    """

    def __init__(self, script: Iterable[Input], clock: VirtualClock, *, frame_ns: int = 0) -> None:
        self.screens: list[Screen] = []
        self._script: list[Input] = sorted(script, key=lambda happened: happened.t_ns)
        self._clock = clock
        self._frame_ns = frame_ns

    def show(self, screen: Screen) -> ScreenShown:
        """Record the screen; the flip returns one frame later."""
        self.screens.append(screen)
        submit_ns = self._clock()
        self._clock.advance_to(submit_ns + self._frame_ns)
        return ScreenShown(t_ns=self._clock(), submit_ns=submit_ns, flip_ns=self._clock())

    def wait(self, until_ns: int | None) -> list[Input]:
        """Advance the clock to the next input or to ``until_ns``; return all inputs of that time together."""
        if not self._script:
            return [Stop(self._clock(), "window_closed", "the script has ended")]
        due_ns = max(self._script[0].t_ns, self._clock())
        if until_ns is not None and max(until_ns, self._clock()) < due_ns:
            self._clock.advance_to(until_ns)
            return []
        self._clock.advance_to(due_ns)
        arrived: Sequence[Input] = [happened for happened in self._script if happened.t_ns <= due_ns]
        self._script = self._script[len(arrived) :]
        return list(arrived)

    def facts(self) -> dict[str, str]:
        """Return the fact that the window is scripted."""
        return {"window": "scripted"}

    def close(self) -> None:
        """Do nothing, since there is no display to close."""
