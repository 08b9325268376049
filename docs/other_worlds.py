"""Environments with another interface than Gymnasium's, or another picture, made to play: Crafter, MiniHack, arcengine.

Each takes the few lines that a lab would write for its own: an id for `world`, actions with names, a picture as
uint8[H, W, 3], and randomness from the seed of the reset. What is not installed is left out.
"""

from contextlib import suppress
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import spaces

RENDERS: dict[str, Any] = {"render_modes": ["rgb_array"], "render_fps": 5}

with suppress(ImportError):
    import crafter

    class Crafter(gymnasium.Env):
        """Crafter, which has the interface of gym before 0.26."""

        metadata: ClassVar[dict[str, Any]] = RENDERS

        def __init__(self, render_mode: str | None = None) -> None:
            self.render_mode = render_mode
            self.action_names = tuple(crafter.Env(seed=0).action_names)
            self.action_space = spaces.Discrete(len(self.action_names))
            self.observation_space = spaces.Box(0, 255, (64, 64, 3), np.uint8)

        def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
            """Start a game."""
            super().reset(seed=seed)
            self._game = crafter.Env(seed=int(self.np_random.integers(2**31)))
            return self._game.reset(), {}

        def step(self, action: int):
            """Do an action."""
            seen, reward, done, _ = self._game.step(int(action))
            return seen, float(reward), bool(done), False, {}

        def render(self):
            """Draw the picture."""
            return self._game.render((576, 576))

    gymnasium.register("other/Crafter-v1", entry_point=Crafter, max_episode_steps=10_000)

with suppress(ImportError):
    import minihack  # noqa: F401 - registers its environments

    class MiniHack(gymnasium.Env):
        """A MiniHack environment by its id; its observation is the picture around the agent."""

        metadata: ClassVar[dict[str, Any]] = RENDERS

        def __init__(self, render_mode: str | None = None, *, task: str = "") -> None:
            self.render_mode = render_mode
            self._game = gymnasium.make(task, observation_keys=("pixel_crop",), disable_env_checker=True).unwrapped
            self.action_space = spaces.Discrete(len(self._game.actions))
            names = [action.name.lower() for action in self._game.actions]
            self.action_names = tuple(
                name if names.count(name) == 1 else f"{name}_{number}" for number, name in enumerate(names)
            )
            self.observation_space = self._game.observation_space["pixel_crop"]

        def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
            """Start a game."""
            super().reset(seed=seed)
            core, shown = (int(number) for number in self.np_random.integers(2**31, size=2))
            self._game.seed(core, shown, reseed=False)
            self._seen = self._game.reset()[0]["pixel_crop"]
            return self._seen, {}

        def step(self, action: int):
            """Do an action."""
            seen, reward, terminated, truncated, _ = self._game.step(int(action))
            self._seen = seen["pixel_crop"]
            return self._seen, float(reward), bool(terminated), bool(truncated), {}

        def render(self):
            """Draw the picture."""
            return self._seen

        def close(self) -> None:
            """Close the game."""
            self._game.close()

    for known in [name for name in gymnasium.registry if name.startswith("MiniHack-")]:
        gymnasium.register(f"other/{known}", entry_point=MiniHack, kwargs={"task": known})

with suppress(ImportError):
    import arcengine

    PALETTE = np.array([(22, 25, 30), (86, 180, 233), (230, 159, 0), (232, 230, 225)], np.uint8)

    class Lights(arcengine.ARCBaseGame):
        """A click on a lamp turns it and its neighbours in the row and column; all lit is the win."""

        def __init__(self, lit: tuple[tuple[int, int], ...]) -> None:
            lamps = [
                arcengine.Sprite([[1 + ((x, y) in lit)] * 4] * 4, name=f"{x} {y}", x=4 + 8 * x, y=4 + 8 * y)
                for x in range(3)
                for y in range(3)
            ]
            level, camera = arcengine.Level(lamps, grid_size=(28, 28)), arcengine.Camera(0, 0, 28, 28)
            super().__init__("lights", [level], camera, available_actions=[6])

        def step(self) -> None:
            """Do an action."""
            place = self.camera.display_to_grid(self.action.data.get("x", -1), self.action.data.get("y", -1))
            x, y = ((value - 2) // 8 for value in place or (-10, -10))
            for across, down in ((x, y), (x - 1, y), (x + 1, y), (x, y - 1), (x, y + 1)):
                for lamp in self.current_level.get_sprites_by_name(f"{across} {down}"):
                    lamp.pixels = 3 - lamp.pixels
            if all((lamp.pixels == 2).all() for lamp in self.current_level.get_sprites()):
                self.next_level()
            self.complete_action()

    class ArcLights(gymnasium.Env):
        """The game behind Gymnasium's interface: an action is a place in its picture of 64 by 64."""

        metadata: ClassVar[dict[str, Any]] = {"render_modes": ["rgb_array"]}

        def __init__(self, render_mode: str | None = None) -> None:
            self.render_mode = render_mode
            self.action_space = spaces.Dict({"place": spaces.Box(0, 63, (2,), np.int64)})
            self.observation_space = spaces.Box(0, 255, (64, 64, 3), np.uint8)

        def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None):
            """Start a game."""
            super().reset(seed=seed)
            lit = tuple((number // 3, number % 3) for number in np.flatnonzero(self.np_random.integers(2, size=9)))
            self._game = Lights(lit)
            return self._take(arcengine.GameAction.RESET, {}), {}

        def step(self, action: dict[str, Any]):
            """Do an action."""
            x, y = (int(value) for value in action["place"])
            seen = self._take(arcengine.GameAction.ACTION6, {"x": x, "y": y})
            won = self._state == arcengine.GameState.WIN
            return seen, float(won), won, False, {}

        def _take(self, action: Any, data: dict[str, int]):
            done = self._game.perform_action(arcengine.ActionInput(id=action, data=data))
            self._state = done.state
            self._seen = PALETTE[np.array(done.frame[-1]) % len(PALETTE)]
            return self._seen

        def render(self):
            """Draw the picture."""
            return np.kron(self._seen, np.ones((8, 8, 1), np.uint8))

    gymnasium.register("other/ArcLights-v0", entry_point=ArcLights, max_episode_steps=50)
