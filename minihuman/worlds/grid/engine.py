"""GridEngine: the Gymnasium environment that is the base of every grid world.

It holds one row of state and its random stream. `core.rules` defines what an action does; subclasses lay out the
episodes. The module also makes the map of a state.
"""

import abc
import sys
from collections.abc import Mapping, Sequence
from copy import deepcopy
from operator import index
from types import MappingProxyType
from typing import Any, ClassVar, NamedTuple

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.colours import COLOURS, Colour
from minihuman.worlds.contract import NativeWorld, Palette, PathLengthBounds, View
from minihuman.worlds.grid.babyai.encoding import clauses_done, instructed_length
from minihuman.worlds.grid.babyai.instruction_space import InstructionSpace
from minihuman.worlds.grid.babyai.verifier import act_instructed, hand_over, step_instructed
from minihuman.worlds.grid.core import state as fields
from minihuman.worlds.grid.core.cells import EMPTY, LAVA, UNSEEN, WALL, colour_of, kind_of
from minihuman.worlds.grid.core.rewards import DODGE, INSTRUCTED
from minihuman.worlds.grid.core.rules import ACTION_NAMES, NO_SUCH_ACTION, TERMINATED, TRUNCATED, act, step
from minihuman.worlds.grid.core.state import Row, State, clear, row_length
from minihuman.worlds.grid.core.view import see, see_size
from minihuman.worlds.grid.layout import to_text
from minihuman.worlds.grid.minigrid_compat import MinigridCompat
from minihuman.worlds.grid.missions import MissionSpace
from minihuman.worlds.grid.object_kinds import ObjectKind, check_kinds, kind_name
from minihuman.worlds.grid.pictures.drawing import draw_grid
from minihuman.worlds.grid.pictures.tiles import GRID_PALETTES, OBJECT_COLOURS, GridPalette, hex_colour
from minihuman.worlds.grid.planner import path_length_bounds, shortest_path
from minihuman.worlds.hashing import hash64, quick_hash64
from minihuman.worlds.human_window import ShowsItself
from minihuman.worlds.options import MAX_CELLS, check_bool, check_one_of, check_whole
from minihuman.worlds.pose import Map, Pose, Thing, wall_outlines
from minihuman.worlds.rng import RngState, read_rng_state, write_rng_state
from minihuman.worlds.step_limit import action_number, check_max_steps

# skips the check of `GridEnv.__setattr__` for what every reset sets: a reset takes most of the time of a short episode
set_attribute = object.__setattr__


def floor_plan(state: State, palette: GridPalette = "classic", kinds: Sequence[ObjectKind] = ()) -> Map:
    """Return the map of a state, in cells: the outlines of walls, and the object, floor, goal or lava in each cell."""
    cell_kinds = state.kinds
    walls = wall_outlines(cell_kinds == WALL)
    things = []
    for x, y in np.argwhere((cell_kinds != WALL) & (cell_kinds != EMPTY)).tolist():
        code = int(state.cells[x, y])
        kind = kind_name(kind_of(code), kinds)
        colour = COLOURS[colour_of(code)]
        if kind_of(code) == LAVA:
            name = kind
        else:
            name = f"{colour} {kind}"
        things.append(Thing(name, float(x), float(y), radius=0.5, colour=hex_colour(code, palette)))
    bounds = (-0.5, -0.5, state.width - 0.5, state.height - 0.5)
    return Map("cell", bounds, walls, tuple(things))


MOST_LINES = 32 * MAX_CELLS  # the largest width or height, in pixels, of a picture that `render` draws
_COMPILED = ("step", "advance", "observation", "look", "frame", "picture", "tiles")  # done by kernels unless overridden
YAWS_RAD = (0.0, -np.pi / 2, np.pi, np.pi / 2)  # by direction: right, down, left, up


