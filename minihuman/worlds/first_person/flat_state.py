"""The state of a first-person world as the flat arrays of `rules`, kept beside the things that it is about.

The things are the state: where they changed since the last step they are put into the arrays before the next one, and
what a step changes is given back to them.
"""

import math
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from minihuman.worlds.first_person import rules
from minihuman.worlds.first_person.entities import LATEST_CHANGE, Entity
from minihuman.worlds.trigonometry import cosine, sine

if TYPE_CHECKING:
    from minihuman.worlds.first_person.env import FirstPersonEnv

_DRAWN = ("forward_step", "forward_drift", "turn_step")
_RADIANS = math.pi / 180
_CHANGED = ~(rules.TERMINATED | rules.TRUNCATED)


class FlatState:
    """One episode's; made when a world has been built, or restored from another one's state."""

    def __init__(self, world: "FirstPersonEnv") -> None:
        stage = self.stage = world.stage
        ranges = [stage.parameters[name] for name in _DRAWN]
        self.reward = 0.0  # of the last step
        self.seen = 0  # the latest change that is in the arrays
        self.walls = stage.floor.walls
        self._varies = ranges if stage.randomised else None
        self._motions = [rules.ACTIONS.index(world.motions.get(name, name)) for name in world.action_names]
        self._head = np.zeros(rules.ARGUMENTS)
        self._head[rules.STEP_LIMIT] = -1.0 if world.max_steps is None else world.max_steps
        self._head[rules.REACH] = stage.reach
        for k, each in enumerate(ranges):
            bounds = (each.default, each.low, each.high)
            for start, value in zip((rules.AHEAD, rules.LOW, rules.HIGH), bounds, strict=True):
                self._head[start + k] = value
        self._head[rules.VARIES] = stage.randomised
        for k, (name, motion) in enumerate(zip(world.action_names, self._motions, strict=True)):
            self._head[rules.NAMED + k] = rules.ACTIONS.index(name) + 8 * motion
        self._turn_rad = float(self._head[rules.TURN_DEG]) * _RADIANS
        self.take_rule(world)

    @property
    def score(self) -> str:
        """The world's attribute that the rule counts in; "" for none."""
        return self._rule.score

    def __reduce__(self) -> tuple[Any, ...]:
        return type(None), ()  # a copy of a world makes its own

    def take_rule(self, world: "FirstPersonEnv") -> None:
        """Go by the rule that the world says now."""
        self._rule = world.termination_rule()
        self._entities: list[Entity] = []  # none yet
        self.refresh()

    def refresh(self) -> None:
        """Put the things into the arrays, if they may have changed."""
        stage = self.stage
        if self._entities == stage.entities and self.seen == LATEST_CHANGE[0]:
            return
        carried = stage.agent.carrying
        if self._entities != stage.entities or (carried is not None and id(carried) not in self._rows):
            self._lay_out()
        self.seen = LATEST_CHANGE[0]
        self.things[:, : rules.LOOK] = [
            (*one.pos, one.dir, one.radius, one.height, one.static, isinstance(one.radius, np.float32))
            for one in self.listed
        ]
        self._numbers[rules.CARRIED] = -1.0 if carried is None else self._rows[id(carried)]
        self._numbers[rules.EYE] = stage.agent.cam_height

    def _lay_out(self) -> None:
        """Make arrays for the things on the stage, and those that are carried or the rule's."""
        stage, rule = self.stage, self._rule
        carrying = () if stage.agent.carrying is None else (stage.agent.carrying,)
        self._entities = list(stage.entities)
        self.listed = list(dict.fromkeys((*stage.entities, stage.agent, *rule.things, *carrying)))
        rows = self._rows = {id(thing): row for row, thing in enumerate(self.listed)}
        self.things = np.full((len(rows), rules.COLUMNS), -1.0)
        self.numbers = np.concatenate([self._head, [rows[id(thing)] for thing in rule.things], rule.numbers])
        self.numbers[rules.COUNT], self.numbers[rules.AGENT] = len(self._entities), rows[id(stage.agent)]
        self.numbers[rules.RULE : rules.RULE_NUMBERS + 1] = rule.kind, len(rule.things), len(rule.numbers)
        self.numbers[rules.DRAWS] = stage.randomised or rule.kind == rules.HEALTH
        # quicker by item
        self._numbers, self._facts = (
            memoryview(each).cast("B").cast("d")  # type: ignore[arg-type]
            for each in (self.numbers, self.things)
        )

    def step(self, world: "FirstPersonEnv", action: int, parts: int) -> int:
        """Do parts of a step, as `rules.act`; its reward is in ``reward`` then. After `refresh`."""
        agent, numbers, score = self.stage.agent, self._numbers, self._rule.score
        numbers[rules.STEPS] = world.step_count
        if score:
            numbers[rules.SCORE] = getattr(world, score)
        turn_rad, motion, heading = self._turn_rad, self._motions[action], agent.dir
        if self._varies is not None and parts & rules.ACT:
            for k, each in enumerate(self._varies, rules.AHEAD):
                numbers[k] = cast("float", each.sample(self.stage.rng))
            turn_rad = numbers[rules.TURN_DEG] * _RADIANS
        cos, sin = (cosine, sine) if agent.trig else (math.cos, math.sin)
        cos_after, sin_after = cos_now, sin_now = cos(heading), sin(heading)
        if motion <= rules.TURN_RIGHT:
            after = heading + (turn_rad if motion == rules.TURN_LEFT else -turn_rad)
            cos_after, sin_after = cos(after), sin(after)
        status: int = rules.act(
            self.things, self.numbers, self.walls, cos_now, sin_now, cos_after, sin_after, action, parts
        )
        if status & _CHANGED:
            self._give_back(status)
        if parts & rules.JUDGE:
            self.reward = numbers[rules.REWARD]
            if score:
                setattr(world, score, int(numbers[rules.SCORE]))
            if status & rules.PLACES:
                world.place_entity(self._gone)
        return status

    def _give_back(self, status: int) -> None:
        """Give the things what a step changed, without a word of it: it is in the arrays."""
        agent, numbers = self.stage.agent, self._numbers
        if status & rules.MOVED:
            self._take(agent, int(numbers[rules.AGENT]))
        if status & rules.LOAD and agent.carrying is not None:
            self._take(agent.carrying, self._rows[id(agent.carrying)])
        if status & rules.HANDS:
            row = int(numbers[rules.CARRIED])
            agent.carrying = self.listed[row] if row >= 0 else None
            if agent.carrying is not None:
                self._take(agent.carrying, row)
        if status & rules.GONE:
            self._gone = self.listed[int(numbers[rules.GONE_ROW])]
            self.stage.entities.remove(self._gone)
            self._take(self._gone, int(numbers[rules.COUNT]))
            self._entities = []  # lay out anew, even if it is placed where it was in the list

    def _take(self, thing: Entity, row: int) -> None:
        facts, at, attributes = self._facts, row * rules.COLUMNS, vars(thing)
        attributes["pos"] = facts[at], facts[at + 1], facts[at + 2]
        attributes["dir"] = facts[at + 3]
