"""TeamGrid: a grid with 1 to 8 bodies, laid out in plain Python. Joint actions are compiled.

A subclass sets `bodies` and writes `layout`, which places each of them. `core.bodies` has the rules for moves.
"""

import abc
from collections.abc import Sequence
from copy import deepcopy
from importlib import import_module
from typing import Any, ClassVar, NamedTuple

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.contract import Palette, View
from minihuman.worlds.grid.core import state as fields
from minihuman.worlds.grid.core.bodies import (
    MAX_BODIES,
    STAY,
    TEAM_ACTION_NAMES,
    body_index,
    clear_bodies,
    see_body,
    step_team,
    team_row_length,
)
from minihuman.worlds.grid.core.cells import EMPTY, kind_of
from minihuman.worlds.grid.core.rules import TERMINATED, TRUNCATED
from minihuman.worlds.grid.core.state import Row, State, clear
from minihuman.worlds.grid.core.view import see_size
from minihuman.worlds.grid.engine import YAWS_RAD, floor_plan
from minihuman.worlds.grid.layout import Layout
from minihuman.worlds.grid.object_kinds import ObjectKind, check_kinds
from minihuman.worlds.grid.own.acts import OwnRules
from minihuman.worlds.grid.own.fields import OwnField, declare_fields, own_numbers
from minihuman.worlds.grid.pictures.team_pictures import draw_team
from minihuman.worlds.hashing import hash64
from minihuman.worlds.options import MAX_CELLS, check_bool, check_one_of, check_whole
from minihuman.worlds.pose import Map, Pose
from minihuman.worlds.rng import RngState, read_rng_state, write_rng_state
from minihuman.worlds.step_limit import check_max_steps
from minihuman.worlds.team import TeamBatch, TeamStep, TeamWorld


class TeamSnapshot(NamedTuple):
    """An exact copy of a team's grid in mid-episode, including its random stream."""

    row: Row
    rng_state: RngState
    mission: str
    kept: dict[str, Any]


