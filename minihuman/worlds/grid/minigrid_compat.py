"""Minigrid's attributes and methods for grid worlds, so that code written for Minigrid's worlds keeps running.

They are views of the current state, made on request; there is no second state. Setting an attribute changes the state,
or is refused. A name of Minigrid's that has no meaning here is refused too, and the error says what to use.
"""

import abc
import hashlib
import math
from collections.abc import Callable, Sequence
from enum import IntEnum
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.colours import COLOURS
from minihuman.worlds.grid.core import rewards
from minihuman.worlds.grid.core.cells import EMPTY, GOAL, KINDS, SORTED_COLOURS, STEPS, UNSEEN, kind_of
from minihuman.worlds.grid.core.rules import ACTION_NAMES
from minihuman.worlds.grid.core.state import CARRYING, DIRECTION, SEE_THROUGH, STEP, TASK, State, X, Y
from minihuman.worlds.grid.core.view import see_all, see_size
from minihuman.worlds.grid.family_names import FAMILY_NAMES, read_family_name
from minihuman.worlds.grid.object_kinds import ObjectKind
from minihuman.worlds.grid.object_views import GridView, ObjectView, ObjectViews
from minihuman.worlds.grid.pictures.drawing import draw_grid
from minihuman.worlds.grid.room_views import RoomGridView, RoomView
from minihuman.worlds.options import check_bool, check_one_of, check_whole
from minihuman.worlds.step_limit import LARGEST_STEP_LIMIT
from minihuman.worlds.upstream_names import UpstreamName, define_names, set_instead

Actions = IntEnum("Actions", ACTION_NAMES, start=0)  # type: ignore[misc]  # mypy reads only names that are written out
Place = tuple[int, int]  # column, row


