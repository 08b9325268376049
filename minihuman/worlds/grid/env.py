"""GridEnv, the grid worlds of the catalogue, and GridWorld, the base class for a grid world that you write.

The compiled layout of a family lays out a `GridEnv`; each family is a function from options, named as Minigrid names
them, to a recipe. `docs/grid-worlds.md` writes a `GridWorld` in fifteen lines.
"""

import abc
import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from inspect import signature
from operator import index
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from minihuman.worlds.grid.babyai.binding import instruct
from minihuman.worlds.grid.core.rules import FAULTY, TERMINATED, TRUNCATED
from minihuman.worlds.grid.core.state import FAILED, OVER, PHASE, PLAYING
from minihuman.worlds.grid.engine import GridEngine, set_attribute
from minihuman.worlds.grid.families import FAMILIES, recipe
from minihuman.worlds.grid.family_names import INSTEAD
from minihuman.worlds.grid.layout import Layout, Recipe
from minihuman.worlds.grid.minigrid_compat import MinigridCompat
from minihuman.worlds.grid.own.acts import OwnRules
from minihuman.worlds.grid.own.fields import OwnField, declare_fields, observe_fields, observed_space, own_numbers
from minihuman.worlds.upstream_names import (
    WorldAttributeError,
    define_names,
    missing_name,
    refuse_replaced_method,
    refuse_unknown_attribute,
)

ENGINE_SETTINGS = frozenset(
    {"agent_view_size", "render_mode", "tile_size", "palette", "highlight", "agent_pov", "screen_size"}
)
_UPSTREAM_METHODS = vars(MinigridCompat)
# attributes that resets set; they are not checked, because a reset takes most of the time of a short episode
_SET_BY_RESETS = frozenset(
    {"cell_marks", "mission", "_episode_recipe", "_draws", "_stream_is_held", "_stream_is_ahead", "_views"}
    | {"_np_random", "_np_random_seed"}
)
_NO_IMAGE = np.zeros((0, 0, 3), np.uint8)  # for a step without an observation
_OWN_NAMES = frozenset({"width", "height", "goal_pos", "agent_pos", "mission", "room_size", "num_rows", "num_cols"})


