"""GridEngine: what every grid world is. Holds one row of state; what an action does is in ``rules``."""

import abc
from collections.abc import Sequence
from copy import deepcopy
from operator import index
from typing import Any, ClassVar, Literal, NamedTuple

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.contract import Bounds, NativeWorld, Palette, View
from minihuman.worlds.grid.art.palettes import GRID_PALETTES, GridPalette
from minihuman.worlds.grid.art.pictures import draw
from minihuman.worlds.grid.compile_apart import PIECES
from minihuman.worlds.grid.core.cells import kind_of
from minihuman.worlds.grid.core.chance import Words, read_words, write_words
from minihuman.worlds.grid.core.own import OWN
from minihuman.worlds.grid.core.rules import ACTION_NAMES, NO_SUCH_ACTION, TERMINATED, TRUNCATED, act, step
from minihuman.worlds.grid.core.state import (
    ACTIONS,
    DIRECTION,
    FAILED,
    HEIGHT,
    MAX_STEPS,
    NEW,
    PHASE,
    PLAYING,
    SEE_THROUGH,
    STEP,
    TASK,
    WIDTH,
    Row,
    State,
    clear,
    row_length,
)
from minihuman.worlds.grid.core.tasks import DODGE, INSTRUCTED
from minihuman.worlds.grid.core.view import see, see_size
from minihuman.worlds.grid.floor_plan import floor_plan
from minihuman.worlds.grid.instructions.block import instructed_length
from minihuman.worlds.grid.instructions.numbers import clauses_done
from minihuman.worlds.grid.instructions.rules import act_as_told, step_as_told
from minihuman.worlds.grid.instructions.space import InstructionSpace
from minihuman.worlds.grid.instructions.verify import hand_over
from minihuman.worlds.grid.kinds import Kind, check_kinds
from minihuman.worlds.grid.minigrid_names import MinigridNames
from minihuman.worlds.grid.missions import MissionSpace
from minihuman.worlds.grid.planner import bounds, way
from minihuman.worlds.grid.text import to_text
from minihuman.worlds.hashing import hash64
from minihuman.worlds.options import MOST_CELLS, one_of, truth, whole
from minihuman.worlds.pose import Map, Pose
from minihuman.worlds.whole import check_max_steps

MOST_LINES = 32 * MOST_CELLS  # of pixels that `render` draws
YAWS_RAD = (0.0, -np.pi / 2, np.pi, np.pi / 2)  # by direction


class Saved(NamedTuple):
    """An exact copy of a grid world in mid-episode, its random stream included."""

    row: Row
    words: Words
    mission: str
    kept: dict[str, Any]


def _hashed(saved: Saved) -> int:
    words = saved.words[: 6 if saved.words[4] else 4]  # without a buffered half draw its value means nothing
    return hash64([saved.row, words, saved.mission, saved.kept])


