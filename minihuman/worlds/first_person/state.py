"""The state of a first-person world, also as the flat arrays of `rules`: its construction, hash, map, save and restore.

Equal states have equal hashes on every machine. The names of worlds' classes and attributes are part of the hash, and
thus of the format. Saving takes a few microseconds, since it copies only what can change: the attributes of the state,
of each entity and of the world itself, and the position of the random stream. When a state is restored into the world
from which it came, the entities stay the same objects; in other worlds, they are made anew.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import WorldError
from minihuman.worlds.first_person import rules
from minihuman.worlds.first_person.entities import LATEST_CHANGE, Agent, Entity, Length, Position, note_change
from minihuman.worlds.first_person.motion_kernels import COMMAND_TURN, RADIANS, move_by, move_freely
from minihuman.worlds.first_person.parameters import Parameter, Parameters, uniform, weighted
from minihuman.worlds.first_person.rooms import (
    FloorPlan,
    OpeningLimits,
    Room,
    check_convex,
    cut_passage,
    finish_floor_plan,
)
from minihuman.worlds.first_person.walls import touches_wall
from minihuman.worlds.hashing import hash64
from minihuman.worlds.pose import Map, Thing
from minihuman.worlds.trigonometry import cosine, sine

_MOST_TRIES = 100_000  # draws of a place for one thing, after which the world counts as too full

WALL = "wall"


class WorldState:
    """The state of one episode; rooms come first, and the floor plan is closed when the first entity is placed.

    If ``randomised``, parameters are drawn from their ranges; otherwise, they keep their defaults.
    """

    has_heights = False  # whether floors lie at heights, as in a building

    def __init__(self, rng: np.random.Generator, parameters: Parameters, *, randomised: bool) -> None:
        self.rng = rng
        self.parameters = parameters
        self.randomised = randomised
        self.agent = Agent()
        self.entities: list[Entity] = []  # the agent among them, once it is placed
        self.reach = parameters.largest("forward_step")  # the longest step, metres
        self._rooms: list[Room] = []
        self._floor: FloorPlan | None = None

    @property
    def rooms(self) -> tuple[Room, ...]:
        """Return the rooms so far, including passages."""
        return tuple(self._rooms)

    @property
    def varying(self) -> np.random.Generator | None:
        """Return the random stream from which parameters are drawn; None if nothing varies."""
        return self.rng if self.randomised else None

    @property
    def floor(self) -> FloorPlan:
        """Return the floor plan, which is closed when it is first read."""
        return self.close_floor_plan()

    def close_floor_plan(self) -> FloorPlan:
        """Finish the floor plan, so that no more rooms can be added, unless it is finished already; return it.

        Raises:
            WorldError: if there is no room, or two rooms overlap.
        """
        if self._floor is None:
            self._floor = finish_floor_plan(self._rooms, self.varying)
        return self._floor

    def add_room(self, room: Room) -> Room:
        """Add a room to the floor plan.

        Raises:
            WorldError: if its outline is not convex and counter-clockwise, or an entity has been placed already.
        """
        check_convex(room.outline)
        self._check_open()
        room.number = len(self._rooms)
        self._rooms.append(room)
        return room

    def connect_rooms(self, a: Room, b: Room, *, limits: OpeningLimits, top: float | None) -> None:
        """Open the walls with which two rooms face each other, and add a passage if there is a gap between them."""
        self._check_open()
        between = cut_passage(a, b, limits=limits, top=top, number=len(self._rooms))
        if between is not None:
            self._rooms.append(between)

    def place(
        self,
        entity: Entity,
        *,
        room: Room | None,
        dir: float | None,
        x: tuple[float | None, float | None],
        z: tuple[float | None, float | None],
    ) -> None:
        """Place an entity at random where it touches nothing, in a room (None: in any) and in ranges (None: no limit).

        Raises:
            WorldError: if no free position is found.
        """
        floor = self.floor
        radius = float(entity.radius)
        for _ in range(_MOST_TRIES):
            outline = (floor.rooms[weighted(self.rng, floor.room_weights)] if room is None else room).outline
            low_x = (outline.min_x if x[0] is None else x[0]) - radius
            high_x = (outline.max_x if x[1] is None else x[1]) + radius
            low_z = (outline.min_z if z[0] is None else z[0]) - radius
            high_z = (outline.max_z if z[1] is None else z[1]) + radius
            at_x = uniform(self.rng, low_x, high_x)
            self.rng.random()  # Miniworld draws a height too, between 0 and 0
            at_z = uniform(self.rng, low_z, high_z)
            if outline.contains(at_x, at_z) and self.blocker(entity, at_x, at_z, entity.radius) is None:
                break
        else:
            raise WorldError(f"no free place for {entity.name} (radius {entity.radius:.2f} m); make the room larger")
        self.put(entity, (at_x, 0.0, at_z), dir)

    def put(self, entity: Entity, pos: Position, dir: float | None) -> None:
        """Place an entity at an exact position, whatever it touches; without a heading, one is drawn."""
        self._floor = self.floor  # the plan closes before the heading is drawn
        if dir is None:
            entity.dir = uniform(self.rng, -math.pi, math.pi)
        else:
            entity.dir = dir
        entity.pos = pos
        if entity not in self.entities:  # one that was placed before is only moved
            self.entities.append(entity)

    def blocker(self, entity: Entity, x: float, z: float, radius: Length) -> Entity | str | None:
        """Return what an entity of a radius would touch at (x, z): WALL, another entity, or None."""
        if touches_wall(self.floor.walls, x, z, float(radius)):
            return WALL
        for obstacle in self.entities:
            if obstacle is entity:
                continue
            dx = obstacle.pos[0] - x
            dz = obstacle.pos[2] - z
            if math.sqrt(dx * dx + dz * dz) < float(radius + obstacle.radius):
                return obstacle
        return None

    def shadow_height(self, pos: Position) -> float:
        """Return the height at which the shadow of a thing at a position lies; NaN if it is not on the floor."""
        return pos[1] if pos[1] == 0.0 else math.nan

    def carrying_position(self, pos: Position, carried: Entity) -> Position:
        """Return the position of a carried entity when the agent is at ``pos``: ahead, below the picture's middle."""
        agent = self.agent
        distance = float(agent.radius + carried.radius + self.reach)
        ahead_x, ahead_z = agent.forward
        rise = max(agent.cam_height - carried.height - 0.3, 0.0)  # 0.3 m and 1.05 are Miniworld's
        return pos[0] + ahead_x * 1.05 * distance, pos[1] + rise, pos[2] + ahead_z * 1.05 * distance

    def near(self, a: Entity, b: Entity) -> bool:
        """Return whether the gap between two entities is below 1.1 times the longest step."""
        ax, ay, az = a.pos
        bx, by, bz = b.pos
        distance = math.sqrt((ax - bx) ** 2 + (ay - by) ** 2 + (az - bz) ** 2)
        return distance < float(a.radius + b.radius + 1.1 * self.reach)  # 1.1 steps, as in Miniworld

    def randomise(self) -> None:
        """Draw what varies between episodes: sky, light, then each entity in the order in which it was placed."""
        rng = self.varying
        self.sky_colour = self.parameters.triple("sky_color", rng)
        self.light_pos = self.parameters.triple("light_pos", rng)
        self.light_colour = self.parameters.triple("light_color", rng)
        self.light_ambient = self.parameters.triple("light_ambient", rng)
        for entity in self.entities:
            entity.randomise(self.parameters, rng)

    def _check_open(self) -> None:
        if self._floor is not None:
            raise WorldError(
                "a thing has been placed, so the floor plan is fixed; add and connect all rooms before placing things"
            )