def options_of(family: str | Callable[..., Recipe], options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options of a family by their names, including the defaults of those that were not given.

    An obstacle type becomes Minigrid's class of that name, if Minigrid is imported.

    Args:
        family: the name of a family or a level; for a function, only the given options are returned.
        options: the options that were given.
    """
    if not isinstance(family, str):
        return dict(options)
    if family.startswith("level:"):
        from minihuman.worlds.grid.babyai.levels import LEVELS  # compiled: only where a level is made

        function: Callable[..., Any] = LEVELS[family].trace
    else:
        function = FAMILIES[family]
    parameters = signature(function).parameters.values()
    settings = {
        parameter.name: parameter.default for parameter in parameters if parameter.default is not parameter.empty
    } | dict(options)
    if "obstacle_type" in settings:
        name = settings["obstacle_type"]
        minigrid_module = sys.modules.get("minigrid.core.world_object")
        settings["obstacle_type"] = getattr(minigrid_module, name.capitalize(), name)
    return settings


class GridEnv(GridEngine):
    """A world of a family: ``GridEnv("four_rooms", max_steps=50)``.

    Args:
        family: the name of one of ``env.FAMILIES`` or of a level, or a level that you wrote.
        max_steps: the step limit; None for the family's own.
        see_through_walls: whether the agent sees through walls; None for the family's own setting.
        options: settings of `GridEngine`, and options of the family's function (``size=9``).
    """

    def __init__(
        self,
        family: str | Callable[..., Recipe],
        *,
        max_steps: int | None = None,
        see_through_walls: bool | None = None,
        **options: Any,
    ) -> None:
        settings = {name: options.pop(name) for name in ENGINE_SETTINGS & options.keys()}
        if callable(family):
            self.recipe = family(**options)
        else:
            self.recipe = recipe(family, **options)
        if max_steps is not None:
            self.recipe = self.recipe.limited(max_steps)
        super().__init__(
            width=self.recipe.width,
            height=self.recipe.height,
            max_steps=self.recipe.max_steps,
            mission=self.recipe.mission,
            see_through_walls=self.recipe.see_through_walls if see_through_walls is None else see_through_walls,
            actions=self.recipe.actions,
            **settings,
        )
        self._episode_recipe = self.recipe  # of this episode: `recipe`, or with the mission that was set in `reset`
        settings = {**options_of(family, options), "fixed_max_steps": max_steps is not None}
        if self.recipe.width == self.recipe.height:
            settings.setdefault("size", self.recipe.width)
        self._family_options = {name: setting for name, setting in settings.items() if name not in _OWN_NAMES}
        self._is_made = True  # set last; `vars` is avoided, as it would slow down every attribute of the world

    def __setattr__(self, name: str, value: Any) -> None:
        if name not in _SET_BY_RESETS and self._is_made:
            if name in self._family_options:
                raise WorldAttributeError(f"{name} of {self} cannot be set; give it when the world is made")
            refuse_unknown_attribute(self, name, INSTEAD)
            refuse_replaced_method(self, name, _UPSTREAM_METHODS)
        super().__setattr__(name, value)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Lay out a new episode and return the observation and an empty info.

        In worlds with instructions, ``options={"mission": ...}`` sets the mission.

        Layouts are drawn until one fits the mission: it has all objects that the mission names, as many as its articles
        imply.

        Raises:
            WorldError: if this world cannot have the mission, or no layout fits it.
        """
        mission = (options or {}).get("mission")
        episode_recipe = self.recipe if mission is None else self.recipe.about(mission)
        if episode_recipe is not self._episode_recipe:
            set_attribute(self, "_episode_recipe", episode_recipe)
        return super().reset(seed=seed, options=options)

    def _lay_out(self) -> None:
        self._episode_recipe.lay_out(self._row, self._stream())
        if not self._row[FAILED]:
            mission = self.mission_space.of(self._row)
            if mission is not self.mission:
                set_attribute(self, "mission", mission)


_LEVEL_OPTIONS = (
    *(
        "num_dists",
        "doors_open",
        "debug",
        "select_by",
        "strict",
        "first_color",
        "second_color",
        "num_doors",
        "num_objs",
    ),
    *("objs_per_room", "start_carrying", "distractors", "locked_room_prob", "implicit_unlock", "unblocking"),
    *("locations", "instr_kinds", "action_kinds", "fixed_max_steps", "size"),
)


def _read_option(world: GridEnv, name: str) -> Any:
    """Return the option of a family with which a world was made, as Minigrid's attribute of that name.

    Raises:
        WorldAttributeError: if the world's family has no such option.
    """
    if name in world._family_options:
        return world._family_options[name]
    raise missing_name(world, name, INSTEAD)


_OPTION_NAMES = {name for family in FAMILIES.values() for name in signature(family).parameters} | {*_LEVEL_OPTIONS}
define_names(GridEnv, sorted(_OPTION_NAMES), _read_option, over=(*_LEVEL_OPTIONS, "obstacle_type"))


class GridEnvOnScreen(GridEnv):
    """A world of a family with ``render_mode="human"``: it shows itself at every reset and step, as Minigrid's do."""

    metadata: dict[str, Any] = {**GridEnv.metadata, "render_modes": ["human", *GridEnv.metadata["render_modes"]]}  # noqa: RUF012  # Gymnasium's name and type

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Lay out a new episode and show it in the window; return what `GridEnv.reset` returns."""
        observation, info = super().reset(seed=seed, options=options)
        self.render()
        return observation, info

    def step(self, action: int) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Take an action and show the new state in the window; return what `GridEngine.step` returns."""
        step_outcome = super().step(action)
        self.render()
        return step_outcome

    shortest_path = GridEngine.shortest_path
    path_length_bounds = GridEngine.path_length_bounds


class GridWorld(OwnRules, GridEngine, abc.ABC):
    """A grid world laid out in plain Python. Actions and the agent's view are compiled.

    A subclass writes `layout`, and also `reward_and_done` unless its task is a goal, lava or one of `rewards`. What
    else changes in an episode is declared: ``coins = Int()``. Then `layout` and `reward_and_done` can be
    translated and compiled, too (`minihuman.worlds.grid.own`).
    """

    own_steps: ClassVar[bool] = True  # whether each part of an instruction is judged by its own steps
    done_required: ClassVar[bool] = False  # whether a clause ends only with the action "done" right after it
    own_fields: ClassVar[tuple[OwnField, ...]] = ()  # the fields that the class and its bases declare
    observed: ClassVar[tuple[str, ...]] = ()  # names of declared fields that are part of each observation
    _has_own_reward: ClassVar[bool] = False
    _has_own_step_values: ClassVar[bool] = False  # a reward or an observation that kernels do not make

    def __init_subclass__(cls, **kwargs: Any) -> None:
        """Record whether the subclass defines its reward or its observation, and place its fields."""
        super().__init_subclass__(**kwargs)
        declare_fields(cls)
        cls._has_own_reward = cls.reward_and_done is not GridWorld.reward_and_done
        has_own_view = cls.observation is not GridWorld.observation or cls.look is not GridEngine.look
        cls._has_own_step_values = cls._has_own_reward or has_own_view or bool(cls.observed)

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        if self.observed:
            self.observation_space = spaces.Dict(
                {**self.observation_space.spaces, **{name: observed_space(self, name) for name in self.observed}}  # type: ignore[attr-defined]
            )

    @classmethod
    def vector(cls, num_envs: int = 1, **options: Any) -> Any:
        """Return a batch of such worlds, for ``gymnasium.register(..., vector_entry_point=Patrol.vector)``.

        Where the rules can be translated, the worlds are stepped together in compiled code.
        """
        return import_module("minihuman.worlds.grid.own.batch").make_batch(cls, num_envs=num_envs, **options)

    @abc.abstractmethod
    def layout(self, grid: Layout) -> None:
        """Lay out an episode on an empty grid. The method must place the agent."""

    def reward_and_done(self, action: int, reward: float, terminated: bool) -> tuple[float, bool]:
        """Return the reward of a step that was made, and whether it ended the episode.

        The arguments ``reward`` and ``terminated`` are what the goal, lava and the task imply. The method may change
        the world (through ``self.state``, `put`, `remove` and `move`); the observation is made afterwards.
        """
        return reward, terminated

    @property
    def is_compiled(self) -> bool:
        """Return whether compiled kernels alone step and draw the world.

        A world with its own `reward_and_done`, or with declared fields that it saves or observes, needs Python.
        """
        return not self._has_own_reward and not self.observed and self._is_plain(GridWorld)

    def _has_own_rules(self) -> bool:
        has_own_step = any(getattr(type(self), name) is not getattr(GridWorld, name) for name in ("step", "advance"))
        return self._has_own_reward or has_own_step

    def _lay_out(self) -> None:
        own_numbers(self)[:] = 0
        rules = self._load_rules()
        if rules is not None and rules.has_layout:
            self._stream()  # the rules draw from it
            self.mission = rules.lay_out(self)
            return
        grid = Layout(self._row, self.np_random, self.mission_space.first(), self.kinds)
        self.layout(grid)
        self.mission = grid.mission
        if grid.instruction is not None:
            instruct(self._row, grid.instruction, own_steps=self.own_steps, done_required=self.done_required)
            self.mission = self.mission_space.of(self._row)

    def step(self, action: int) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Take an action; return the observation, reward, terminated, truncated and an empty info.

        Raises:
            WorldError: before `reset`, after an episode's end, and for an action that does not exist.
        """
        if not self._has_own_step_values:
            return super().step(action)
        if self._compiled_rules is None or not self._compiled_rules.has_reward:
            reward, terminated, truncated = self.advance(action)
            return self.observation(), reward, terminated, truncated, {}
        image = np.empty(self.image_shape, np.uint8)
        status, direction, reward = self._step_compiled(action, image)
        observation = {"image": image, "direction": direction, "mission": self.mission}
        observe_fields(self, observation)
        return observation, reward, status & TERMINATED != 0, status & TRUNCATED != 0, {}

    def advance(self, action: int) -> tuple[float, bool, bool]:
        """Take an action without computing the observation; return the reward, terminated and truncated."""
        if not self._has_own_reward:
            return super().advance(action)
        if self._compiled_rules is not None and self._compiled_rules.has_reward:
            status, _, reward = self._step_compiled(action, _NO_IMAGE)
            return reward, status & TERMINATED != 0, status & TRUNCATED != 0
        number = self._read_action(action)
        reward, terminated, truncated = super().advance(number)
        reward, terminated = self.reward_and_done(number, reward, terminated)
        self._row[PHASE] = OVER if terminated or truncated else PLAYING
        return float(reward), bool(terminated), truncated

    def _read_action(self, action: Any) -> int:
        """Return the number of an action, as the worlds of the catalogue take it."""
        try:
            return index(action)
        except TypeError:
            return self._number_of(action)

    def _step_compiled(self, action: int, image: NDArray[np.uint8]) -> tuple[int, int, float]:
        """Make one step by the compiled rules; the result is that of `core.rules.step`."""
        number = self._read_action(action)
        rules = self._compiled_rules
        if self._draws or rules.draws:
            self._stream()
        step: tuple[int, int, float] = rules.step(number, image)
        if step[0] < 0:
            raise self._refusal(step[0], action)
        if step[0] == FAULTY:
            rules.raise_fault()
        return step

    def observation(self) -> dict[str, Any]:
        """Return the agent's current observation, with the declared fields that are `observed`."""
        observation = super().observation()
        observe_fields(self, observation)
        return observation

    shortest_path = GridEngine.shortest_path
    path_length_bounds = GridEngine.path_length_bounds
