"""The window that ``render_mode="human"`` opens, made by Gymnasium's own wrapper. Worlds only draw the picture."""

from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

ImageArray = NDArray[np.uint8]


class _Pictures(gymnasium.Env[None, int]):
    """An environment that only draws pictures, for Gymnasium's rendering wrapper to show."""

    render_mode = "rgb_array"
    observation_space: Any = gymnasium.spaces.Discrete(1)  # never sampled
    action_space: Any = gymnasium.spaces.Discrete(1)

    def __init__(self, draw: Callable[[], ImageArray], fps: int) -> None:
        self.metadata = {"render_modes": ["rgb_array"], "render_fps": fps}
        self._draw = draw

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[None, dict[str, Any]]:
        """Do nothing; the wrapper shows a picture after each reset."""
        return None, {}

    def render(self) -> Any:
        """Return the current picture."""
        return self._draw()


class HumanWindow:
    """A window that shows a world's picture. It opens when a picture is first shown.

    Args:
        draw: a function that draws the picture, uint8[H, W, 3].
        fps: the maximum number of pictures per second.
    """

    def __init__(self, draw: Callable[[], ImageArray], fps: int) -> None:
        self._pictures = _Pictures(draw, fps)
        self._window: Any = None

    def show(self) -> None:
        """Draw the current picture and show it, opening the window if necessary."""
        if self._window is None:
            from gymnasium.wrappers import HumanRendering  # here: it loads a second's worth of wrappers

            self._window = HumanRendering(self._pictures)
        self._window.reset()

    def close(self) -> None:
        """Close the window; showing another picture opens it again."""
        if self._window is not None:
            self._window.close()
            self._window = None


class ShowsItself:
    """Mixin that gives a world the window of ``render_mode="human"``."""

    metadata: dict[str, Any]
    render_mode: str | None
    _window: HumanWindow | None = None  # once something was shown

    def close(self) -> None:
        """Close the window of ``render_mode="human"``, if one is open."""
        if self._window is not None:
            self._window.close()
            self._window = None

    def show_in_window(self, draw: Callable[[], ImageArray]) -> None:
        """Draw the current picture and show it in the world's window, which opens when it is first needed."""
        if self._window is None:
            self._window = HumanWindow(draw, self.metadata["render_fps"])
        self._window.show()
