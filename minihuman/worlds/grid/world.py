"""GridWorld: the class to subclass for a grid world of your own. `docs/grid-worlds.md` writes one in fifteen lines."""

import abc
from typing import Any, ClassVar

from minihuman.worlds.grid.babyai.binding import instruct
from minihuman.worlds.grid.core.state import OVER, PHASE, PLAYING
from minihuman.worlds.grid.engine import GridEngine
from minihuman.worlds.grid.layout import Layout


class GridWorld(GridEngine, abc.ABC):
    """A grid world laid out in plain Python; what an action does and what the agent sees is compiled.

    A subclass writes `layout`, and `reward_and_done` unless it is about goal, lava or a task of `rewards`.
    """

    own_steps: ClassVar[bool] = True  # of an instruction: judge each part by its own steps
    done_required: ClassVar[bool] = False  # a clause ends when "done" is said right after it was done
    _has_own_reward: ClassVar[bool] = False

    def __init_subclass__(cls, **kwargs: Any) -> None:
        """Note whether the subclass has a reward of its own."""
        super().__init_subclass__(**kwargs)
        cls._has_own_reward = cls.reward_and_done is not GridWorld.reward_and_done

    @abc.abstractmethod
    def layout(self, grid: Layout) -> None:
        """Lay out an episode on an empty grid. It places the agent."""

    def reward_and_done(self, action: int, reward: float, terminated: bool) -> tuple[float, bool]:
        """Reward and end of a step that was made, given what goal, lava and task say.

        It may change the world (through ``self.state``); the observation is taken afterwards.
        """
        return reward, terminated

    @property
    def is_compiled(self) -> bool:
        """Whether kernels alone step and draw it: not with a `reward_and_done` of its own."""
        return not self._has_own_reward and self._is_plain(GridWorld)

    def _lay_out(self) -> None:
        grid = Layout(self._row, self.np_random, self.mission_space.first(), self.kinds)
        self.layout(grid)
        self.mission = grid.mission
        if grid.instruction is not None:
            instruct(self._row, grid.instruction, own_steps=self.own_steps, done_required=self.done_required)
            self.mission = self.mission_space.of(self._row)

    def step(self, action: int) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Act. Raises WorldError before `reset`, after an episode's end, and for an action there is not."""
        if not self._has_own_reward:
            return super().step(action)
        reward, terminated, truncated = self.advance(action)
        return self.observation(), reward, terminated, truncated, {}

    def advance(self, action: int) -> tuple[float, bool, bool]:
        """A step without its observation: reward, terminated, truncated."""
        reward, terminated, truncated = super().advance(action)
        if self._has_own_reward:
            reward, terminated = self.reward_and_done(int(action), reward, terminated)
            self._row[PHASE] = OVER if terminated or truncated else PLAYING
        return float(reward), bool(terminated), truncated

    shortest_path, path_length_bounds = GridEngine.shortest_path, GridEngine.path_length_bounds
