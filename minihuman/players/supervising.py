"""A simulated teacher at the keys: plays, takes over, hands back, shows it better, rates and compares.

``--player supervisor:patience_steps=6,critic_rate=0.5,rater_lapse=0``: the settings are those of ``Supervising``, those
of ``Criticising`` behind ``critic_`` and those of ``Judging`` behind ``rater_``. As a critic and as a rater it goes by
the planner's way; where a world has none it presses nothing and cannot tell.
"""

import json
from contextlib import closing
from dataclasses import fields
from typing import Any

import numpy as np

from minihuman.errors import PlayerError
from minihuman.players.critic import Critic, Criticising
from minihuman.players.port import Press
from minihuman.players.rater import Judging, Rater
from minihuman.players.supervisor import Supervising, Supervisor
from minihuman.players.teacher import Teacher, Watched
from minihuman.study.activities.pair_events import Stretch, Verdict
from minihuman.study.plan import EpisodePlan
from minihuman.worlds.adapt.world import World

REPEAT_MS = 250.0  # from one key to the next, while it steers
COMPARING_MS = 1_000.0  # from the end of a pair to the answer
ROLES: dict[str, type[Supervising | Criticising | Judging]] = {
    "": Supervising,
    "critic_": Criticising,
    "rater_": Judging,
}  # what is set, by what its settings' names begin with


class SupervisingPlayer(Teacher):
    """A ``Supervisor`` with a key for each of its actions, a ``Critic`` and a ``Rater``."""

    def __init__(self, argument: str, rng: np.random.Generator) -> None:
        settings = _settings(argument)
        self._supervisor = Supervisor(Supervising(**settings[""]), rng)
        self._critic = Critic(Criticising(**settings["critic_"]), rng)
        self._rater = Rater(Judging(**settings["rater_"]), rng)
        self._key_of: dict[str, str] = {}
        self._judged: tuple[int, int | None] | None = None  # the step it looked at last as a critic; steps left then

    def begin(self, plan: EpisodePlan, pool: tuple[str, ...], world: World) -> None:
        """Look for the first time."""
        self._key_of = {action: key for key, action in reversed(plan.key_map.keys.items())}
        self._supervisor.begin(world)
        self._steered_to: int | None = None  # the step that its own key led to
        self._judged = None

    def press(self, world: World) -> Press:
        """Its own next key.

        Raises:
            PlayerError: if it knows nothing to do, or the action has no key.
        """
        return self._next(world, self._supervisor.way(world))

    def watch(self, world: World, watched: Watched) -> Press | None:
        """Whether to take over, what to press while it steers, when to hand back; or whether it was good or bad."""
        if watched.good:
            return self._rate(world, watched)
        way = self._supervisor.way(world)
        if watched.who == "agent":
            takes_over = bool(watched.hand_back) and self._supervisor.takes_over(watched.t_ms)
            return self._next(world, way) if takes_over else None
        if watched.hand_back and watched.step == self._steered_to and self._supervisor.hands_back():
            return Press(watched.hand_back, REPEAT_MS)
        self._steered_to = watched.step + 1
        return self._next(world, way)

    def correct(self, episode: Stretch) -> int | None:
        """The first step at which it would have taken over, less those that were wasted."""
        with closing(World(episode.world, json.loads(episode.options))) as world:
            world.reset(episode.seed)
            self._supervisor.begin(world)
            for step in range(len(episode.actions) + 1):
                self._supervisor.way(world)
                if self._supervisor.has_seen_enough:
                    return max(0, step - self._supervisor.patience_steps)
                if step < len(episode.actions):
                    world.step(episode.actions[step])
        return None

    def prefer(self, left: Stretch, right: Stretch) -> tuple[Verdict, float]:
        """The stretch that has shortened the way by more steps, as far as the rater can tell."""
        gained = _gained_steps(left), _gained_steps(right)
        if gained[0] is None or gained[1] is None:
            return "cannot_tell", COMPARING_MS
        return self._rater.answer(gained[0], gained[1]), COMPARING_MS

    def _rate(self, world: World, watched: Watched) -> Press | None:
        """What the last step was worth. A step that was made while a key was still on its way is let be."""
        before, left = self._judged, 0 if watched.reached else _steps_left(world)
        self._judged = watched.step, left
        if before is None or before[0] + 1 != watched.step or before[1] is None or left is None:
            return None
        pressed = self._critic.press(before[1] - left, watched.t_ms)
        if pressed is None:
            return None
        t_ms, value = pressed
        return Press(watched.good if value > 0 else watched.bad, t_ms - watched.t_ms)

    def _next(self, world: World, way: list[str]) -> Press:
        if not way:
            raise PlayerError(f"{world.id}: the supervisor knows nothing to do; let it know all with knows_all=1")
        if way[0] not in self._key_of:
            raise PlayerError(f"{world.id}: it needs {way[0]!r}, which has no key; it has {', '.join(self._key_of)}")
        return Press(self._key_of[way[0]], REPEAT_MS)


def _steps_left(world: World) -> int | None:
    way = world.way()
    return None if way is None else len(way)


def _gained_steps(stretch: Stretch) -> int | None:
    """By how many steps a stretch has shortened the way; None where the world cannot tell."""
    with closing(World(stretch.world, json.loads(stretch.options))) as world:
        world.reset(stretch.seed)
        before, reached = None, False
        for step, action in enumerate(stretch.actions):
            if step == stretch.first:
                before = _steps_left(world)
            came = world.step(action)
            reached = came.terminated and came.reward > 0
        left = 0 if reached else _steps_left(world)
    return None if before is None or left is None else before - left


def _settings(argument: str) -> dict[str, dict[str, Any]]:
    """What is set of each role."""
    known: dict[str, tuple[str, str, Any]] = {
        prefix + field.name: (prefix, field.name, field.default)
        for prefix, role in ROLES.items()
        for field in fields(role)
    }
    values: dict[str, dict[str, Any]] = {prefix: {} for prefix in ROLES}
    for part in filter(None, argument.split(",")):
        name, _, value = part.partition("=")
        if name not in known:
            raise PlayerError(f"supervisor has no parameter {name!r}; it has {', '.join(known)}")
        prefix, field_name, default = known[name]
        try:
            read = bool(int(value)) if isinstance(default, bool) else type(default)(value)
        except (ValueError, TypeError):
            raise PlayerError(f"supervisor: {name} is {value!r}; give a number") from None
        values[prefix][field_name] = read
    return values