def move_body(stage: WorldState, dx: float, dz: float, dyaw: float) -> bool:
    """Turn the agent by radians to the left, then move it by metres in the plan; return whether it turned or moved.

    It slides along walls and things in its way. The world may be one that is still being built.
    """
    agent = stage.agent
    load = agent.carrying
    things = list(dict.fromkeys((*stage.entities, agent, *(() if load is None else (load,)))))
    numbers = np.zeros(rules.ARGUMENTS)
    numbers[rules.COUNT] = len(stage.entities)
    numbers[rules.AGENT] = things.index(agent)
    numbers[rules.CARRIED] = -1.0 if load is None else things.index(load)
    numbers[rules.REACH] = stage.reach
    numbers[rules.EYE] = agent.cam_height
    rows = np.array([describe_thing(thing) for thing in things])
    cos, sin = (cosine, sine) if agent.trig else (math.cos, math.sin)
    sines = cos(agent.dir), sin(agent.dir), cos(agent.dir + dyaw), sin(agent.dir + dyaw)
    status: int = move_by(rows, numbers, stage.floor.walls, dx, dz, dyaw, *sines)
    for thing in (agent,) if load is None else (agent, load):
        x, y, z, thing.dir = rows[things.index(thing), : rules.DIR + 1].tolist()
        thing.pos = x, y, z
    return bool(status & rules.MOVED)


