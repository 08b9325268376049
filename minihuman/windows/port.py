"""The port every window implements: pygame, pyglet, scripted. One contract suite runs them all."""

import abc
from collections.abc import Callable

from minihuman.study.inputs import Input, Shown
from minihuman.study.screens import Screen

Clock = Callable[[], int]  # ns on the session's monotonic clock, 0 at session start


class Window(abc.ABC):
    """Shows screens and yields inputs, stamped on receipt with the clock it was made with."""

    @abc.abstractmethod
    def show(self, screen: Screen) -> Shown:
        """Draw a screen, flip, and say when it was submitted and when the flip returned."""

    def show_after(self, screen: Screen, written: Callable[[], None]) -> Shown:
        """Show a screen when ``written`` has returned; until then a window may draw it, but not flip.

        Raises:
            LogError: as ``written`` does; then the screen is not shown.
        """
        written()
        return self.show(screen)

    @abc.abstractmethod
    def wait(self, until_ns: int | None) -> list[Input]:
        """Block until an input comes or the clock reaches ``until_ns`` (None: for ever); [] at the deadline.

        Every input that has arrived is returned, in order of arrival; none is dropped or doubled.
        """

    @abc.abstractmethod
    def facts(self) -> dict[str, str]:
        """Toolkit, version, display size, refresh rate, how keys are identified. No names of people or machines."""

    @property
    def picture_px(self) -> tuple[int, int] | None:
        """Room for a world's picture, width and height; None: nobody looks, so none need be drawn."""
        return None

    @abc.abstractmethod
    def close(self) -> None:
        """Give the display back. A second call does nothing."""
