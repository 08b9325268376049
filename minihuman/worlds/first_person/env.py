"""FirstPersonEnv: a first-person world as a Gymnasium environment.

A subclass places rooms and entities in `build`, and returns a termination rule, which kernels apply, for the reward of
a step and the end of the episode.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, TypeVar

import gymnasium
import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.contract import NativeWorld, Palette, View
from minihuman.worlds.first_person import rules
from minihuman.worlds.first_person.entities import Agent, Entity, ImageFrame, Position, TextFrame, note_change
from minihuman.worlds.first_person.free_motion import FreeMotion
from minihuman.worlds.first_person.miniworld_compat import MiniworldCompat
from minihuman.worlds.first_person.parameters import DEFAULTS, Parameters, fix_parameters
from minihuman.worlds.first_person.pictures import RoomTables, WorldRenderer, room_tables
from minihuman.worlds.first_person.render.drawing import RenderTarget
from minihuman.worlds.first_person.rooms import (
    WALL_HEIGHT,
    OpeningLimits,
    Point,
    Room,
    RoomOutline,
    outline_of,
    rectangle,
)
from minihuman.worlds.first_person.snapshot import FirstPersonSnapshot, restore_state, save_state
from minihuman.worlds.first_person.state import (
    FlatState,
    TerminationRule as TerminationRule,
    WorldState,
    floor_map,
    state_hash,
)
from minihuman.worlds.first_person.termination_rules import (
    face as face,
    near_goal as near_goal,
    pick_up_all as pick_up_all,
    put_next as put_next,
    stay_alive as stay_alive,
    touch_right_one as touch_right_one,
)
from minihuman.worlds.human_window import ShowsItself
from minihuman.worlds.options import MAX_PIXELS, check_bool, check_one_of, check_whole
from minihuman.worlds.pose import Map, Pose
from minihuman.worlds.step_limit import check_action

_NOT_STATE = frozenset(
    {"action_names", "action_space", "observation_space", "max_steps", "parameters", "domain_rand", "render_mode"}
    | {"view", "window_px", "spec", "trig", "_pictures", "_over", "_flat", "_max_steps", "_domain_rand", "_is_made"}
    | {"_window", "reward_range", "obs_disp_width", "control", "acceleration", "kernel_actions", "_continuous"}
    | {"action_element_names", "action_resolution"}
)
EntityT = TypeVar("EntityT", bound=Entity)
FrameT = TypeVar("FrameT", ImageFrame, TextFrame)


class FirstPersonEnv(ShowsItself, gymnasium.Env[Any, Any], MiniworldCompat, FreeMotion, NativeWorld):
    """The base class of all first-person worlds.

    ``build`` places rooms and entities, and ``termination_rule`` returns the rule for rewards and ends. A custom rule
    is ``reward_and_done``, in Python, which no page can compute. Attributes that these methods set on ``self`` are part
    of the state: they are saved, restored and hashed with it, so they consist of numbers, text, entities, arrays, and
    tuples, lists and dicts of these.

    Args:
        max_steps: the number of steps after which an episode is truncated; None for never
        actions: the names of the discrete actions, out of ``rules.ACTIONS``
        obs_width: the width of an observation in pixels
        obs_height: the height of an observation in pixels
        render_mode: "rgb_array", "human" for a window that shows every reset and step, or None
        window_width: the width of a rendered picture in pixels
        window_height: the height of a rendered picture in pixels
        view: what ``render`` draws: the "agent"'s view, or the world from the "top"
        parameters: step length, turn, camera and light with their ranges; or fixed values of some of them
        domain_rand: whether parameters are drawn from their ranges
        assets: a folder with ``textures/NAME.png``, ``meshes/NAME.obj`` and ``meshes/NAME.glb``, in addition to the
            built-in assets; None for the class's ``assets``
        trig: the sine and cosine that turn entities and cameras: 0 for the host's, 1 for our own, which are the same on
            every machine and page
        contact_shadows: whether the ground is darker around entities that stand on it, unlike in Miniworld's pictures
        look: the style of pictures: "classic", or "display" for people: sharper, steadier, with depth
        control: how the body moves: "discrete" by the eight actions, "discrete-strafe" with steps to the left and right
            as two more, "continuous" by speed and turn, each -1 to 1, "continuous-strafe" with a third, to the right
        acceleration: the most by which speed and strafe change in a step, of the largest; 0 for at once
    """

    metadata = {"render_modes": ["human", "rgb_array"], "render_fps": 30}  # noqa: RUF012 (Gymnasium's own way to declare it)
    drawn = True
    assets: ClassVar[str | Path | None] = None  # a world's own textures and meshes
    room_tables: ClassVar[RoomTables] = staticmethod(room_tables)  # turns the plan into what the renderer draws
    motions: ClassVar[Mapping[str, str]] = {}  # by action, the one of rules.ACTIONS that it does under another name

    def __init__(
        self,
        *,
        max_steps: int | None = 1500,
        actions: tuple[str, ...] = rules.ACTIONS,
        obs_width: int = 80,
        obs_height: int = 60,
        render_mode: str | None = None,
        window_width: int = 800,
        window_height: int = 600,
        view: str = "agent",
        parameters: Parameters | Mapping[str, float] = DEFAULTS,
        domain_rand: bool = False,
        assets: str | Path | None = None,
        contact_shadows: bool = False,
        look: str = "classic",
        trig: int = 0,
        control: str = "discrete",
        acceleration: float = 0.0,
    ) -> None:
        sizes = (("obs_width", obs_width), ("obs_height", obs_height))
        for name, pixels in (*sizes, ("window_width", window_width), ("window_height", window_height)):
            check_whole(name, pixels, 1, MAX_PIXELS)
        check_one_of("view", view, ("agent", "top"))
        check_one_of("render_mode", render_mode, (None, "rgb_array", "human"))
        check_one_of("trig", trig, (0, 1))
        check_bool("contact_shadows", contact_shadows)
        check_one_of("look", look, ("classic", "display"))
        self._stage: WorldState | None = None
        self._flat: FlatState | None = None
        self.max_steps = max_steps
        self._set_actions(tuple(actions), control, acceleration)
        self.observation_space = gymnasium.spaces.Box(0, 255, (obs_height, obs_width, 3), np.uint8)
        self.parameters = fix_parameters(parameters)
        self.domain_rand = domain_rand
        self.render_mode = render_mode
        self.view = view
        self.window_px = (window_width, window_height)
        self.step_count = 0
        self.trig = trig  # from the next reset on
        self._over = False  # the episode has ended
        folder = str(assets or self.assets) if assets or self.assets else None
        self._pictures = WorldRenderer(
            (obs_width, obs_height), folder, shadows=contact_shadows, display=look == "display", tables=self.room_tables
        )

    # What a world defines.

    def build(self) -> None:
        """Add rooms, connect them, and place entities and the agent; called at every reset with an empty world."""
        raise NotImplementedError(f"{type(self).__name__} has no build(); define it to lay out rooms and entities")

    def termination_rule(self) -> TerminationRule:
        """Return the rule for the reward of a step and the end of an episode; by default, a rule without either."""
        return TerminationRule()

    def reward_and_done(self, action: str) -> tuple[float, bool]:
        """Return the reward of a step and whether it ended the episode, by default by the ``termination_rule``."""
        flat = self.flat_state()
        flat.read_rule(self)
        status = flat.step(self, self._kernel_action(action), rules.JUDGE)
        return flat.reward, bool(status & rules.TERMINATED)

    def info(self) -> dict[str, Any]:
        """Return the info that ``reset`` and ``step`` return, by default {}."""
        return {}

    def targets(self) -> tuple[Entity, ...]:
        """Return the entities that a simulated person must see before taking a path, and for which it looks around.

        Without any, the simulated person takes the world's shortest path at once.
        """
        return ()

    def off_limits(self) -> tuple[Room, ...]:
        """Return the rooms that planned paths avoid, by default none."""
        return ()

    def observe(self) -> Any:
        """Return the agent's observation, by default its view as uint8[obs_height, obs_width, 3]."""
        return self.see()

    def see(self, out: NDArray[np.uint8] | None = None) -> NDArray[np.uint8]:
        """Return the agent's view, uint8[obs_height, obs_width, 3], drawn into ``out`` if that is given."""
        return self._pictures.observation(self.stage, out)

    def aim_target(self) -> RenderTarget:
        """Return the render target of the agent's view with all entities in place, for drawing many worlds together."""
        return self._pictures.aim_target(self.stage)

    def staged(self, palette: Palette, size_px: tuple[int, int]) -> tuple[Sequence[Entity], RenderTarget]:
        """Return the scene's entities, including removed ones, and the agent's view of a size as a render target."""
        return self._pictures.staged(self.stage, palette, size_px)

    # What ``build`` calls.

    def add_rect_room(self, *, min_x: float, max_x: float, min_z: float, max_z: float, **looks: Any) -> Room:
        """Add a rectangular room; ``looks`` are the other arguments of ``add_room``."""
        return self.add_room(rectangle(min_x, max_x, min_z, max_z), **looks)

    def add_room(
        self,
        outline: RoomOutline | Sequence[Point],
        *,
        wall_height: float = WALL_HEIGHT,
        floor: str = "floor_tiles_bw",
        wall: str = "concrete",
        ceiling: str | None = "concrete_tiles",
    ) -> Room:
        """Add a convex room with corners (x, z) in metres, counter-clockwise as seen from above.

        ``floor``, ``wall`` and ``ceiling`` are names of textures; a room with ``ceiling=None`` is open to the sky.

        Raises:
            WorldError: if the outline does not close, is not convex, or is clockwise.
        """
        if isinstance(outline, RoomOutline):
            shape = outline
        else:
            shape = outline_of(tuple((float(x), float(z)) for x, z in outline))
        return self.stage.add_room(Room(shape, wall_height, floor, wall, ceiling))

    def connect_rooms(
        self,
        a: Room,
        b: Room,
        *,
        min_x: float | None = None,
        max_x: float | None = None,
        min_z: float | None = None,
        max_z: float | None = None,
        max_y: float | None = None,
    ) -> None:
        """Make an opening between two rooms within limits of x or z, up to ``max_y`` (None: as high as the walls).

        Raises:
            WorldError: if the rooms do not face each other, or the opening does not fit their walls.
        """
        self.stage.connect_rooms(a, b, limits=OpeningLimits(min_x, max_x, min_z, max_z), top=max_y)

    def place_entity(
        self,
        entity: EntityT,
        *,
        room: Room | None = None,
        pos: Position | None = None,
        dir: float | None = None,
        min_x: float | None = None,
        max_x: float | None = None,
        min_z: float | None = None,
        max_z: float | None = None,
    ) -> EntityT:
        """Place an entity at ``pos``, or at a random position where it touches nothing, and return it.

        Args:
            entity: the entity to place
            room: the room in which it may stand; None for a room drawn by floor area
            pos: an exact position (x, y, z), at which it may touch anything
            dir: its heading in radians; None for a random one
            min_x: the smallest x at which it may stand
            max_x: the largest x at which it may stand
            min_z: the smallest z at which it may stand
            max_z: the largest z at which it may stand

        Raises:
            WorldError: if no free position is found.
        """
        self._pictures.measure(entity)
        if pos is None:
            self.stage.place(entity, room=room, dir=dir, x=(min_x, max_x), z=(min_z, max_z))
        else:
            self.stage.put(entity, (float(pos[0]), float(pos[1]), float(pos[2])), dir)
        return entity

    def hang(self, frame: FrameT) -> FrameT:
        """Place a frame at its own position on a wall, and return it."""
        self.stage.put(frame, frame.pos, frame.dir)
        return frame

    def place_agent(self, **placement: Any) -> Agent:
        """Place the agent; ``placement`` are arguments of ``place_entity``."""
        return self.place_entity(self.agent, **placement)

    def success_reward(self) -> float:
        """Return the reward of success: 1 at the start, 0.8 at the last step; always 1 without a step limit."""
        if self.max_steps is None:
            return 1.0
        return 1.0 - 0.2 * (self.step_count / self.max_steps)

    @property
    def stage(self) -> WorldState:
        """Return the state of the episode.

        Raises:
            WorldError: before the first reset.
        """
        if self._stage is None:
            raise self._not_reset()
        return self._stage

    @property
    def agent(self) -> Agent:
        """Return the agent."""
        return self.stage.agent

    @property
    def entities(self) -> list[Entity]:
        """Return all placed entities in order, including the agent."""
        return self.stage.entities

    # Gymnasium.

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Build a new episode, the same for the same seed; return its observation and info. There are no options."""
        self.begin(seed=seed)
        self._show()
        return self.observe(), self.info()

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Step the world by an action; return observation, reward, terminated, truncated and info.

        Raises:
            WorldError: if the action is not in the action space, or no episode is running.
        """
        reward, terminated, truncated = self.advance(action)
        self._show()
        return self.observe(), reward, terminated, truncated, self.info()

    def begin(self, *, seed: int | None = None) -> None:
        """Begin an episode without computing an observation; raise a WorldError if `build` places no agent."""
        super().reset(seed=seed)
        self.step_count = 0
        self._over = False
        self._stand_still()
        self._stage = self._new_state()
        if self.trig:
            self._stage.agent.trig = self.trig
        self._run_build()
        self._stage.close_floor_plan()
        if self.agent not in self.entities:
            raise WorldError(f"{type(self).__name__}.build() placed no agent; call self.place_agent() at its end")
        self._stage.randomise()

    def _new_state(self) -> WorldState:
        return WorldState(self.np_random, self.parameters, randomised=self.domain_rand)

    def _run_build(self) -> None:
        """Call the author's `build`, which unlike other code may add attributes to a finished world."""
        was_made = self._is_made
        vars(self)["_is_made"] = False
        try:
            self.build()
        finally:
            self._is_made = was_made

    def advance(self, action: Any) -> tuple[float, bool, bool]:
        """Step as `step` does, but without an observation; return reward, terminated and truncated."""
        number = self.check(action)
        if self._over:
            raise WorldError(f"no episode is running in {type(self).__name__}; call reset() first")
        attributes = vars(self)  # setting one through the world costs as much as the rest of a move
        attributes["step_count"] += 1
        name = self.action_names[number]
        parts = rules.ACT | rules.JUDGE
        if self._is_free(number):
            name = self._act_freely(action, name)
            number = self._kernel_action(name)
            parts = rules.JUDGE
        flat = self.flat_state()
        if self.kernels_judge:
            status = flat.step(self, number, parts)
            reward = flat.reward
            terminated = bool(status & rules.TERMINATED)
            truncated = bool(status & rules.TRUNCATED)
        else:
            if parts & rules.ACT:
                flat.step(self, number, rules.ACT)
            reward, terminated = self.reward_and_done(name)
            truncated = self.max_steps is not None and self.step_count >= self.max_steps
        attributes["_over"] = terminated or truncated
        return reward, terminated, truncated

    def check(self, action: Any) -> int:
        """Return an action's number, 0 for a continuous one; raise a WorldError for an invalid one or before reset."""
        if self._stage is None:
            raise self._not_reset()
        if self._continuous is not None:
            self._continuous.read(action)
            return 0
        return check_action(action, len(self.action_names))

    def render(self) -> NDArray[np.uint8] | None:
        """Return the picture of ``view``, uint8[window_height, window_width, 3], if the render mode is "rgb_array".

        The mode "human" shows it in a window and returns None, as does no mode.
        """
        if self.render_mode == "human":
            self.show_in_window(self._rendered)
        return self._rendered() if self.render_mode == "rgb_array" else None

    def _show(self) -> None:
        if self.render_mode == "human":
            self.render()

    def _rendered(self) -> NDArray[np.uint8]:
        return self.picture(view="full" if self.view == "top" else "partial", size_px=self.window_px)

    # NativeWorld.

    @property
    def is_compiled(self) -> bool:
        """Return whether only kernels with our own sine step the world, not its own `reward_and_done` or `advance`."""
        kind = type(self)
        has_our_step = kind.advance is FirstPersonEnv.advance and kind.step is FirstPersonEnv.step
        return bool(self.trig) and has_our_step and self.kernels_judge and len(self.action_names) <= rules.MOST_ACTIONS

    @property
    def kernels_judge(self) -> bool:
        """Return whether kernels determine a step's reward, because the world has no `reward_and_done` of its own."""
        return type(self).reward_and_done is FirstPersonEnv.reward_and_done

    def flat_state(self) -> FlatState:
        """Return the present state in the arrays of the kernels, which the next step changes."""
        flat = self._flat
        if flat is None or flat.stage is not self._stage:
            flat = self._flat = FlatState(self)
        else:
            flat.refresh()
        return flat

    def pose(self) -> Pose:
        """Return the position of the agent's feet in metres and its heading, which is not reduced to one turn."""
        x, y, z = self.agent.pos
        return Pose(x, y, z, self.agent.dir)

    def map(self) -> Map:
        """Return the floor plan: the walls that stop a body, and all entities but the agent."""
        return floor_map(self.stage)

    def picture(
        self, *, view: View = "partial", size_px: tuple[int, int] = (640, 480), palette: Palette = "classic"
    ) -> NDArray[np.uint8]:
        """Return the agent's view, or the world from above, uint8[H, W, 3] of exactly ``size_px`` (width, height)."""
        return self._pictures.draw(self.stage, view=view, size_px=size_px, palette=palette)

    def picture_between(
        self, before: Pose, share: float, *, size_px: tuple[int, int] = (640, 480), palette: Palette = "classic"
    ) -> NDArray[np.uint8]:
        """Return the view at a share (0 to 1) of the way from an earlier pose to the agent's, which stays unchanged."""
        agent = self.agent
        carried = self.agent.carrying
        pose = self.pose()
        moved = [agent] if carried is None else [agent, carried]
        placed = [(thing, thing.pos, thing.dir) for thing in moved]
        starts, ends = ((end_pose.x, end_pose.y, end_pose.z, end_pose.yaw_rad) for end_pose in (before, pose))
        x, y, z, agent.dir = (start + share * (end - start) for start, end in zip(starts, ends, strict=True))
        agent.pos = x, y, z
        if carried is not None:
            carried.pos = self.stage.carrying_position(agent.pos, carried)
            carried.dir = agent.dir
        try:
            return self.picture(size_px=size_px, palette=palette)
        finally:
            for thing, pos, heading in placed:
                thing.pos = pos
                thing.dir = heading

    def state_hash(self) -> int:
        """Return a uint64 hash of floor plan, entities, step count, random stream and the world's own attributes."""
        return state_hash(type(self).__name__, self._state())

    def scene_hash(self) -> int:
        """Return the hash of the state without the step count."""
        state = self._state()
        del state["step_count"]
        return state_hash(type(self).__name__, state)

    def save(self) -> FirstPersonSnapshot:
        """Return an exact copy of the state, which can be pickled and restored into any world of the same class."""
        _ = self.stage  # raises an error before the first reset
        return save_state(type(self).__name__, self._over, self._state())

    def restore(self, saved: Any) -> None:
        """Restore a saved state.

        Raises:
            WorldError: if the state comes from another kind of world.
        """
        if not isinstance(saved, FirstPersonSnapshot) or saved.world != type(self).__name__:
            raise WorldError(f"{saved!r} was not saved by a {type(self).__name__}; pass what save() returned")
        for name in self._state().keys() - saved.own.plain.keys() - saved.own.copied.keys():
            delattr(self, name)
        vars(self).update(restore_state(saved, in_place=self._stage is saved.stage))
        self._over = saved.over
        note_change()

    def _not_reset(self) -> WorldError:
        return WorldError(f"{type(self).__name__} has not been reset; call reset(seed=...) first")

    def _state(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name not in _NOT_STATE}