class TeamGrid(OwnRules, TeamWorld, abc.ABC):
    """A grid with several bodies, each of which has its own view.

    Args:
        width: the number of columns, 3 or more, including the outer walls.
        height: the number of rows, 3 or more, including the outer walls.
        max_steps: the number of joint steps after which an episode is truncated; success earns ``1 - 0.9 * step /
            max_steps``.
        mission: the mission in words.
        see_through_walls: whether bodies see through walls.
        agent_view_size: the number of cells on a side of each body's view, odd, 3 to 61.
        view: what a person sees: the body's own view ("partial") or the whole grid ("full").
    """

    bodies: int = 2
    kinds: ClassVar[tuple[ObjectKind, ...]] = ()  # the world's own kinds of objects, at most five
    kept: ClassVar[tuple[str, ...]] = ()  # own attributes that change in an episode: saved and hashed with the state
    shared_reward: ClassVar[bool] = True  # each body earns what all earn together; otherwise its own
    own_fields: ClassVar[tuple[OwnField, ...]] = ()  # the declared fields of the class and its bases
    action_names = TEAM_ACTION_NAMES
    idle_action = STAY
    _has_own_reward: ClassVar[bool] = False

    def __init_subclass__(cls, **kwargs: Any) -> None:
        """Record whether the subclass defines its rewards, and place its declared fields."""
        super().__init_subclass__(**kwargs)
        declare_fields(cls)
        cls._has_own_reward = cls.reward_and_done is not TeamGrid.reward_and_done

    def __init__(
        self,
        *,
        width: int,
        height: int,
        max_steps: int,
        mission: str = "",
        see_through_walls: bool = False,
        agent_view_size: int = 7,
        view: View = "partial",
    ) -> None:
        check_whole("bodies", self.bodies, 1, MAX_BODIES)
        check_whole("width", width, 3, MAX_CELLS)
        check_whole("height", height, 3, MAX_CELLS)
        self.mission = mission
        self.max_steps = check_max_steps(max_steps)
        self.view: View = check_one_of("view", view, ("partial", "full"))
        size = see_size(agent_view_size)
        self.observation_space = spaces.Box(0, 255, (size, size, 3), np.uint8)
        self._first_mission = mission
        self._row = np.zeros(team_row_length(width, height, self.bodies), np.int32)
        self._row[[fields.WIDTH, fields.HEIGHT, fields.MAX_STEPS, fields.SEE_THROUGH, fields.ACTIONS]] = (
            width,
            height,
            self.max_steps,
            check_bool("see_through_walls", see_through_walls) | check_kinds(self.kinds),
            len(TEAM_ACTION_NAMES),
        )
        self._images = np.zeros((self.bodies, size, size, 3), np.uint8)
        self._rewards = np.zeros(self.bodies)
        self._actions = np.zeros(self.bodies, np.int64)
        self._rng_state: RngState = np.zeros(6, np.uint64)
        self.np_random = np.random.default_rng(0)

    @abc.abstractmethod
    def layout(self, grid: Layout) -> None:
        """Lay out an episode on an empty grid. The method must place every body: ``grid.place_agent(body=1)``."""

    def reward_and_done(
        self, actions: Sequence[int], rewards: tuple[float, ...], terminated: bool
    ) -> tuple[tuple[float, ...], bool]:
        """Return the rewards of a joint step that was made, and whether it ended the episode.

        The arguments ``rewards``, one per body, and ``terminated`` are what goals and lava imply. The method may change
        the world (through ``self.state``); the observations are made afterwards.
        """
        return rewards, terminated

    @property
    def first_mission(self) -> str:
        """Return the mission of every episode in which the layout sets none."""
        return self._first_mission

    @property
    def state(self) -> State:
        """Return the state, with named fields. Its agent is body 0."""
        return State(self._row)

    def reset(self, seed: int | None = None) -> None:
        """Lay out a new episode.

        Raises:
            WorldError: if the layout does not place every body, or finds no free cell for an object.
        """
        seed = self.choose_seed(seed)
        self.np_random = np.random.default_rng(seed)
        clear(self._row)
        clear_bodies(self._row)
        own_numbers(self)[:] = 0
        self._lay_out()
        if self._row[fields.FAILED]:
            raise WorldError(
                f"{type(self).__name__} with seed {seed!r} has no free cell for something it places; make the grid "
                "larger"
            )
        self._require_separate_bodies()
        self._row[fields.PHASE] = fields.PLAYING
        self._look()

    def _require_separate_bodies(self) -> None:
        """Raise WorldError if a body has no cell, or stands in the cell of another."""
        body_by_cell: dict[tuple[int, ...], int] = {}
        for body in range(self.bodies):
            cell = tuple(self._body(body)[:2])
            if min(cell) < 0:
                mistake = "nowhere"
            elif cell in body_by_cell:
                mistake = f"where body {body_by_cell[cell]} stands"
            else:
                body_by_cell[cell] = body
                continue
            raise WorldError(f"{type(self).__name__} placed body {body} {mistake}; give each a cell of its own")

    def _lay_out(self) -> None:
        """Lay out an episode by the compiled rules if there are any, or else by `layout`."""
        rules = self._load_rules()
        if rules is not None:
            read_rng_state(self.np_random, self._rng_state)
            self.mission = rules.lay_out(self)
            write_rng_state(self._rng_state, self.np_random)
            return
        grid = Layout(self._row, self.np_random, self._first_mission, self.kinds, self.bodies)
        self.layout(grid)
        self.mission = grid.mission

    def _look(self) -> None:
        """Update the view of every body."""
        for body in range(self.bodies):
            see_body(self._row, body, self._images[body])

    def _body(self, body: int) -> list[int]:
        """Return a body's column, row, direction and the code of the object that it carries."""
        check_whole("body", body, 0, self.bodies - 1)
        first = body_index(self._row, body)
        numbers: list[int] = self._row[first : first + 4].tolist()
        return numbers

    def held_by(self, body: int) -> int | None:
        """Return the code of the object that a body carries; None if it carries nothing."""
        code = self._body(body)[3]
        return None if code == EMPTY else code

    def batch(self, num_worlds: int) -> TeamBatch:
        """Return a batch of copies of this world, whose rules are compiled where they can be translated."""
        make_batch = import_module("minihuman.worlds.grid.own.team_batch").make_team_batch
        batch: TeamBatch = make_batch(self, num_worlds)
        return batch

    def step(self, actions: Sequence[int]) -> TeamStep:
        """Make one joint step, with one action per body.

        Raises:
            WorldError: outside an episode, for a wrong number of actions, and for an action that does not exist.
        """
        if len(actions) != self.bodies:
            self.check_actions(actions)
        self._actions[:] = actions
        status = step_team(self._row, self._actions, self._images, self._rewards)
        if status < 0:
            self.check_actions(actions)
            raise WorldError(
                f"{type(self).__name__} is not in an episode; call reset() before step(), and again after each episode"
            )
        rewards = tuple(self._rewards.tolist())
        terminated = status & TERMINATED != 0
        if self._has_own_reward:
            rewards, terminated = self._judge(actions, rewards, terminated)
            self._row[fields.PHASE] = fields.OVER if terminated or status & TRUNCATED else fields.PLAYING
            self._look()
        if self.shared_reward:
            rewards = (sum(rewards),) * self.bodies
        return TeamStep(rewards, terminated, status & TRUNCATED != 0)

    def _judge(
        self, actions: Sequence[int], rewards: tuple[float, ...], terminated: bool
    ) -> tuple[tuple[float, ...], bool]:
        """Run `reward_and_done`, compiled if possible; return the rewards and whether the episode ended."""
        rules = self._compiled_rules
        if rules is None or not rules.has_reward:
            return self.reward_and_done(actions, rewards, terminated)
        if not rules.draws:
            earned: tuple[tuple[float, ...], bool] = rules.judge_team(self._actions, rewards, terminated)
            return earned
        read_rng_state(self.np_random, self._rng_state)
        earned = rules.judge_team(self._actions, rewards, terminated)
        write_rng_state(self._rng_state, self.np_random)
        return earned

    def body(self, body: int) -> tuple[int, int, int, int]:
        """Return a body's column, row, direction and the code of the object that it carries, EMPTY for none."""
        x, y, direction, carried = self._body(body)
        return x, y, direction, carried

    def is_kind(self, code: int, kind: ObjectKind) -> bool:
        """Return whether a code, of a cell or of what a body carries, has the given one of the world's own kinds."""
        number = kind_of(int(code)) - fields.FIRST_OWN_KIND
        return number >= 0 and self.kinds[number] == kind

    def observation(self, body: int) -> NDArray[np.uint8]:
        """Return a body's view, uint8[size, size, 3]: kind, colour, state. Other bodies have the kind "agent"."""
        return self._images[body].copy()

    def frame(self, body: int, width: int, height: int, *, palette: Palette = "classic") -> NDArray[np.uint8]:
        """Return the largest picture with whole-numbered tiles, for a body, that fits the size in pixels."""
        size = len(self._images[0])
        columns, rows = (size, size) if self.view == "partial" else (self.state.width, self.state.height)
        tile_px = max(1, min(width // columns, height // rows))
        looks: dict[str, Any] = {"view": self.view, "view_size": size, "tile_px": tile_px, "palette": palette}
        return draw_team(self._row, check_whole("body", body, 0, self.bodies - 1), kinds=self.kinds, **looks)

    def pose(self, body: int) -> Pose:
        """Return a body's cell (column, 0, row) and direction (yaw in radians)."""
        x, y, direction, _ = self._body(body)
        return Pose(float(x), 0.0, float(y), YAWS_RAD[direction])

    def map(self) -> Map:
        """Return the floor plan with doors, objects and goals at their current places."""
        return floor_plan(self.state, kinds=self.kinds)

    def state_hash(self) -> int:
        """Return a uint64 hash of the layout, bodies, task, mission, random stream and kept attributes."""
        saved = self.save()
        n_numbers = 6 if saved.rng_state[4] else 4  # the last two are a buffered half draw, if there is one
        hashed = [saved.row, saved.rng_state[:n_numbers], saved.mission]
        return hash64([*hashed, saved.kept] if self.kept else hashed)

    def save(self) -> TeamSnapshot:
        """Return an exact copy of the state in mid-episode."""
        rng_state: RngState = np.zeros(6, np.uint64)
        read_rng_state(self.np_random, rng_state)
        attributes = {name: deepcopy(getattr(self, name)) for name in self.kept}
        return TeamSnapshot(self._row.copy(), rng_state, self.mission, attributes)

    def restore(self, saved: TeamSnapshot) -> None:
        """Restore a saved state.

        Raises:
            WorldError: if it is of a world of another size or with another number of bodies.
        """
        if saved.row.shape != self._row.shape or not np.array_equal(saved.row[:2], self._row[:2]):
            raise WorldError(
                f"the saved state differs in size from {type(self).__name__}; restore it into the world that saved it"
            )
        self._row[:] = saved.row
        write_rng_state(saved.rng_state, self.np_random)
        self.mission = saved.mission
        for name in self.kept:
            setattr(self, name, deepcopy(saved.kept[name]))
        self._look()
