"""The window port, and a scripted window that plays inputs at given times on a virtual clock.

Every window implements the port: pygame, pyglet, scripted; one contract suite runs them all. The scripted one serves
tests and the replay of sessions.
"""

import abc
from collections.abc import Callable, Iterable, Sequence

from minihuman.errors import WindowError
from minihuman.experiment.machine.inputs import Input, ScreenShown, Stop
from minihuman.experiment.machine.screens import Screen

Clock = Callable[[], int]  # ns on the session's monotonic clock, 0 at session start


class Window(abc.ABC):
    """Shows screens and yields inputs, stamped on receipt with the clock it was made with."""

    @abc.abstractmethod
    def show(self, screen: Screen) -> ScreenShown:
        """Draw a screen, flip, and say when it was submitted and when the flip returned."""

    def show_after(self, screen: Screen, await_log: Callable[[], None]) -> ScreenShown | None:
        """Show a screen once ``await_log`` has returned; until then a window may draw it, but not flip.

        None where another thread shows it: that it was is then one of the inputs of `wait`.

        Raises:
            LogError: as ``await_log`` does; then the screen is not shown.
        """
        await_log()
        return self.show(screen)

    @abc.abstractmethod
    def wait(self, until_ns: int | None) -> list[Input]:
        """Block until an input comes or the clock reaches ``until_ns`` (None: for ever); [] at the deadline.

        Every input that has arrived is returned, in order of arrival; none is dropped or doubled.
        """

    @abc.abstractmethod
    def facts(self) -> dict[str, str]:
        """Return toolkit, version, display size, refresh rate, and how keys are identified; no personal names."""

    def open_gamepad(self) -> dict[str, str]:
        """Take inputs of a gamepad from now on; return device, axes, dead zone and polling, for the log.

        Raises:
            WindowError: if none is connected, or the window's toolkit reads none.
        """
        raise WindowError(f"a {type(self).__name__} reads no gamepad, which the protocol needs; use --window pygame")

    @property
    def picture_px(self) -> tuple[int, int] | None:
        """Return the room for a world's picture, width and height; None: no picture is drawn."""
        return None

    @abc.abstractmethod
    def close(self) -> None:
        """Give the display back. A second call does nothing."""


class VirtualClock:
    """A clock that moves only by ``advance_to``; calling it returns its time, ns."""

    def __init__(self) -> None:
        self.now_ns = 0

    def __call__(self) -> int:
        """Return the time, ns."""
        return self.now_ns

    def advance_to(self, t_ns: int) -> None:
        """Move on; a time that has passed changes nothing."""
        self.now_ns = max(self.now_ns, t_ns)


class ScriptedWindow(Window):
    """Hands out the script's inputs when the clock reaches them, and closes at the script's end.

    Args:
        script: inputs in order of time.
        clock: the virtual clock the session runs on; waiting moves it.
        frame_ns: how long a flip takes.
    """

    def __init__(self, script: Iterable[Input], clock: VirtualClock, *, frame_ns: int = 0) -> None:
        self.screens: list[Screen] = []
        self._script: list[Input] = sorted(script, key=lambda happened: happened.t_ns)
        self._clock = clock
        self._frame_ns = frame_ns

    def show(self, screen: Screen) -> ScreenShown:
        """Keep the screen; the flip returns one frame later."""
        self.screens.append(screen)
        submit_ns = self._clock()
        self._clock.advance_to(submit_ns + self._frame_ns)
        return ScreenShown(t_ns=self._clock(), submit_ns=submit_ns, flip_ns=self._clock())

    def wait(self, until_ns: int | None) -> list[Input]:
        """Move the clock to the next input or to ``until_ns``; all inputs of that moment come together."""
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
        """Return that it is a script."""
        return {"window": "scripted"}

    def close(self) -> None:
        """Do nothing: there is nothing to give back."""
