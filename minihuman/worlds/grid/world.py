"""GridWorld: the class to write your own grid world with. `docs/grid-worlds.md` writes one in fifteen lines."""

import abc
from typing import Any, ClassVar

from minihuman.worlds.grid.core.state import OVER, PHASE, PLAYING
from minihuman.worlds.grid.engine import GridEngine
from minihuman.worlds.grid.instructions.placing import instruct
from minihuman.worlds.grid.layout import Layout


class GridWorld(GridEngine, abc.ABC):
    """A grid world laid out in plain Python; what an action does and what the agent sees is compiled.

    A subclass writes `layout`, and `judge` if goal, lava and the tasks of ``tasks`` are not what it is about.
    """

    own_steps: ClassVar[bool] = True  # of an instruction: judge each part by its own steps
    done_required: ClassVar[bool] = False  # a clause ends when "done" is said right after it was done
    _judges: ClassVar[bool] = False

    def __init_subclass__(cls, **kwargs: Any) -> None:
        """Note whether the subclass judges its steps itself."""
        super().__init_subclass__(**kwargs)
        cls._judges = cls.judge is not GridWorld.judge

    @abc.abstractmethod
    def layout(self, grid: Layout) -> None:
        """Lay out an episode on an empty grid. It places the agent."""

    def judge(self, action: int, reward: float, terminated: bool) -> tuple[float, bool]:
        """Reward and end of a step that was made, given what goal, lava and task say.

        It may change the world (through ``self.state``); the observation is taken afterwards.
        """
        return reward, terminated

    def _lay_out(self) -> None:
        grid = Layout(self._row, self.np_random, self.mission_space.first(), self.kinds)
        self.layout(grid)
        self.mission = grid.mission
        if grid.instruction is not None:
            instruct(self._row, grid.instruction, own_steps=self.own_steps, done_required=self.done_required)
            self.mission = self.mission_space.of(self._row)

    def step(self, action: int) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Act. Raises WorldError before `reset`, after an episode's end, and for an action there is not."""
        if not self._judges:
            return super().step(action)
        reward, terminated, truncated = self.advance(action)
        return self.observation(), reward, terminated, truncated, {}

    def advance(self, action: int) -> tuple[float, bool, bool]:
        """A step without its observation: reward, terminated, truncated."""
        reward, terminated, truncated = super().advance(action)
        if self._judges:
            reward, terminated = self.judge(int(action), reward, terminated)
            self._row[PHASE] = OVER if terminated or truncated else PLAYING
        return float(reward), bool(terminated), truncated

    way, bounds = GridEngine.way, GridEngine.bounds