class MinigridCompat(abc.ABC):
    """Mixin that gives every grid world Minigrid's attributes and methods, based on its ``state``."""

    kinds: ClassVar[tuple[ObjectKind, ...]]
    image_shape: tuple[int, int, int]
    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any:
            """Declare the other attributes of grid worlds for type checkers."""

    _is_made = False  # whether a `GridEnv` has been made, after which it takes no new attribute
    _views: ObjectViews | None = None  # the views of the episode's objects, made when the first is read

    @property
    @abc.abstractmethod
    def state(self) -> State:
        """Return the world's state, with named fields."""

    @property
    def agent_pos(self) -> Place:
        """Return the agent's column and row."""
        return self.state.position

    @agent_pos.setter
    def agent_pos(self, place: Sequence[int]) -> None:
        column, row = place
        if not (0 <= column < self.state.width and 0 <= row < self.state.height):
            raise WorldError(
                f"agent_pos is {place!r}; use a cell from (0, 0) to {self.state.width - 1, self.state.height - 1}"
            )
        self.state.row[[X, Y]] = column, row

    @property
    def agent_dir(self) -> int:
        """Return the direction in which the agent looks: 0 right, 1 down, 2 left, 3 up."""
        return self.state.direction

    @agent_dir.setter
    def agent_dir(self, direction: int) -> None:
        if direction not in range(4):
            raise WorldError(f"agent_dir is {direction!r}; use 0 for right, 1 for down, 2 for left or 3 for up")
        self.state.row[DIRECTION] = direction

    @property
    def carrying(self) -> ObjectView | None:
        """Return the object that the agent carries, or None."""
        return self.object_views().of(self.state.carrying, None)

    @carrying.setter
    def carrying(self, thing: Any) -> None:
        self.state.row[CARRYING] = self.grid.code_for(thing)

    @UpstreamName
    def actions(self) -> type[IntEnum]:
        """Return the seven actions by name. A world may accept fewer."""
        return Actions

    @set_instead("set agent_pos or agent_dir")
    def dir_vec(self) -> NDArray[np.int64]:
        """Return the vector of one step ahead, as (columns, rows)."""
        return np.array(STEPS[self.state.direction])

    @set_instead("set agent_pos or agent_dir")
    def front_pos(self) -> NDArray[np.int64]:
        """Return the column and row of the cell in front of the agent."""
        return np.add(self.state.position, STEPS[self.state.direction])

    @set_instead("set agent_pos or agent_dir")
    def right_vec(self) -> NDArray[np.int64]:
        """Return the vector of one step to the agent's right, as (columns, rows)."""
        right, down = STEPS[self.state.direction]
        return np.array((-down, right))

    @UpstreamName
    def see_through_walls(self) -> bool:
        """Return whether the agent sees through walls."""
        return bool(self.state.row[SEE_THROUGH] & 1)

    @see_through_walls.setter
    def see_through_walls(self, see_through: bool) -> None:
        self.state.row[SEE_THROUGH] = int(self.state.row[SEE_THROUGH]) & ~1 | check_bool(
            "see_through_walls", see_through
        )

    @set_instead("put a Goal into a cell with put_obj()")
    def goal_pos(self) -> Place | None:
        """Return the column and row of the first goal in row order, or None if there is no goal."""
        goals = np.argwhere(self.state.kinds.T == GOAL)
        if len(goals) == 0:
            return None
        row, column = goals[0].tolist()
        return column, row

    @set_instead("put a Goal into a cell with put_obj()")
    def goal_position(self) -> Place | None:
        """Return the same cell as `goal_pos`."""
        return self.goal_pos

    @UpstreamName
    def step_count(self) -> int:
        """Return the number of steps taken in this episode."""
        return self.state.step

    @step_count.setter
    def step_count(self, steps: int) -> None:
        self.state.row[STEP] = check_whole("step_count", steps, 0, LARGEST_STEP_LIMIT)

    @set_instead("set step_count or max_steps")
    def steps_remaining(self) -> int:
        """Return the number of steps that can be taken before the episode is truncated."""
        return self.state.max_steps - self.state.step

    @UpstreamName
    def reward_range(self) -> tuple[int, int]:
        """Return the lowest and the highest reward of an episode, as Minigrid states them. Nothing reads this."""
        return (-1 if self.state.row[TASK] == rewards.DODGE else 0), 1

    @set_instead("give the size when the world is made")
    def width(self) -> int:
        """Return the number of columns."""
        return self.state.width

    @set_instead("give the size when the world is made")
    def height(self) -> int:
        """Return the number of rows."""
        return self.state.height

    @UpstreamName
    def agent_view_size(self) -> int:
        """Return the number of cells on a side of the agent's view."""
        return int(self.image_shape[0])

    @agent_view_size.setter
    def agent_view_size(self, size: int) -> None:
        self.image_shape = see_size(size), size, 3

    @set_instead("set its cells with grid.set(), one by one")
    def grid(self) -> GridView:
        """Return a view of the grid's cells."""
        return GridView(self.object_views())

    @set_instead("make the world with render_mode='human'")
    def window(self) -> Any:
        """Return the window of ``render_mode="human"``, or None if there is none yet."""
        return vars(self).get("_window")

    @set_instead("make the world with render_mode='human'")
    def clock(self) -> Any:
        """Return `window`, which also limits the frame rate."""
        return self.window

    @set_instead("make the world with a tile_size")
    def render_size(self) -> tuple[int, int] | None:
        """Return the width and height of the window's picture in pixels, or None if there is no window yet."""
        tile_px = int(self.tile_size)
        if self.window is None:
            return None
        return (self.width * tile_px, self.height * tile_px)

    def object_views(self) -> ObjectViews:
        """Return the views of this episode's objects."""
        if self._views is None:
            self._views = ObjectViews(self.state, self.kinds)
        return self._views

    def _close_object_views(self) -> None:
        """Freeze the views of the episode that ends here, so that they keep showing its last state."""
        if self._views is not None:
            self._views.freeze()
            self._views = None

    def get_view_coords(self, i: int, j: int) -> Place:
        """Return where the agent's view has the cell (i, j) of the grid, as column and row, even outside the image."""
        right, down = np.subtract((i, j), self.state.position).tolist()
        dx, dy = STEPS[self.state.direction]
        size = int(self.agent_view_size)
        return size // 2 + down * dx - right * dy, size - 1 - (right * dx + down * dy)

    def relative_coords(self, x: int, y: int) -> Place | None:
        """Return where the agent's view has the cell (x, y) of the grid, as column and row; None if it is outside."""
        size = int(self.agent_view_size)
        place = self.get_view_coords(x, y)
        if min(place) >= 0 and max(place) < size:
            return place
        return None

    def get_view_exts(self, agent_view_size: int | None = None) -> tuple[int, int, int, int]:
        """Return the square of the grid that the agent's view covers: left, top, right, bottom, the last two exclusive.

        It has ``agent_view_size`` cells on a side, by default as many as the agent's view.
        """
        size = agent_view_size or int(self.agent_view_size)
        x, y = self.state.position
        # by direction: right, down, left, up
        left = (x, x - size // 2, x - size + 1, x - size // 2)[self.state.direction]
        top = (y - size // 2, y, y - size // 2, y - size + 1)[self.state.direction]
        return left, top, left + size, top + size

    def in_view(self, x: int, y: int) -> bool:
        """Return whether the cell (x, y) is in the square that the agent's view covers, even if it is hidden."""
        return self.relative_coords(x, y) is not None

    def gen_obs_grid(self, agent_view_size: int | None = None) -> tuple[GridView, NDArray[np.bool_]]:
        """Return the agent's view as a grid, turned so that the agent looks up, and which cells it sees.

        The grid has ``agent_view_size`` cells on a side. Cells that the agent does not see are empty; its own cell has
        what it carries.
        """
        size = see_size(agent_view_size or int(self.agent_view_size))
        left, top, _, _ = self.get_view_exts(size)
        grid = self.grid.slice(left, top, size, size)
        for _ in range(self.state.direction + 1):
            grid = grid.rotate_left()
        visible = self.look(size)[..., 0] != UNSEEN
        codes = np.where(visible, grid.codes, EMPTY)
        codes[size // 2, size - 1] = self.state.carrying
        grid.places[size // 2, size - 1] = -1
        return GridView(self.object_views(), codes, grid.places), visible

    def gen_obs(self) -> dict[str, Any]:
        """Return the agent's current observation."""
        return dict(self.observation())

    def agent_sees(self, x: int, y: int) -> bool:
        """Return whether the agent sees the object in the cell (x, y); False if the cell is empty."""
        place = self.relative_coords(x, y)
        if place is None:
            return False
        code = int(self.state.cells[x, y])
        shown_cell = self.look(int(self.agent_view_size))[place]
        return bool(code != EMPTY and shown_cell[0] == kind_of(code))

    def get_frame(self, highlight: bool = True, tile_size: int = 32, agent_pov: bool = False) -> NDArray[np.uint8]:
        """Return a picture of the grid from above, or of what the agent sees, always in Minigrid's own tiles.

        With ``agent_pov``, it shows what the agent sees; with ``highlight``, the cells that the agent sees are lighter
        in the picture from above. A tile has ``tile_size`` pixels on a side.

        Minigrid's wrappers therefore give the same pixels as with Minigrid's worlds. `frame` uses the world's palette.
        """
        return draw_grid(
            self.state.row,
            view="partial" if agent_pov else "full",
            view_size=int(self.agent_view_size),
            tile_px=tile_size,
            palette="minigrid",
            kinds=self.kinds,
            lit=highlight,
        )

    def get_pov_render(self, tile_size: int) -> NDArray[np.uint8]:
        """Return a picture of what the agent sees, as `get_frame` draws it."""
        return self.get_frame(tile_size=tile_size, agent_pov=True)

    def get_full_render(self, highlight: bool, tile_size: int) -> NDArray[np.uint8]:
        """Return a picture of the grid from above, as `get_frame` draws it."""
        return self.get_frame(highlight, tile_size)

    def hash(self, size: int = 16) -> str:
        """Return a hash of the cells and the agent's pose, ``size`` characters long.

        `state_hash` covers the whole state.
        """
        parts = self.grid.encode().tolist(), self.state.position, self.state.direction
        return hashlib.sha256("".join(map(str, parts)).encode()).hexdigest()[:size]

    def put_obj(self, obj: Any, i: int, j: int) -> None:
        """Put an object into the cell (i, j), as `GridView.set` does."""
        self.grid.set(i, j, obj)

    def place_obj(
        self,
        obj: Any,
        top: Sequence[int] | None = None,
        size: Sequence[int] | None = None,
        reject_fn: Callable[[Any, Place], bool] | None = None,
        max_tries: float = math.inf,
    ) -> Place:
        """Put an object into a random empty cell of a rectangle, drawn from ``np_random`` as Minigrid draws it.

        Args:
            obj: the object to put; None to put nothing and only return a cell.
            top: the column and row of the top left cell of the rectangle; by default, that of the grid.
            size: the columns and rows of the rectangle; by default, those of the grid.
            reject_fn: a function that says, given the world and a free cell, whether to reject the cell.
            max_tries: the maximum number of cells to draw, minus 1.

        Returns:
            The cell.

        Raises:
            RecursionError: if none of ``max_tries`` + 1 drawn cells was free and accepted.
        """
        left, upper = (0, 0) if top is None else (max(top[0], 0), max(top[1], 0))
        columns, rows = (self.width, self.height) if size is None else size
        cells = self.state.cells
        rng = self.np_random
        tries = 0
        while tries <= max_tries:
            tries += 1
            place = (
                int(rng.integers(left, min(left + columns, self.width))),
                int(rng.integers(upper, min(upper + rows, self.height))),
            )
            is_free = cells[place] == EMPTY and place != self.state.position
            if is_free and not (reject_fn is not None and reject_fn(self, place)):
                self.grid.set(*place, obj)
                return place
        raise RecursionError(f"no cell was free or accepted in {max_tries} tries; give place_obj a larger rectangle")

    def place_agent(self, *arguments: Any, **named: Any) -> Place:
        """Put the agent into a random empty cell, drawn from ``np_random`` as Minigrid draws it.

        In a grid of equal rooms the arguments are ``i``, ``j`` and ``rand_dir``: the column and row of a room, which
        are drawn if not given. Elsewhere they are ``top``, ``size``, ``rand_dir`` and ``max_tries``.
        """
        if self._room_size:
            return self._place_agent_in_room(*arguments, **named)
        return self._place_agent(*arguments, **named)

    def _place_agent(
        self,
        top: Sequence[int] | None = None,
        size: Sequence[int] | None = None,
        rand_dir: bool = True,
        max_tries: float = math.inf,
    ) -> Place:
        self.state.row[[X, Y]] = -1
        self.agent_pos = self.place_obj(None, top, size, max_tries=max_tries)
        if rand_dir:
            self.agent_dir = int(self.np_random.integers(0, 4))
        return self.agent_pos

    def _place_agent_in_room(self, i: int | None = None, j: int | None = None, rand_dir: bool = True) -> Place:
        rooms = self._rooms()
        rng = self.np_random
        column = int(rng.integers(0, rooms.columns)) if i is None else i
        row = int(rng.integers(0, rooms.rows)) if j is None else j
        room = rooms.room(column, row)
        while True:
            self._place_agent(room.top, room.size, rand_dir, max_tries=1000)
            ahead = self.grid.get(*self.front_pos)
            if ahead is None or ahead.type == "wall":
                return self.agent_pos

    def place_in_room(self, i: int, j: int, obj: Any) -> tuple[ObjectView, Place]:
        """Put an object into a random cell of the room (i, j), not next to the agent, drawn as Minigrid draws it.

        Return the object's view and the cell.

        Raises:
            RecursionError: if no free cell was found.
        """
        room = self.get_room(i, j)
        agent = self.state.position
        place = self.place_obj(
            obj, room.top, room.size, lambda _, at: abs(at[0] - agent[0]) + abs(at[1] - agent[1]) < 2, max_tries=1000
        )
        view = self.grid.get(*place)
        assert view is not None
        return view, place

    def add_object(self, i: int, j: int, kind: str | None = None, color: str | None = None) -> tuple[ObjectView, Place]:
        """Put a new key, ball or box into the room (i, j), and return its view and the cell.

        Its kind and colour are drawn if they are not given.
        """
        rng = self.np_random
        if kind is None:
            kind = ("key", "ball", "box")[int(rng.integers(0, 3))]
        number = KINDS.index(check_one_of("kind", kind, ("key", "ball", "box")))
        if color is None:
            colour = SORTED_COLOURS[int(rng.integers(0, 6))]
        else:
            colour = COLOURS.index(color)
        return self.place_in_room(i, j, self.object_views().make(number, colour))

    def add_distractors(
        self, i: int | None = None, j: int | None = None, num_distractors: int = 10, all_unique: bool = True
    ) -> list[ObjectView]:
        """Put ``num_distractors`` new keys, balls and boxes into rooms, and return their views.

        ``i`` and ``j`` are the column and row of the room; what is None is drawn for each object. With ``all_unique``,
        none has the same kind and colour as another object that can be carried.
        """
        rooms = self._rooms()
        rng = self.np_random
        present = {(cell.type, cell.color) for cell in self.grid.grid if cell is not None and cell.can_pickup()}
        added: list[ObjectView] = []
        while len(added) < num_distractors:
            colour = COLOURS[SORTED_COLOURS[int(rng.integers(0, 6))]]
            kind = ("key", "ball", "box")[int(rng.integers(0, 3))]
            if all_unique and (kind, colour) in present:
                continue
            column = int(rng.integers(0, rooms.columns)) if i is None else i
            row = int(rng.integers(0, rooms.rows)) if j is None else j
            added.append(self.add_object(column, row, kind, colour)[0])
            present.add((kind, colour))
        return added

    @property
    def _room_size(self) -> int:
        """Return the number of cells on a side of each room in a grid of equal rooms, or 0 for other layouts."""
        return int(getattr(vars(self).get("recipe"), "room_size", 0))

    def _rooms(self) -> RoomGridView:
        """Return the rooms of a grid of equal rooms; raise a WorldError in other layouts."""
        if not self._room_size:
            raise WorldError(f"{self} is not a grid of equal rooms, so no cell has a room; compare columns and rows")
        return RoomGridView(self.grid, self._room_size)

    def room_from_pos(self, x: int, y: int) -> RoomView:
        """Return the room that contains the cell (x, y) in a grid of equal rooms.

        Raises:
            WorldError: if the world is not a grid of equal rooms.
        """
        rooms = self._rooms()
        stride = rooms.size - 1  # neighbouring rooms share a wall, which belongs to the room after it
        column = min(x, self.width - 2) // stride  # the last wall belongs to the last room
        row = min(y, self.height - 2) // stride
        return rooms.room(column, row)

    def get_room(self, i: int, j: int) -> RoomView:
        """Return the room in column ``i`` and row ``j`` of the rooms of a grid of equal rooms.

        Raises:
            WorldError: if the world is not a grid of equal rooms, or has no such room.
        """
        return self._rooms().room(i, j)

    def _reward(self) -> float:
        """Return the reward that success would earn at the current step."""
        return float(rewards.success_reward(self.state.row))

    def pprint_grid(self) -> str:
        """Return the grid as a diagram of characters, as `text` does."""
        return str(self.text())

    def full_image(self) -> NDArray[np.uint8]:
        """Return the whole grid with the agent as numbers, uint8[width, height, 3]."""
        image = np.empty((self.state.width, self.state.height, 3), np.uint8)
        see_all(self.state.row, image)
        return image


define_names(MinigridCompat, FAMILY_NAMES, read_family_name)
