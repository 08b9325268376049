"""OwnTeamBatch: a batch of team grids of a user's own class, whose rules are compiled.

It has the same seeds, observations, rewards and ends as `TeamBatch`, which steps one world after the other.
"""

import logging
from typing import Any

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.grid.core.state import ACTIONS, NEW, PHASE
from minihuman.worlds.grid.own import entries
from minihuman.worlds.grid.own.entries import FAULT
from minihuman.worlds.grid.own.fields import numbers_length
from minihuman.worlds.grid.own.library import compile_library
from minihuman.worlds.grid.own.passes import act_teams, see_teams
from minihuman.worlds.grid.own.programs import compile_rules, raise_fault, setting_arrays, translate_rules
from minihuman.worlds.grid.own.source_names import TranslationError
from minihuman.worlds.rng import read_rng_state
from minihuman.worlds.team import TeamBatch

LOG = logging.getLogger("minihuman")


def make_team_batch(world: Any, num_worlds: int) -> TeamBatch:
    """Return a batch of ``num_worlds`` copies of a team grid, compiled if its rules can be translated."""
    if type(world).is_translated and not type(world).__module__.startswith("minihuman."):
        try:
            compile_rules(world)
            return OwnTeamBatch(world, num_worlds)
        except TranslationError as refusal:
            LOG.warning("%s is stepped in plain Python: %s", type(world).__name__, refusal)
    return TeamBatch(world, num_worlds)


class OwnTeamBatch(TeamBatch):
    """A batch of team grids that are stepped together in compiled code.

    Args:
        world: the world from which the batch takes its sizes, settings and rules.
        num_worlds: the number of worlds.
    """

    def __init__(self, world: Any, num_worlds: int) -> None:
        super().__init__(world, num_worlds)
        n = num_worlds
        self._program = program = translate_rules(world)
        self._library = compile_library(program.text, has_steps=program.has_reward)
        self._rows: NDArray[np.int32] = np.tile(world.state.row, (n, 1))
        self._rows[:, PHASE] = NEW
        self._own = np.zeros((n, numbers_length(type(world))), np.int64)
        self._rng_states = np.zeros((n, 6), np.uint64)
        self._mission_parts = np.zeros((n, program.mission_length), np.int64)
        whole, floats = setting_arrays(world, program)
        self._settings = np.tile(whole, (n, 1))
        self._float_settings = np.tile(floats, (n, 1))
        self._scratch = np.zeros(max(program.scratch, 1), np.int64)
        self._stepped = np.ones(n, np.bool_)
        self._terminated = np.zeros(n, np.bool_)
        self._truncated = np.zeros(n, np.bool_)
        self._everywhere = np.ones(n, np.bool_)  # selects all worlds
        self._table = entries.make_table(
            {
                entries.ROWS: self._rows,
                entries.OWN_NUMBERS: self._own,
                entries.INT_SETTINGS: self._settings,
                entries.FLOAT_SETTINGS: self._float_settings,
                entries.RNG: self._rng_states,
                entries.MISSIONS: self._mission_parts,
                entries.STEPPED: self._stepped,
                entries.TERMINATED: self._terminated,
                entries.TRUNCATED: self._truncated,
                entries.SCRATCH: self._scratch,
            }
        )

    def reset(self, seed: int) -> NDArray[Any]:
        """Begin an episode in every world, with seeds drawn from ``seed``; return the bodies' observations."""
        self._seeds = np.random.default_rng(seed)
        self._begin(np.arange(self.num_worlds))
        see_teams(self._rows, self.observations, self._everywhere)
        return self.observations

    def _begin(self, worlds: NDArray[np.int64]) -> None:
        """Begin an episode in some worlds, given by their numbers, each with a newly drawn seed."""
        for number in worlds.tolist():
            generator = np.random.default_rng(int(self._seeds.integers(2**63)))
            read_rng_state(generator, self._rng_states[number])
        numbers = np.ascontiguousarray(worlds, np.int64)
        self._table[entries.WORLDS] = numbers.ctypes.data
        self._table[entries.COUNT] = len(numbers)
        if self._library.layouts(self._table.ctypes.data):
            raise_fault(self._program, self._table, world=int(self._table[FAULT + 4]))

    def step(self, actions: NDArray[np.int64]) -> tuple[NDArray[Any], NDArray[np.float64], NDArray[np.bool_]]:
        """Make one joint step in each world; the arguments and results are those of `TeamBatch.step`."""
        self.check_actions(actions)
        numbers = np.ascontiguousarray(actions)
        rewards = np.zeros(actions.shape)
        flags = self._terminated, self._truncated, self._stepped
        status = act_teams(self._rows, numbers, self.observations, rewards, *flags, False)
        if status < 0:
            raise self._refusal(~status, numbers)
        if self._library.steps is not None:
            self._table[entries.ACTIONS] = numbers.ctypes.data
            self._table[entries.REWARDS] = rewards.ctypes.data
            if self._library.steps(self._table.ctypes.data):
                raise_fault(self._program, self._table, world=int(self._table[FAULT + 4]))
        if getattr(type(self.world), "shared_reward", True):
            rewards[:] = self._sum_over_bodies(rewards)
        self.ends[:] = self._terminated | self._truncated
        if self.ends.any():
            self._begin(np.flatnonzero(self.ends))
        see_teams(self._rows, self.observations, self._everywhere)
        return self.observations, rewards, self.ends

    @staticmethod
    def _sum_over_bodies(rewards: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return each world's total reward of all bodies, float64[worlds, 1], added from the first body to the last.

        `TeamGrid.step` adds them in this order, too.
        """
        total = np.zeros(len(rewards))
        for body in range(rewards.shape[1]):
            total += rewards[:, body]
        return total[:, None]

    def _refusal(self, world: int, actions: NDArray[np.int64]) -> WorldError:
        """Return the error for a joint action that a world cannot take."""
        if self._rows[world, PHASE] == NEW:
            return WorldError("the batch has not been reset; call reset() before step()")
        last = self._rows[world, ACTIONS] - 1
        return WorldError(f"actions {actions[world].tolist()} do not all exist in world {world}; use 0 to {last}")