class GridEngine(gymnasium.Env[dict[str, Any], int], MinigridNames, NativeWorld, abc.ABC):
    """A grid world without a layout: `GridEnv` has those of the catalogue, `GridWorld` is for your own.

    Args:
        width: Columns, 3 or more, outer walls included.
        height: Rows, likewise.
        max_steps: Steps after which an episode is truncated; success earns ``1 - 0.9 * step / max_steps``.
        mission: What to do, in words, or the space of all missions an episode may have.
        see_through_walls: Walls hide nothing.
        agent_view_size: Cells on a side of the agent's view, odd, 3 to 61.
        actions: How many of the seven actions there are.
        render_mode: What `render` gives: None, the whole world as a picture ("rgb_array") or as `text` ("ansi").
        tile_size: Pixels on a side of a cell that `render` draws.
        palette: The colours of pictures: "classic", "colour-safe" for colour-blind eyes, or "minigrid": Minigrid's
            own tiles to the pixel, for participants too.
        highlight: Make the cells lighter that the agent sees, in what `render` draws.
        agent_pov: `render` draws what the agent sees instead of the whole world.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array", "ansi"], "render_fps": 10}  # noqa: RUF012  # Gymnasium's name and type
    compile_apart = PIECES
    kinds: ClassVar[tuple[Kind, ...]] = ()  # things of its own, at most five kinds
    kept: ClassVar[tuple[str, ...]] = ()  # own attributes that change in an episode: saved and hashed with the state

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
        render_mode: Literal["rgb_array", "ansi"] | None = None,
        tile_size: int = 32,
        palette: GridPalette = "classic",
        highlight: bool = True,
        agent_pov: bool = False,
    ) -> None:
        whole("width", width, 3, MOST_CELLS)
        whole("height", height, 3, MOST_CELLS)
        truth("see_through_walls", see_through_walls)
        one_of("palette", palette, GRID_PALETTES)
        whole("tile_size", tile_size, 1, MOST_LINES // max(width, height))
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise WorldError(
                f"render_mode is {render_mode!r}; a grid world renders as {', '.join(self.metadata['render_modes'])}"
            )
        self.action_names = ACTION_NAMES[:actions]
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
        self.palette: GridPalette = palette
        self.highlight, self.agent_pov = truth("highlight", highlight), truth("agent_pov", agent_pov)
        self._instructed = isinstance(self.mission_space, InstructionSpace)
        self._row = np.zeros((instructed_length if self._instructed else row_length)(width, height), np.int32)
        self._row[[WIDTH, HEIGHT, MAX_STEPS, SEE_THROUGH, ACTIONS]] = (
            width,
            height,
            check_max_steps(max_steps),
            bool(see_through_walls) | check_kinds(self.kinds),
            actions,
        )
        self._words: Words = np.zeros(6, np.uint64)
        self._words_know = False  # the words hold the stream: nobody can have drawn from the generator since
        self._words_ahead = False  # kernels have drawn since the generator was brought up to date
        self._draws = False  # whether a step draws random numbers
        clear(self._row)

    @abc.abstractmethod
    def _lay_out(self) -> None:
        """Fill the cleared row, drawing from ``np_random``, and set the mission."""

    @property
    def state(self) -> State:
        """The state, readable by name."""
        return State(self._row)

    @property
    def max_steps(self) -> int:
        """An episode is truncated after so many steps."""
        return self.state.max_steps

    @property
    def np_random(self) -> np.random.Generator:
        """The world's random stream. Ask for it each time: a generator kept from before a step may be behind."""
        generator = super().np_random
        if self._words_ahead:
            write_words(self._words, generator)
        self._words_know = self._words_ahead = False
        return generator

    @np_random.setter
    def np_random(self, value: np.random.Generator) -> None:
        self._np_random = value
        self._words_know = self._words_ahead = False

    def _stream(self) -> Words:
        """The random stream for kernels to draw from, in words."""
        if not self._words_know:
            read_words(self.np_random, self._words)
        self._words_know = self._words_ahead = True
        return self._words

    def _check_agent(self) -> None:
        """There is an agent, in the grid, looking somewhere."""
        width, height, x, y, direction = self._row[: DIRECTION + 1].tolist()  # the first numbers of every row
        if x < 0:
            raise WorldError(f"{self} placed no agent; a layout places one")
        if not (x < width and 0 <= y < height and 0 <= direction < 4):
            raise WorldError(
                f"{self} placed the agent in cell ({x}, {y}) looking {direction}; cells are (0, 0) to "
                f"({width - 1}, {height - 1}), directions 0 to 3"
            )

    def _now(self) -> Words:
        """Where the random stream is, in words that are only read."""
        if not self._words_know:
            read_words(self.np_random, self._words)
            self._words_know = True
        return self._words

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Lay out a new episode: observation and an empty info."""
        if seed is not None:
            self._words_know = self._words_ahead = False
        super().reset(seed=seed)
        clear(self._row)
        self._lay_out()
        if self._row[FAILED]:
            raise WorldError(f"{self} with seed {seed!r} has no free place for something, or nothing fits its mission")
        self._check_agent()
        self._row[PHASE] = PLAYING
        self._draws = bool(self._row[TASK] == DODGE)
        observation = self.observation()
        if self._row[TASK] == INSTRUCTED:
            hand_over(self._row)
        return observation, {}

    def advance(self, action: int) -> tuple[float, bool, bool]:
        """A step without its observation: reward, terminated, truncated."""
        try:
            number = index(action)
        except TypeError:
            raise self._refusal(NO_SUCH_ACTION, action) from None
        words = self._stream() if self._draws else self._words
        status, reward = (act_as_told if self._instructed else act)(self._row, number, words)
        if status < 0:
            raise self._refusal(status, action)
        return reward, status & TERMINATED != 0, status & TRUNCATED != 0

    def step(self, action: int) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Act. Raises WorldError before `reset`, after an episode's end, and for an action there is not."""
        try:
            number = index(action)
        except TypeError:
            raise self._refusal(NO_SUCH_ACTION, action) from None
        image = np.empty(self.image_shape, np.uint8)
        words = self._stream() if self._draws else self._words
        status, direction, reward = (step_as_told if self._instructed else step)(self._row, number, words, image)
        observation = {"image": image, "direction": direction, "mission": self.mission}
        if status == 0:
            return observation, reward, False, False, {}
        if status < 0:
            raise self._refusal(status, action)
        return observation, reward, status & TERMINATED != 0, status & TRUNCATED != 0, {}

    def _refusal(self, status: int, action: int) -> WorldError:
        if status == NO_SUCH_ACTION:
            return WorldError(f"action {action!r} is none of {self}'s; they are 0 to {self._row[ACTIONS] - 1}")
        return WorldError(f"{self} is not in an episode; call reset() before step(), and again after an end")

    def _in_world(self) -> State:
        """The state, once there is one to look at."""
        self._check_laid_out()
        return State(self._row)

    def _check_laid_out(self) -> None:
        if self._row[PHASE] == NEW:
            raise WorldError(f"{self} is not laid out yet; call reset() first")

    def observation(self) -> dict[str, Any]:
        """What the agent observes now."""
        image = self.look(self.image_shape[0])
        return {"image": image, "direction": int(self._row[DIRECTION]), "mission": self.mission}

    def look(self, size: int) -> NDArray[np.uint8]:
        """The agent's view with ``size`` cells on a side, uint8[size, size, 3]."""
        self._check_laid_out()
        image = np.empty((size, size, 3), np.uint8)
        see(self._row, image)
        return image

    def render(self) -> NDArray[np.uint8] | str | None:
        """The whole world from above, ``tile_size`` pixels a cell, or in characters; None without a render mode."""
        if self.render_mode is None:
            return None
        if self.render_mode == "ansi":
            return self.text()
        view: View = "partial" if self.agent_pov else "full"
        return self.frame(view=view, tile_px=self.tile_size, lit=self.highlight)

    def frame(self, *, view: View = "full", tile_px: int = 32, lit: bool = True) -> NDArray[np.uint8]:
        """A picture with tiles of this size: of the whole world, or of what the agent sees."""
        row, size = self._in_world().row, self.image_shape[0]
        return draw(row, view=view, view_size=size, tile_px=tile_px, palette=self.palette, kinds=self.kinds, lit=lit)

    def pose(self) -> Pose:
        """The agent's cell (column, 0, row) and direction."""
        state = self._in_world()
        x, y = state.position
        return Pose(float(x), 0.0, float(y), YAWS_RAD[state.direction])

    def map(self) -> Map:
        """The floor plan with doors, objects and goal where they are now."""
        return floor_plan(self._in_world(), self.palette, self.kinds)

    def clauses(self) -> tuple[tuple[str, int], ...]:
        """What the episode's instruction says, clause by clause, each with the step that did it; 0 for none yet."""
        return clauses_done(self._row) if self._row[TASK] == INSTRUCTED else ()

    def way(self) -> Sequence[int] | None:
        """A list of actions to success, the shortest unless that takes too long to find; empty if there is none."""
        return way(self._in_world(), self._now()) or ()

    def bounds(self) -> Bounds:
        """The length of the shortest list, twice, or what it cannot be shorter than and the length of a longer one."""
        return bounds(self._in_world(), self._now())

    def state_hash(self) -> int:
        """A uint64 over layout, agent, task, mission and random stream."""
        return _hashed(self.save())

    def scene_hash(self) -> int:
        """The same without the number of steps taken."""
        saved = self.save()
        saved.row[STEP] = 0
        return _hashed(saved)

    def save(self) -> Saved:
        """An exact copy of the state in mid-episode."""
        kept = {name: deepcopy(getattr(self, name)) for name in self.kept} if self.kept else {}
        return Saved(self._row.copy(), self._now().copy(), self.mission, kept)

    def restore(self, saved: Saved) -> None:
        """Go back to a saved state; it may be restored again, here or in another world of the same size."""
        if saved.row.shape != self._row.shape or not np.array_equal(saved.row[:2], self._row[:2]):
            raise WorldError(
                f"the saved state is {saved.row[WIDTH]} x {saved.row[HEIGHT]} cells and {self} is "
                f"{self._row[WIDTH]} x {self._row[HEIGHT]}; restore it into a world of its own kind"
            )
        self._row[:] = saved.row
        self._draws = bool(self._row[TASK] == DODGE)
        self._words[:] = saved.words
        self._words_know = self._words_ahead = True
        self.mission = saved.mission
        for name in self.kept:
            setattr(self, name, deepcopy(saved.kept[name]))

    def picture(
        self, *, view: View = "partial", size_px: tuple[int, int] = (640, 480), palette: Palette = "classic"
    ) -> NDArray[np.uint8]:
        """The largest picture with whole-numbered tiles that fits, uint8[H, W, 3]."""
        size = self.image_shape[0]
        columns, rows = (size, size) if view == "partial" else (self.state.width, self.state.height)
        tile_px = max(1, min(size_px[0] // columns, size_px[1] // rows))
        # by bytes: a window has any size, and nothing is to be compiled once a participant sits before it
        return draw(
            self._in_world().row,
            view=view,
            view_size=size,
            tile_px=tile_px,
            palette=self.palette if self.palette == "minigrid" else palette,
            kinds=self.kinds,
            by_bytes=True,
        )

    def is_kind(self, code: int, kind: Kind) -> bool:
        """Whether a cell's code, or that of what is carried, is of a kind of this world's own."""
        return kind_of(int(code)) >= OWN and self.kinds[kind_of(int(code)) - OWN] == kind

    def text(self) -> str:
        """A diagram of the grid in characters; ``text.py`` says which."""
        return to_text(self._in_world(), self.kinds)

    def __str__(self) -> str:
        return type(self).__name__ if self.spec is None else self.spec.id