def describe_thing(thing: Entity) -> tuple[float, ...]:
    """Return an entity as a row of the kernels' arrays."""
    is_single = isinstance(thing.radius, np.float32)
    return *thing.pos, thing.dir, float(thing.radius), thing.height, thing.static, is_single, -1.0  # -1: without looks


def state_hash(kind: str, state: dict[str, Any]) -> int:
    """Return a hash of the attributes of a world's state; ``kind`` is the name of the world's class.

    Entities are hashed once, in the order in which they were placed; other references to them count as their index.

    Raises:
        WorldError: if an attribute holds a value without a canonical form.
    """
    stage = state["_stage"]
    if not isinstance(stage, WorldState):
        raise WorldError(f"{kind} has not been reset; call reset(seed=...) first")
    index_by_id = {id(entity): index for index, entity in enumerate(stage.entities)}
    attributes = {
        name: _to_hashable(value, index_by_id, f"{kind}.{name}")
        for name, value in state.items()
        if name not in ("_stage", "_np_random", "_np_random_seed")
    }
    carrying = stage.agent.carrying
    return hash64(
        (
            kind,
            stage.floor.fingerprint,
            _read_stream(stage.rng),
            [entity.state() for entity in stage.entities],
            None if carrying is None else index_by_id.get(id(carrying), -1),
            (stage.sky_colour, stage.light_pos, stage.light_colour, stage.light_ambient),
            attributes,
        )
    )


def _read_stream(rng: np.random.Generator) -> tuple[Any, ...]:
    """Return the numbers that make up the state of a random stream."""
    state = rng.bit_generator.state
    inner = state["state"]
    return inner["state"], inner["inc"], state["has_uint32"], state["uinteger"]


def _to_hashable(value: Any, index_by_id: dict[int, int], name: str) -> Any:
    """Return a value in a form that can be hashed; an entity is represented by its index, or its state if removed."""
    match value:
        case Entity():
            index = index_by_id.get(id(value))
            if index is None:
                return ("gone", value.state())
            return ("placed", index)
        case Room():
            return "room", value.number
        case None | bool() | int() | float() | str() | bytes() | np.ndarray() | np.generic():
            return value
        case dict():
            return {str(key): _to_hashable(inner, index_by_id, name) for key, inner in value.items()}
        case tuple() | list():
            return [_to_hashable(inner, index_by_id, name) for inner in value]
        case _:
            raise WorldError(
                f"{name} is a {type(value).__name__}; a world's state may hold numbers, text, entities, arrays, "
                "and tuples, lists and dicts of them"
            )


def floor_map(stage: WorldState) -> Map:
    """Return the floor plan in metres: the walls that stop a body, and the places of all entities but the agent."""
    return Map(
        unit="m",
        bounds=stage.floor.bounds,
        walls=tuple((x0, z0, x1, z1) for x0, z0, x1, z1 in stage.floor.walls.tolist()),
        things=tuple(
            Thing(entity.name, entity.pos[0], entity.pos[2], float(entity.radius), entity.colour)
            for entity in stage.entities
            if entity is not stage.agent
        ),
    )


MOTION_PARAMETERS = ("forward_step", "forward_drift", "turn_step")
_CHANGED = ~(rules.TERMINATED | rules.TRUNCATED)  # the parts of a status that mean a change of entities


class TerminationRule(NamedTuple):
    """A termination rule with its arguments, as the functions of `termination_rules` return it."""

    kind: int = rules.NEVER
    things: tuple[Entity, ...] = ()
    numbers: tuple[float, ...] = ()
    score: str = ""  # the world's attribute in which the rule counts; "" for none


class SteppedWorld(Protocol):
    """The part of `FirstPersonEnv` that `FlatState` needs of the world it steps."""

    kernel_actions: tuple[str, ...]
    acceleration: float
    velocity: tuple[float, float]  # with an acceleration
    max_steps: int | None
    step_count: int

    @property
    def stage(self) -> WorldState:
        """Return the state that has been built."""

    @property
    def motions(self) -> Mapping[str, str]:
        """Return, for each action of another name, the action of rules.ACTIONS that it does."""

    def termination_rule(self) -> TerminationRule:
        """Return the rule for the reward of a step and the end of an episode."""

    def place_entity(self, entity: Entity) -> Entity:
        """Place an entity at a random position where it touches nothing."""


