"""RulesetWorld: a grid world whose task is a goal and rules, drawn from a set of tasks at each reset.

Its numbers are those of XLand-MiniGrid, so observations are equal, too: ``dynamics`` has the source.
"""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.contract import NativeWorld, Palette, View
from minihuman.worlds.grid.core.view import LARGEST_VIEW
from minihuman.worlds.grid.ruleset import dynamics as fields
from minihuman.worlds.grid.ruleset.dynamics import (
    ACTION_NAMES,
    BLACK_FLOOR,
    TERMINATED,
    TRUNCATED,
    Row,
    act_by_rules,
    ruleset_row_length,
    see_tiles,
    step_by_rules,
)
from minihuman.worlds.grid.ruleset.encodings import encode_tasks
from minihuman.worlds.grid.ruleset.instructions import TaskTexts, describe_task, name_tile
from minihuman.worlds.grid.ruleset.layouts import ROOMS, lay_out_task
from minihuman.worlds.grid.ruleset.planner import find_plan
from minihuman.worlds.grid.ruleset.tasks import (
    UNREACHABLE,
    RuleGoal,
    RuleTask,
    TaskSet,
    TileRule,
    build_task_set,
    check_task,
    find_task_set,
    parse_task,
)
from minihuman.worlds.grid.ruleset.tile_pictures import draw_ruleset, hex_colour
from minihuman.worlds.hashing import hash64
from minihuman.worlds.human_window import ShowsItself
from minihuman.worlds.options import check_bool, check_one_of, check_pair, check_whole
from minihuman.worlds.pose import Map, Pose, Thing, wall_outlines
from minihuman.worlds.rng import RngState, read_rng_state, write_rng_state
from minihuman.worlds.step_limit import action_number, check_max_steps

YAWS_RAD = (np.pi / 2, 0.0, -np.pi / 2, np.pi)  # by direction: up, right, down, left
MOST_CELLS = 255  # on a side: a goal's row and column are bytes
STEPS_PER_CELL = 3  # in the default step limit, as in XLand-MiniGrid
Difficulty = int | Sequence[int] | None


class RulesetSnapshot(NamedTuple):
    """An exact copy of a world of rules in mid-episode, including its random stream."""

    row: Row
    rng_state: RngState


class TaskSource(NamedTuple):
    """The tasks from which episodes are drawn: those of a set from ``first`` to before ``last``."""

    tasks: TaskSet
    first: int
    last: int


def find_tasks(task_set: str, task: Any, difficulty: Difficulty) -> TaskSource:
    """Return the tasks that a world's options name: one task, or those of a set with some difficulties.

    The parameters are the options of `RulesetWorld`.

    Raises:
        WorldError: if there are no such tasks.
    """
    if isinstance(task, Mapping | RuleTask):
        return TaskSource(build_task_set([parse_task(task)]), 0, 1)
    tasks = find_task_set(task_set)
    if task is not None:
        number = check_whole("task", task, 0, len(tasks) - 1)
        return TaskSource(tasks, number, number + 1)
    if difficulty is None:
        return TaskSource(tasks, 0, len(tasks))
    if isinstance(difficulty, Sequence):
        pair = check_pair("difficulty", difficulty, 0, UNREACHABLE)
    else:
        level = check_whole("difficulty", difficulty, 0, UNREACHABLE)
        pair = level, level
    return TaskSource(tasks, *tasks.numbers_of(pair))


