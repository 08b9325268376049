"""A window that plays a script: inputs with times on a virtual clock. For tests and for playing a session again."""

from collections.abc import Iterable, Sequence

from minihuman.study.inputs import Input, Shown, Stop
from minihuman.study.screens import Screen
from minihuman.windows.port import Window


class VirtualClock:
    """A clock that stands still until it is told to move, ns; calling it tells the time."""

    def __init__(self) -> None:
        self.now_ns = 0

    def __call__(self) -> int:
        """The time."""
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

    def show(self, screen: Screen) -> Shown:
        """Keep the screen; the flip returns one frame later."""
        self.screens.append(screen)
        submit_ns = self._clock()
        self._clock.advance_to(submit_ns + self._frame_ns)
        return Shown(t_ns=self._clock(), submit_ns=submit_ns, flip_ns=self._clock())

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
        """What it is."""
        return {"window": "scripted"}

    def close(self) -> None:
        """Nothing to give back."""