class FlatState:
    """The flat arrays of one episode, made when a world has been built or restored from another world's state."""

    def __init__(self, world: SteppedWorld) -> None:
        stage = self.stage = world.stage
        ranges = [stage.parameters[name] for name in MOTION_PARAMETERS]
        self.reward = 0.0  # of the last step
        self.latest_change = 0  # the number of the latest change of entities that is in the arrays
        self.walls = stage.floor.walls
        self._varies = ranges if stage.randomised else None
        self.motions = [rules.ACTIONS.index(world.motions.get(name, name)) for name in world.kernel_actions]
        self._head = np.zeros(rules.ARGUMENTS)
        self._head[rules.STEP_LIMIT] = -1.0 if world.max_steps is None else world.max_steps
        self._head[rules.REACH] = stage.reach
        self._head[rules.ACCELERATION] = world.acceleration
        for k, parameter in enumerate(ranges):
            bounds = (parameter.default, parameter.low, parameter.high)
            for start, value in zip((rules.AHEAD, rules.LOW, rules.HIGH), bounds, strict=True):
                self._head[start + k] = value
        self._head[rules.VARIES] = stage.randomised
        for k, (name, motion) in enumerate(zip(world.kernel_actions, self.motions, strict=True)):
            self._head[rules.NAMED + k] = rules.ACTIONS.index(name) + 8 * motion
        self.turn_rad = float(self._head[rules.TURN_DEG]) * RADIANS
        self.read_rule(world)

    @property
    def score(self) -> str:
        """Return the attribute of the world in which the rule counts; "" if there is none."""
        return self._rule.score

    def __reduce__(self) -> tuple[Any, ...]:
        return type(None), ()  # a copy of a world makes its own

    def read_rule(self, world: SteppedWorld) -> None:
        """Read the world's termination rule anew, and make new arrays for it."""
        self._rule = world.termination_rule()
        self._entities: list[Entity] = []  # none yet
        self.refresh()

    def refresh(self) -> None:
        """Copy the entities into the arrays, if they may have changed."""
        stage = self.stage
        if self._entities == stage.entities and self.latest_change == LATEST_CHANGE[0]:
            return
        carried = stage.agent.carrying
        if self._entities != stage.entities or (carried is not None and id(carried) not in self._rows):
            self._lay_out()
        self.latest_change = LATEST_CHANGE[0]
        self.things[:, : rules.LOOK] = [describe_thing(thing)[: rules.LOOK] for thing in self.listed]
        self._numbers[rules.CARRIED] = -1.0 if carried is None else self._rows[id(carried)]
        self._numbers[rules.EYE] = stage.agent.cam_height

    def _lay_out(self) -> None:
        """Make arrays for the placed entities, and for those that are carried or belong to the rule."""
        note_change()
        stage = self.stage
        rule = self._rule
        carrying = () if stage.agent.carrying is None else (stage.agent.carrying,)
        self._entities = list(stage.entities)
        self.listed = list(dict.fromkeys((*stage.entities, stage.agent, *rule.things, *carrying)))
        rows = self._rows = {id(thing): row for row, thing in enumerate(self.listed)}
        self.things = np.full((len(rows), rules.COLUMNS), -1.0)
        self.numbers = np.concatenate([self._head, [rows[id(thing)] for thing in rule.things], rule.numbers])
        self.numbers[rules.COUNT] = len(self._entities)
        self.numbers[rules.AGENT] = rows[id(stage.agent)]
        self.numbers[rules.RULE : rules.RULE_NUMBERS + 1] = rule.kind, len(rule.things), len(rule.numbers)
        self.numbers[rules.DRAWS] = stage.randomised or rule.kind == rules.HEALTH
        # views from which single numbers are read faster than from arrays
        self._numbers, self._facts = (
            memoryview(array).cast("B").cast("d")  # type: ignore[arg-type]
            for array in (self.numbers, self.things)
        )

    def write_counts(self, world: SteppedWorld) -> None:
        """Copy the world's step count, the rule's counter and the velocity, if there are any, into the arrays."""
        self._numbers[rules.STEPS] = world.step_count
        if self._rule.score:
            self._numbers[rules.SCORE] = getattr(world, self._rule.score)
        if world.acceleration:
            self._numbers[rules.VELOCITY], self._numbers[rules.VELOCITY + 1] = world.velocity

    def step(self, world: SteppedWorld, action: int, parts: int) -> int:
        """Execute parts of a step as `rules.act` does; store its reward and return its status. Call `refresh` before.

        Action -1 is a move that is none of the world's actions; only its reward and the end can be computed.
        """
        agent = self.stage.agent
        numbers = self._numbers
        self.write_counts(world)
        turn_rad = self.turn_rad
        motion = self.motions[action] if action >= 0 else rules.MOVE_FORWARD
        heading = agent.dir
        if self._varies is not None and parts & rules.ACT:
            self._draw_motion(self._varies)
            turn_rad = numbers[rules.TURN_DEG] * RADIANS
        cos, sin = (cosine, sine) if agent.trig else (math.cos, math.sin)
        cos_after, sin_after = cos_now, sin_now = cos(heading), sin(heading)
        if motion <= rules.TURN_RIGHT:
            after = heading + (turn_rad if motion == rules.TURN_LEFT else -turn_rad)
            cos_after = cos(after)
            sin_after = sin(after)
        status: int = rules.act(
            self.things, self.numbers, self.walls, cos_now, sin_now, cos_after, sin_after, action, parts
        )
        self.apply_step(world, status, parts)
        return status

    def _draw_motion(self, ranges: Sequence[Parameter]) -> None:
        """Draw how far the next step goes, drifts and turns, and write it to the arrays."""
        for k, parameter in enumerate(ranges, rules.AHEAD):
            self._numbers[k] = cast("float", parameter.sample(self.stage.rng))

    def move(self, world: SteppedWorld, command: NDArray[np.float64]) -> None:
        """Move the body by a command, float64[COMMAND_SIZE], without computing a reward. Call `refresh` before."""
        self.write_counts(world)
        if self._varies is not None:
            self._draw_motion(self._varies)
        agent = self.stage.agent
        heading = agent.dir
        after = heading + float(command[COMMAND_TURN]) * (self._numbers[rules.TURN_DEG] * RADIANS)
        cos, sin = (cosine, sine) if agent.trig else (math.cos, math.sin)
        sines = cos(heading), sin(heading), cos(after), sin(after)
        status: int = move_freely(self.things, self.numbers, self.walls, command, *sines)
        self._give_back(status)
        if world.acceleration:
            vars(world)["velocity"] = self._numbers[rules.VELOCITY], self._numbers[rules.VELOCITY + 1]

    def apply_step(self, world: SteppedWorld, status: int, parts: int = rules.ACT | rules.JUDGE) -> None:
        """Copy what a step changed from the arrays to the entities, and if it was judged also reward and counter."""
        if status & _CHANGED:
            self._give_back(status)
        if parts & rules.JUDGE:
            self.reward = self._numbers[rules.REWARD]
            if self._rule.score:
                setattr(world, self._rule.score, int(self._numbers[rules.SCORE]))
            if status & rules.PLACES:
                world.place_entity(self._gone)

    def _give_back(self, status: int) -> None:
        """Copy what a step changed from the arrays to the entities, without recording a change of them."""
        agent = self.stage.agent
        numbers = self._numbers
        if status & rules.MOVED:
            self._copy_place(agent, int(numbers[rules.AGENT]))
        if status & rules.LOAD and agent.carrying is not None:
            self._copy_place(agent.carrying, self._rows[id(agent.carrying)])
        if status & rules.HANDS:
            row = int(numbers[rules.CARRIED])
            if row >= 0:
                agent.carrying = self.listed[row]
            else:
                agent.carrying = None
            if agent.carrying is not None:
                self._copy_place(agent.carrying, row)
        if status & rules.GONE:
            self._gone = self.listed[int(numbers[rules.GONE_ROW])]
            self.stage.entities.remove(self._gone)
            self._copy_place(self._gone, int(numbers[rules.COUNT]))
            self._entities = []  # `refresh` makes new arrays, even if the list is the same after it is placed again

    def _copy_place(self, thing: Entity, row: int) -> None:
        """Copy an entity's position and heading from the arrays, without recording a change."""
        facts = self._facts
        start = row * rules.COLUMNS
        attributes = vars(thing)
        attributes["pos"] = facts[start], facts[start + 1], facts[start + 2]
        attributes["dir"] = facts[start + 3]