def check_rooms(rooms: Any, height: int, width: int) -> int:
    """Return the number of rooms, after checking that a grid of this size can have so many.

    Raises:
        WorldError: if it cannot.
    """
    check_one_of("rooms", rooms, ROOMS)
    if rooms > 2 and height != width:
        raise WorldError(f"{rooms} rooms need a square grid, not {height} x {width}")
    if rooms == 4 and height < 7:
        raise WorldError(f"four rooms need 7 x 7 cells or more, not {height} x {width}")
    if rooms == 9 and (height < 7 or (height - 4) % 3):
        raise WorldError(f"nine rooms need 7, 10, 13, 16, ... cells on a side, not {height}")
    third = height // 3
    doors = {height // 2 + side * third for side in (-1, 0, 1)}
    if rooms == 6 and (height < 13 or doors & {0, third, 2 * third, height - 1}):
        raise WorldError(f"six rooms need 13, 17, 19, ... cells on a side, not {height}: a door would be in a corner")
    return int(rooms)


class RulesetWorld(ShowsItself, gymnasium.Env[dict[str, Any], int], NativeWorld):
    """A world of rules: things turn into others next to each other, in hand or next to the agent.

    An observation has the agent's view as ``image`` (uint8[view, view, 2]: kind and colour, indexed [down, right]),
    its ``direction`` (0 up, 1 right, 2 down, 3 left), what it carries as ``pocket`` (kind and colour), and the goal and
    rules in words as ``mission``.

    Args:
        task_set: the name of a set of tasks of the package ("trivial", "small", "medium", "high"), or a file's path.
        task: the number of one task of the set, or a task in XLand-MiniGrid's numbers, as `parse_task` takes it; None
            to draw one at each reset.
        difficulty: how many times rules have to be used in the tasks that are drawn: a number, or the least and the
            greatest; None for any.
        rooms: 1, 2, 4, 6 or 9 rooms with doors between them.
        height: the number of rows, 5 or more, including the outer walls.
        width: the number of columns.
        max_steps: the number of steps after which an episode is truncated; None for three times the number of cells.
        agent_view_size: the number of cells on a side of the agent's view, odd, 3 to 61.
        observe_task: whether observations have the goal and the rules as numbers, too: ``goal_encoding`` (uint8[5]) and
            ``rule_encoding`` (uint8[rules, 7]), as XLand-MiniGrid has them.
        render_mode: "rgb_array", "ansi", "human" or None.
        tile_size: the number of pixels on a side of a cell that `render` draws.
        highlight: whether `render` lightens the cells that the agent sees.
    """

    metadata: dict[str, Any] = {"render_modes": ["human", "rgb_array", "ansi"], "render_fps": 10}  # noqa: RUF012  # Gymnasium's name and type
    action_names = ACTION_NAMES

    def __init__(
        self,
        *,
        task_set: str = "small",
        task: Any = None,
        difficulty: Difficulty = None,
        rooms: int = 1,
        height: int = 9,
        width: int = 9,
        max_steps: int | None = None,
        agent_view_size: int = 5,
        observe_task: bool = False,
        render_mode: str | None = None,
        tile_size: int = 32,
        highlight: bool = True,
    ) -> None:
        check_whole("height", height, 5, MOST_CELLS)
        check_whole("width", width, 5, MOST_CELLS)
        check_one_of("render_mode", render_mode, (None, *self.metadata["render_modes"]))
        self.rooms = check_rooms(rooms, height, width)
        self.source = find_tasks(task_set, task, difficulty)
        self.most_rules = self.source.tasks.most_rules
        if len(self.source.tasks) == 1:
            check_task(self.source.tasks[0], height, width)
        self.view_size = check_whole("agent_view_size", agent_view_size, 3, LARGEST_VIEW, odd=True)
        self.observes_task = check_bool("observe_task", observe_task)
        self.render_mode = render_mode
        self.tile_size = check_whole("tile_size", tile_size, 1, 1024)
        self.highlight = check_bool("highlight", highlight)
        self.mission = describe_task(self.source.tasks[self.source.first])
        self.action_space = spaces.Discrete(len(ACTION_NAMES))  # type: ignore[assignment]  # its numbers are NumPy's
        self.observation_space = self._build_space()
        self._row = np.zeros(ruleset_row_length(height, width, self.most_rules), np.int32)
        self._row[[fields.HEIGHT, fields.WIDTH]] = height, width
        self._row[fields.MAX_STEPS] = check_max_steps(
            STEPS_PER_CELL * height * width if max_steps is None else max_steps
        )
        self._rng_state: RngState = np.zeros(6, np.uint64)
        self._encodings: dict[str, NDArray[np.uint8]] = {}

    def _build_space(self) -> spaces.Dict:
        kinds = len(fields.TILE_KINDS) - 1
        colours = len(fields.TILE_COLOURS) - 1
        size = self.view_size
        tiles = np.broadcast_to(np.array([kinds, colours], np.uint8), (size, size, 2))
        parts: dict[str, spaces.Space[Any]] = {
            "image": spaces.Box(np.zeros_like(tiles), tiles.copy(), dtype=np.uint8),
            "direction": spaces.Discrete(4),
            "pocket": spaces.Box(np.zeros(2, np.uint8), np.array([kinds, colours], np.uint8), dtype=np.uint8),
            "mission": TaskTexts(self.mission),
        }
        if self.observes_task:
            parts["goal_encoding"] = spaces.Box(0, 255, (5,), np.uint8)
            parts["rule_encoding"] = spaces.Box(0, 255, (self.most_rules, 7), np.uint8)
        return spaces.Dict(parts)

    @property
    def max_steps(self) -> int:
        """Return the number of steps after which an episode is truncated."""
        return int(self._row[fields.MAX_STEPS])

    @property
    def row(self) -> Row:
        """Return the state; `dynamics` names its numbers. Writing to it changes the world."""
        return self._row

    @property
    def task(self) -> RuleTask:
        """Return the goal and the rules of the episode, and the things of its beginning."""
        self._check_laid_out()
        goal = RuleGoal(*self._row[fields.GOAL : fields.GOAL + 4].tolist())
        things = self.source.tasks[int(self._row[fields.TASK])].things
        return RuleTask(goal, self._rules(), things)

    def _rules(self) -> tuple[TileRule, ...]:
        end = fields.HEADER + fields.PER_RULE * int(self._row[fields.RULES])
        flat = self._row[fields.HEADER : end].reshape(-1, fields.PER_RULE)
        return tuple(TileRule(*rule) for rule in flat.tolist())

    @property
    def tiles(self) -> NDArray[np.int32]:
        """Return the tiles of the grid, ``kind | colour << 4``, (height, width), indexed [row, column]."""
        height, width = self._row[: fields.WIDTH + 1].tolist()
        return self._row[-height * width :].reshape(height, width)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Draw a task and begin an episode of it; return the observation and an empty info.

        Raises:
            WorldError: if the grid has not enough floor for the task's things.
        """
        super().reset(seed=seed)
        read_rng_state(self.np_random, self._rng_state)
        tasks, first, last = self.source
        lay_out_task(self._row, self._rng_state, tasks.records, tasks.starts, first, last, self.rooms)
        write_rng_state(self._rng_state, self.np_random)
        if self._row[fields.FAILED]:
            raise WorldError(
                f"{self} has no floor for the things of task {int(self._row[fields.TASK])}; make the grid larger"
            )
        self._read_task()
        if self.render_mode == "human":
            self.render()
        return self.observation(), {}

    def _read_task(self) -> None:
        """Set the mission and the encodings that observations have from the task in the row."""
        self.mission = describe_task(self.task)
        if self.observes_task:
            goals, rules = encode_tasks(self._row[None], self.most_rules)
            self._encodings = {"goal_encoding": goals[0], "rule_encoding": rules[0]}

    def step(self, action: int) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Take an action as Gymnasium defines it; raise a WorldError outside an episode and for an unknown action."""
        image = np.empty((self.view_size, self.view_size, 2), np.uint8)
        status = step_by_rules(self._row, self._number_of(action), image)
        if status < 0:
            raise self._refusal(status, action)
        if self.render_mode == "human":
            self.render()
        return self._observe(image), self._reward(status), status & TERMINATED != 0, status & TRUNCATED != 0, {}

    def advance(self, action: int) -> tuple[float, bool, bool]:
        """Take an action without computing the observation; return the reward, terminated and truncated."""
        status = act_by_rules(self._row, self._number_of(action))
        if status < 0:
            raise self._refusal(status, action)
        return self._reward(status), status & TERMINATED != 0, status & TRUNCATED != 0

    def _reward(self, status: int) -> float:
        """Return the reward of a step: 1 minus 0.9 times the used share of the step limit at the goal, otherwise 0."""
        if status & TERMINATED:
            return float(1 - 0.9 * (int(self._row[fields.STEP]) / int(self._row[fields.MAX_STEPS])))
        return 0.0

    def _number_of(self, action: Any) -> int:
        """Return an action's number; raise a WorldError if it is no whole number."""
        number = action_number(action)
        if number is None:
            raise self._refusal(fields.NO_SUCH_ACTION, action)
        return number

    def _refusal(self, status: int, action: Any) -> WorldError:
        """Return the error for an action that the kernel refused with a status: NO_SUCH_ACTION or NOT_PLAYING."""
        if status == fields.NO_SUCH_ACTION:
            return WorldError(f"action {action!r} does not exist in {self}; actions are 0 to {len(ACTION_NAMES) - 1}")
        return WorldError(f"{self} is not in an episode; call reset() before step(), and again after each episode")

    def observation(self) -> dict[str, Any]:
        """Return the agent's current observation."""
        self._check_laid_out()
        image = np.empty((self.view_size, self.view_size, 2), np.uint8)
        see_tiles(self._row, image)
        return self._observe(image)

    def _observe(self, image: NDArray[np.uint8]) -> dict[str, Any]:
        pocket = int(self._row[fields.POCKET])
        observation = {
            "image": image,
            "direction": int(self._row[fields.DIRECTION]),
            "pocket": np.array([pocket & 15, pocket >> 4], np.uint8),
            "mission": self.mission,
        }
        if self.observes_task:
            observation |= {name: numbers.copy() for name, numbers in self._encodings.items()}
        return observation

    def _check_laid_out(self) -> None:
        if self._row[fields.PHASE] == fields.NEW:
            raise WorldError(f"{self} has not been reset; call reset() first")

    def render(self) -> NDArray[np.uint8] | str | None:
        """Return the world as a picture from above ("rgb_array") or as text ("ansi"), according to the render mode.

        The mode "human" shows the picture in a window and returns None, as does no mode.
        """
        if self.render_mode is None:
            return None
        if self.render_mode == "ansi":
            return self.text()
        if self.render_mode == "human":
            self.show_in_window(self._rendered)
            return None
        return self._rendered()

    def _rendered(self) -> NDArray[np.uint8]:
        self._check_laid_out()
        looks: dict[str, Any] = {"tile_px": self.tile_size, "palette": "classic", "lit": self.highlight}
        return draw_ruleset(self._row, view="full", view_size=self.view_size, **looks)

    def picture(
        self, *, view: View = "partial", size_px: tuple[int, int] = (640, 480), palette: Palette = "classic"
    ) -> NDArray[np.uint8]:
        """Return the largest picture that fits ``size_px`` (width, height) with a whole number of pixels per tile.

        It is uint8[H, W, 3], with the whole grid ("full") or what the agent sees ("partial").
        """
        self._check_laid_out()
        rows, columns = (self.view_size, self.view_size) if view == "partial" else self.tiles.shape
        tile_px = max(1, min(size_px[0] // columns, size_px[1] // rows))
        return draw_ruleset(self._row, view=view, view_size=self.view_size, tile_px=tile_px, palette=palette)

    def text(self) -> str:
        """Return the grid as a diagram: two letters per cell, for kind and colour, and an arrow for the agent."""
        lines = []
        for y, line in enumerate(self.tiles.tolist()):
            lines.append(" ".join(self._letters(y, x, tile) for x, tile in enumerate(line)))
        carried = int(self._row[fields.POCKET])
        return "\n".join([*lines, f"carrying: {name_tile(carried) if carried else 'nothing'}", self.mission])

    def _letters(self, y: int, x: int, tile: int) -> str:
        """Return the two characters in `text` of the cell in row ``y`` and column ``x``, whose tile is ``tile``."""
        if (y, x) == (self._row[fields.Y], self._row[fields.X]):
            return "^>v<"[int(self._row[fields.DIRECTION])] * 2
        if tile == BLACK_FLOOR:
            return " ."
        if tile & 15 == fields.WALL:
            return "WW"
        return _KIND_LETTERS[tile & 15] + _COLOUR_LETTERS[tile >> 4]

    def pose(self) -> Pose:
        """Return the agent's cell (column, 0, row) and direction (yaw in radians)."""
        self._check_laid_out()
        y, x, direction = self._row[fields.Y : fields.DIRECTION + 1].tolist()
        return Pose(float(x), 0.0, float(y), YAWS_RAD[direction])

    def map(self) -> Map:
        """Return the floor plan with doors and things at their current places."""
        self._check_laid_out()
        tiles = self.tiles
        kinds = tiles & 15
        things = tuple(
            Thing(name_tile(int(tiles[y, x])), float(x), float(y), 0.5, hex_colour(int(tiles[y, x]), "classic"))
            for x, y in np.argwhere(((kinds != fields.WALL) & (tiles != BLACK_FLOOR)).T).tolist()
        )
        height, width = tiles.shape
        walls = wall_outlines(np.ascontiguousarray((kinds == fields.WALL).T))
        return Map("cell", (-0.5, -0.5, width - 0.5, height - 0.5), walls, things)

    def shortest_path(self) -> Sequence[int] | None:
        """Return the actions of a short plan that reaches the goal, not always the shortest; empty if there is none.

        Raises:
            WorldError: if none was found in the time that a search may take.
        """
        self._check_laid_out()
        return find_plan(self._row, self.task, self.tiles.size)

    def _read_rng_state(self) -> RngState:
        """Return a copy of the state of this world's random stream."""
        read_rng_state(self.np_random, self._rng_state)
        return self._rng_state.copy()

    def state_hash(self) -> int:
        """Return a uint64 hash of the grid, the agent, the task and the random stream."""
        return _hash_state(self.save())

    def scene_hash(self) -> int:
        """Return the hash of the state without the number of steps taken."""
        saved = self.save()
        saved.row[fields.STEP] = 0
        return _hash_state(saved)

    def save(self) -> RulesetSnapshot:
        """Return an exact copy of the state in mid-episode."""
        return RulesetSnapshot(self._row.copy(), self._read_rng_state())

    def restore(self, saved: RulesetSnapshot) -> None:
        """Restore a saved state. It may be restored again, here or in another world with the same options.

        Raises:
            WorldError: if the state is of a world of another size, or with another number of rules.
        """
        if saved.row.shape != self._row.shape or not np.array_equal(saved.row[:2], self._row[:2]):
            raise WorldError(f"the saved state is of another world than {self}; restore it into one with its options")
        self._row[:] = saved.row
        write_rng_state(saved.rng_state, self.np_random)
        if self._row[fields.PHASE] != fields.NEW:
            self._read_task()

    def __str__(self) -> str:
        if self.spec is None:
            return type(self).__name__
        return self.spec.id


_KIND_LETTERS = " .#BSPMKLDOHT"  # by kind: M is a mat, T a star; L, D and O are locked, closed and open doors
_COLOUR_LETTERS = " rgbpyekowni"  # by colour: e grey, k black, n brown, i pink


def _hash_state(saved: RulesetSnapshot) -> int:
    """Return a uint64 hash of the state, in which the task counts by its content, not by its number in a set."""
    row = saved.row.copy()
    row[fields.TASK] = 0
    rng_state = saved.rng_state[: 6 if saved.rng_state[4] else 4]  # the last two: a buffered half draw, if there is one
    return hash64(["ruleset", row, rng_state])
