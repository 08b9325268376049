"""The attributes and methods of a batch's grid worlds that the batch supports, and copies of its state."""

from collections.abc import Iterator
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.grid.core.state import MAX_STEPS, OBJECTS, SEE_THROUGH, STEP
from minihuman.worlds.grid.engine import GridSnapshot
from minihuman.worlds.grid.env import GridEnv
from minihuman.worlds.grid.layout import Recipe
from minihuman.worlds.rng import RngState
from minihuman.worlds.vector_names import VectorNames

NARROW = np.iinfo(np.int16).max
MOST_OBJECTS = NARROW >> 9  # in a row of int16: an object's identity is in the bits of its code from bit 9 on
RowMatrix = NDArray[np.int16] | NDArray[np.int32]


class GridBatchSnapshot(NamedTuple):
    """An exact copy of a batch's worlds in mid-episode. Only ``save`` makes it, and only ``restore`` reads it."""

    rows: RowMatrix
    rng_states: RngState
    missions: tuple[str, ...]
    seeds: list[int]
    recipes: list[Recipe]
    settings: dict[int, NDArray[np.int32]]


_SETTINGS = {"max_steps": MAX_STEPS, "see_through_walls": SEE_THROUGH}  # index in a row; no layout changes these


class GridBatchNames(VectorNames):
    """Mixin for a batch of grid worlds, in which one environment represents each world in turn."""

    readable: ClassVar[frozenset[str]] = frozenset(
        {"action_names", "actions", "agent_dir", "agent_pos", "agent_view_size", "carrying", "dir_vec", "front_pos"}
        | {"goal_pos", "grid", "height", "instrs", "max_steps", "mission", "obstacles", "render_mode", "right_vec"}
        | {"see_through_walls", "state", "step_count", "steps_remaining", "success_pos", "target_pos", "width"}
    )
    methods: ClassVar[frozenset[str]] = frozenset(
        {"agent_sees", "frame", "full_image", "gen_obs", "get_frame", "in_view", "map", "observation", "picture"}
        | {"path_length_bounds", "place_agent", "place_obj", "pose", "pprint_grid", "put_obj", "relative_coords"}
        | {"render", "save", "scene_hash", "shortest_path", "state_hash", "subgoals", "text"}
    )
    settable: ClassVar[frozenset[str]] = frozenset(
        {"agent_dir", "agent_pos", "carrying", "max_steps", "mission", "see_through_walls", "step_count"}
    )

    _world: GridEnv
    _rows: RowMatrix
    _rng_states: RngState
    _missions: tuple[str, ...]
    _seeds: list[int]
    _recipes: list[Recipe]
    _settings: dict[int, NDArray[np.int32]]

    def worlds_in_turn(self) -> Iterator[GridEnv]:
        """Yield each world in turn, as one environment. Changes made to it are written back to the batch."""
        for i in range(self.num_envs):
            self._world.restore(
                GridSnapshot(self._rows[i].astype(np.int32), self._rng_states[i], self._missions[i], {})
            )
            yield self._world
            self._write_back(i)

    def save(self) -> GridBatchSnapshot:
        """Return an exact copy of every world in mid-episode.

        The copy can be pickled, and restored into a batch of the same size.
        """
        settings = {field: numbers.copy() for field, numbers in self._settings.items()}
        return GridBatchSnapshot(
            self._rows.copy(), self._rng_states.copy(), self._missions, [*self._seeds], [*self._recipes], settings
        )

    def restore(self, saved: GridBatchSnapshot) -> None:
        """Restore a saved state, which may be restored again.

        Raises:
            WorldError: if a batch of another size saved it.
        """
        if not isinstance(saved, GridBatchSnapshot) or saved.rows.shape != self._rows.shape:
            raise WorldError(f"this was not saved by a batch of {self.num_envs} such worlds; pass what save() returned")
        self._rows = saved.rows.copy()
        self._rng_states[:] = saved.rng_states
        self._missions = saved.missions
        self._seeds = [*saved.seeds]
        self._recipes = [*saved.recipes]
        self._settings = {field: numbers.copy() for field, numbers in saved.settings.items()}

    def set_attr(self, name: str, values: Any) -> None:
        """Set an attribute of every world, as `VectorNames.set_attr` does.

        The attributes ``max_steps`` and ``see_through_walls`` also apply to later episodes.
        """
        super().set_attr(name, values)
        if name in _SETTINGS:
            self._settings[_SETTINGS[name]] = self._rows[:, _SETTINGS[name]].astype(np.int32)

    def _write_back(self, i: int) -> None:
        """Write the state of the environment that represents world ``i`` back into the batch."""
        saved = self._world.save()
        if self._rows.itemsize < saved.row.itemsize and (
            saved.row[OBJECTS] > MOST_OBJECTS or max(saved.row[MAX_STEPS], saved.row[STEP]) > NARROW
        ):
            self._rows = self._rows.astype(np.int32)
        self._rows[i] = saved.row
        self._rng_states[i] = saved.rng_state
        if saved.mission != self._missions[i]:
            self._missions = (*self._missions[:i], saved.mission, *self._missions[i + 1 :])