class GridSnapshot(NamedTuple):
    """An exact copy of a grid world in mid-episode, including its random stream."""

    row: Row
    rng_state: RngState
    mission: str
    kept: dict[str, Any]


def _list_hashed(saved: GridSnapshot) -> list[Any]:
    """Return what is hashed of a snapshot. A half draw of the random stream counts only while it is buffered."""
    has_half_draw = saved.rng_state[4]
    rng_state = saved.rng_state if has_half_draw else saved.rng_state[:4]
    return [saved.row, rng_state, saved.mission, saved.kept]


class GridEngine(ShowsItself, gymnasium.Env[dict[str, Any], int], MinigridCompat, NativeWorld, abc.ABC):
    """A grid world without a layout.

    `GridEnv` has the layouts of the catalogue; `GridWorld` is for layouts that you write.

    Args:
        width: the number of columns, 3 or more, including the outer walls.
        height: the number of rows, 3 or more, including the outer walls.
        max_steps: the number of steps after which an episode is truncated; success earns ``1 - 0.9 * step /
            max_steps``.
        mission: the mission in words, or the space of all missions that an episode may have.
        see_through_walls: whether the agent sees through walls.
        agent_view_size: the number of cells on a side of the agent's view, odd, 3 to 61.
        actions: how many of the seven actions the world has.
        render_mode: what `render` returns: nothing (None), the whole world as text ("ansi"), nothing but a window that
            shows the world ("human"), or, for any other word as in Minigrid, a picture of the whole world
            ("rgb_array").
        tile_size: the number of pixels on a side of a cell that `render` draws.
        palette: the colours of pictures: "classic", "colour-safe" for colour-blind people, or "minigrid" for exactly
            Minigrid's tiles, also in what participants see.
        highlight: whether `render` lightens the cells that the agent sees.
        agent_pov: whether `render` draws what the agent sees instead of the whole world.
        screen_size: accepted as in Minigrid, but ignored: the window has the size of the picture that `render` draws.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array", "ansi"], "render_fps": 10}  # noqa: RUF012  # Gymnasium's name and type
    kinds: ClassVar[tuple[ObjectKind, ...]] = ()  # the world's own kinds of objects, at most five
    kept: ClassVar[tuple[str, ...]] = ()  # own attributes that change in an episode: saved and hashed with the state

    # cells (column, row) that pictures tint, each with a colour and an opacity from 0 to 1; saved and hashed with the
    # state, not observed by agents, and removed by every reset
    cell_marks: Mapping[tuple[int, int], tuple[Colour, float]] = MappingProxyType({})

    def __init__(
        self,
        *,
        width: int,
        height: int,
        max_steps: int,
        mission: str | MissionSpace | InstructionSpace = "",
        see_through_walls: bool = False,
        agent_view_size: int = 7,
        actions: int = 7,
        render_mode: str | None = None,
        tile_size: int = 32,
        palette: GridPalette = "classic",
        highlight: bool = True,
        agent_pov: bool = False,
        screen_size: int | None = 640,
    ) -> None:
        check_whole("width", width, 3, MAX_CELLS)
        check_whole("height", height, 3, MAX_CELLS)
        check_bool("see_through_walls", see_through_walls)
        check_one_of("palette", palette, GRID_PALETTES)
        check_whole("tile_size", tile_size, 1, MOST_LINES // max(width, height))
        if not isinstance(render_mode, str | None):
            raise WorldError(f"render_mode is {render_mode!r}; use one of {', '.join(self.metadata['render_modes'])}")
        self.action_names = self._name_actions(actions)
        self.mission_space = MissionSpace(mission) if isinstance(mission, str) else mission
        self.mission = self.mission_space.first()
        self.action_space = spaces.Discrete(actions)  # type: ignore[assignment]  # its numbers are NumPy's
        self.image_shape = (see_size(agent_view_size), agent_view_size, 3)
        self.observation_space = spaces.Dict(
            {
                "image": spaces.Box(0, 255, self.image_shape, np.uint8),
                "direction": spaces.Discrete(4),
                "mission": self.mission_space,
            }
        )
        self.render_mode = render_mode
        self.tile_size = tile_size
        self.screen_size = screen_size
        self.palette: GridPalette = palette
        self.highlight = check_bool("highlight", highlight)
        self.agent_pov = check_bool("agent_pov", agent_pov)
        self._instructed = isinstance(self.mission_space, InstructionSpace)
        self._row = np.zeros((instructed_length if self._instructed else row_length)(width, height), np.int32)
        self._row[[fields.WIDTH, fields.HEIGHT, fields.MAX_STEPS, fields.SEE_THROUGH, fields.ACTIONS]] = (
            width,
            height,
            check_max_steps(max_steps),
            bool(see_through_walls) | check_kinds(self.kinds),
            actions,
        )
        self._rng_state: RngState = np.zeros(6, np.uint64)
        self._stream_is_held = False  # `_rng_state` is current: nothing has drawn from the generator since
        self._stream_is_ahead = False  # kernels may have drawn from `_rng_state`, and the generator is out of date
        self._draws = False  # whether a step draws random numbers
        clear(self._row)

    def _name_actions(self, actions: int) -> tuple[str, ...]:
        """Return the grid's action names, and a numbered name for each further action.

        Raises:
            WorldError: if there are further actions, but the class does not define rules for them.
        """
        if actions > len(ACTION_NAMES) and not self._has_own_rules():
            raise WorldError(
                f"actions is {actions}, but {type(self).__name__} has the grid's {len(ACTION_NAMES)} alone; ask for "
                f"{len(ACTION_NAMES)} or fewer, or write reward_and_done, which says what the others do"
            )
        return (*ACTION_NAMES[:actions], *(f"action_{number}" for number in range(len(ACTION_NAMES), actions)))

    def _has_own_rules(self) -> bool:
        """Return whether the class has rules for a step that the grid's kernels do not know."""
        return any(getattr(type(self), name) is not getattr(GridEngine, name) for name in ("step", "advance"))

    @abc.abstractmethod
    def _lay_out(self) -> None:
        """Fill the cleared row with a new episode, drawing from ``np_random``, and set the mission."""

    @property
    def state(self) -> State:
        """Return the state, with named fields; writing to its arrays changes the world."""
        return State(self._row)

    @property
    def max_steps(self) -> int:
        """Return the number of steps after which an episode is truncated."""
        return self.state.max_steps

    @max_steps.setter
    def max_steps(self, steps: int) -> None:
        self._row[fields.MAX_STEPS] = check_max_steps(steps)

    @property
    def np_random(self) -> np.random.Generator:
        """Return the world's random generator. Read it anew each time: one from before a step may be out of date."""
        generator = super().np_random
        if self._stream_is_ahead:
            write_rng_state(self._rng_state, generator)
        self._stream_is_held = self._stream_is_ahead = False
        return generator

    @np_random.setter
    def np_random(self, value: np.random.Generator) -> None:
        self._np_random = value
        self._stream_is_held = self._stream_is_ahead = False

    def _stream(self) -> RngState:
        """Return the state of the random stream for kernels to draw from, and mark the generator as out of date."""
        if not self._stream_is_held:
            read_rng_state(self.np_random, self._rng_state)
        if not self._stream_is_ahead:  # tested first, because setting an attribute of a `GridEnv` is slow
            self._stream_is_held = self._stream_is_ahead = True
        return self._rng_state

    def _check_agent(self) -> None:
        """Raise a WorldError unless the layout placed an agent inside the grid, with a valid direction."""
        width, height, x, y, direction = self._row[: fields.DIRECTION + 1].tolist()  # the first numbers of every row
        if x < 0:
            raise WorldError(f"{self} placed no agent; place one in its layout")
        if not (x < width and 0 <= y < height and 0 <= direction < 4):
            raise WorldError(
                f"{self} placed the agent in cell ({x}, {y}) looking {direction}; cells are (0, 0) to "
                f"({width - 1}, {height - 1}), directions 0 to 3"
            )

    def _read_stream(self) -> RngState:
        """Return the current state of the random stream, which callers must not change."""
        if not self._stream_is_held:
            read_rng_state(self.np_random, self._rng_state)
            self._stream_is_held = True
        return self._rng_state

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Lay out a new episode; return the observation and an empty info. A failed layout raises a WorldError."""
        if seed is not None:
            self._stream_is_held = self._stream_is_ahead = False
        super().reset(seed=seed)
        set_attribute(self, "cell_marks", {})
        if self._views is not None:
            self._close_object_views()
        clear(self._row)
        self._lay_out()
        if self._row[fields.FAILED]:
            raise WorldError(
                f"{self} with seed {seed!r} has no free cell for something it places, or nothing fits its mission; use "
                "another seed or a larger grid"
            )
        self._check_agent()
        self._row[fields.PHASE] = fields.PLAYING
        set_attribute(self, "_draws", bool(self._row[fields.TASK] == DODGE))
        observation = self.observation()
        if self._row[fields.TASK] == INSTRUCTED:
            hand_over(self._row)
        return observation, {}

    def advance(self, action: int) -> tuple[float, bool, bool]:
        """Take an action without making the observation; return the reward, terminated and truncated."""
        try:
            number = index(action)
        except TypeError:
            number = self._number_of(action)
        if self._draws:
            rng_state = self._stream()
        else:
            rng_state = self._rng_state
        status, reward = (act_instructed if self._instructed else act)(self._row, number, rng_state)
        if status < 0:
            raise self._refusal(status, action)
        return reward, status & TERMINATED != 0, status & TRUNCATED != 0

    def step(self, action: int) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Take an action as Gymnasium defines it; raise a WorldError outside an episode and for an unknown action."""
        try:
            number = index(action)
        except TypeError:
            number = self._number_of(action)
        image = np.empty(self.image_shape, np.uint8)
        if self._draws:
            rng_state = self._stream()
        else:
            rng_state = self._rng_state
        status, direction, reward = (step_instructed if self._instructed else step)(self._row, number, rng_state, image)
        observation = {"image": image, "direction": direction, "mission": self.mission}
        if status == 0:
            return observation, reward, False, False, {}
        if status < 0:
            raise self._refusal(status, action)
        return observation, reward, status & TERMINATED != 0, status & TRUNCATED != 0, {}

    def _number_of(self, action: Any) -> int:
        """Return the number of an action that is not an integer by its type, as `action_number` reads it."""
        number = action_number(action)
        if number is None:
            raise self._refusal(NO_SUCH_ACTION, action)
        return number

    def _refusal(self, status: int, action: Any) -> WorldError:
        """Return the error that says why a step was refused, given its negative status."""
        if status == NO_SUCH_ACTION:
            return WorldError(
                f"action {action!r} does not exist in {self}; actions are 0 to {self._row[fields.ACTIONS] - 1}"
            )
        advice = "; instead of Minigrid's NoDeath, which steps on, use minihuman.worlds.grid.wrappers.NoDeath"
        return WorldError(
            f"{self} is not in an episode; call reset() before step(), and again after each episode"
            f"{advice if 'minigrid.wrappers' in sys.modules else ''}"
        )

    def _in_world(self) -> State:
        """Return the state, or raise a WorldError before the first reset."""
        self._check_laid_out()
        return State(self._row)

    def _check_laid_out(self) -> None:
        if self._row[fields.PHASE] == fields.NEW:
            raise WorldError(f"{self} has not been reset; call reset() first")

    def observation(self) -> dict[str, Any]:
        """Return the agent's current observation."""
        image = self.look(self.image_shape[0])
        return {"image": image, "direction": int(self._row[fields.DIRECTION]), "mission": self.mission}

    def look(self, size: int) -> NDArray[np.uint8]:
        """Return the agent's view with ``size`` cells on a side, uint8[size, size, 3]."""
        self._check_laid_out()
        image = np.empty((size, size, 3), np.uint8)
        see(self._row, image)
        return image

    def render(self) -> NDArray[np.uint8] | str | None:
        """Return the picture or text of the render mode; None without a mode, and for "human", which shows a window."""
        if self.render_mode is None:
            return None
        if self.render_mode == "ansi":
            return self.text()
        if self.render_mode == "human":
            self.show_in_window(self._rendered)
            return None
        return self._rendered()

    def _rendered(self) -> NDArray[np.uint8]:
        view: View = "partial" if self.agent_pov else "full"
        return self.frame(view=view, tile_px=self.tile_size, lit=self.highlight)

    def frame(self, *, view: View = "full", tile_px: int = 32, lit: bool = True) -> NDArray[np.uint8]:
        """Return a picture of the world ("full") or of what the agent sees ("partial"); tiles are ``tile_px`` wide."""
        return self._draw(view, tile_px, self.palette, lit=lit)

    def _draw(self, view: View, tile_px: int, palette: GridPalette, *, lit: bool = True) -> NDArray[np.uint8]:
        row = self._in_world().row
        size = self.image_shape[0]
        picture = draw_grid(row, view=view, view_size=size, tile_px=tile_px, palette=palette, kinds=self.kinds, lit=lit)
        for cell, (colour, opacity) in self.cell_marks.items():
            is_inside = 0 <= cell[0] < self.state.width and 0 <= cell[1] < self.state.height
            if colour not in COLOURS or not (0 <= opacity <= 1 and is_inside):
                raise WorldError(
                    f"cell_marks has {cell}: {(colour, opacity)}; give a cell of the grid, one of "
                    f"{', '.join(COLOURS)}, and an opacity from 0 to 1"
                )
            tile = cell if view == "full" else self.relative_coords(*cell)
            if tile is None or (view == "partial" and self.look(size)[tile][0] == UNSEEN):
                continue
            left = tile[0] * tile_px
            top = tile[1] * tile_px
            pixels = picture[top : top + tile_px, left : left + tile_px]
            rgb = np.array(OBJECT_COLOURS[palette][COLOURS.index(colour)])
            pixels[:] = (pixels + (rgb - pixels) * opacity).round()
        return picture

    def pose(self) -> Pose:
        """Return the agent's cell (column, 0, row) and direction (yaw in radians)."""
        state = self._in_world()
        x, y = state.position
        return Pose(float(x), 0.0, float(y), YAWS_RAD[state.direction])

    def map(self) -> Map:
        """Return the floor plan with doors, objects and goal at their current places."""
        return floor_plan(self._in_world(), self.palette, self.kinds)

    def subgoals(self) -> tuple[tuple[str, int], ...]:
        """Return the instruction's clauses, each with the step that completed it, or 0; empty without instruction."""
        if self._row[fields.TASK] == INSTRUCTED:
            return clauses_done(self._row)
        return ()

    def shortest_path(self) -> Sequence[int] | None:
        """Return the fewest actions to success, or more if these take too long to find; empty if there are none."""
        return shortest_path(self._in_world(), self._read_stream()) or ()

    def path_length_bounds(self) -> PathLengthBounds:
        """Return bounds on the number of actions to success, equal if it is known; None for a bound that is not."""
        return path_length_bounds(self._in_world(), self._read_stream())

    def state_hash(self) -> int:
        """Return a uint64 hash of the layout, agent, task, mission, random stream and kept attributes."""
        return hash64(_list_hashed(self._share_snapshot()))

    def scene_hash(self) -> int:
        """Return the hash of the state without the number of steps taken; it is in no log, so that it can be quick."""
        step = self._row[fields.STEP]
        self._row[fields.STEP] = 0
        try:
            return quick_hash64(_list_hashed(self._share_snapshot()))
        finally:
            self._row[fields.STEP] = step

    def save(self) -> GridSnapshot:
        """Return an exact copy of the state in mid-episode."""
        row, rng_state, mission, attributes = self._share_snapshot()
        return GridSnapshot(row.copy(), rng_state.copy(), mission, deepcopy(attributes) if attributes else attributes)

    def _share_snapshot(self) -> GridSnapshot:
        """Return the snapshot that `save` copies; its arrays and attributes are those of the world itself."""
        attributes = {name: getattr(self, name) for name in self.kept}
        if self.cell_marks:
            attributes["cell_marks"] = [[*cell, *mark] for cell, mark in self.cell_marks.items()]
        return GridSnapshot(self._row, self._read_stream(), self.mission, attributes)

    def restore(self, saved: GridSnapshot) -> None:
        """Restore a saved state, which may be restored again; raise a WorldError if the world has another size."""
        if saved.row.shape != self._row.shape or saved.row[:2].tolist() != self._row[:2].tolist():
            raise WorldError(
                f"the saved state is {saved.row[fields.WIDTH]} x {saved.row[fields.HEIGHT]} cells and {self} is "
                f"{self._row[fields.WIDTH]} x {self._row[fields.HEIGHT]}; restore it into a world of the same size"
            )
        self._close_object_views()
        self._row[:] = saved.row
        self._rng_state[:] = saved.rng_state
        cell_marks = {(x, y): (colour, opacity) for x, y, colour, opacity in saved.kept.get("cell_marks", ())}
        set_attribute(self, "_draws", bool(self._row[fields.TASK] == DODGE))
        set_attribute(self, "_stream_is_held", True)
        set_attribute(self, "_stream_is_ahead", True)
        set_attribute(self, "mission", saved.mission)
        set_attribute(self, "cell_marks", cell_marks)
        for name in self.kept:
            setattr(self, name, deepcopy(saved.kept[name]))

    def picture(
        self, *, view: View = "partial", size_px: tuple[int, int] = (640, 480), palette: Palette = "classic"
    ) -> NDArray[np.uint8]:
        """Return the largest picture of whole-numbered tiles that fits ``size_px`` (width, height): uint8[H, W, 3]."""
        tile_px, tile_palette = self.tiles(view, size_px, palette)
        return self._draw(view, tile_px, tile_palette)

    def tiles(self, view: View, size_px: tuple[int, int], palette: Palette) -> tuple[int, GridPalette]:
        """Return the size in pixels and the palette of the tiles that `picture` draws with the same arguments."""
        size = self.image_shape[0]
        columns, rows = (size, size) if view == "partial" else (self.state.width, self.state.height)
        tile_px = max(1, min(size_px[0] // columns, size_px[1] // rows))
        return tile_px, self.palette if self.palette == "minigrid" else palette

    @property
    def is_compiled(self) -> bool:
        """Return whether compiled kernels alone step and draw the world, on its row."""
        return self._is_plain(GridEngine)

    def _is_plain(self, base: type) -> bool:
        """Return whether the world steps, observes and draws as a base class does, and its row is its only state."""
        return (
            not self.kept
            and not self.cell_marks
            and all(getattr(type(self), name) is getattr(base, name) for name in _COMPILED)
        )

    def is_kind(self, code: int, kind: ObjectKind) -> bool:
        """Return whether a code, of a cell or of what the agent carries, has the given one of the world's own kinds."""
        own_number = kind_of(int(code)) - fields.FIRST_OWN_KIND
        return own_number >= 0 and self.kinds[own_number] == kind

    def text(self) -> str:
        """Return the grid as a diagram of characters; see `layout`."""
        return to_text(self._in_world(), self.kinds)

    def __str__(self) -> str:
        if self.spec is None:
            return type(self).__name__
        return self.spec.id
