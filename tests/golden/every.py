"""How a log of every world, option and kind of part was made: ``python -m tests.golden.every FOLDER``.

They are of the same version as those of ``make`` and lie beside them, made once and never again. The worlds of a kind
are blocks of one session: in a log for each they would take six times the room. What their tables were then is
kept by ``python -m tests.golden.cells FOLDER``.
"""

import json
import sys
from collections.abc import Iterable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

from minihuman.activities.agent_blocks.requests import NewPolicy, PolicyRequest
from minihuman.admin.manifest import record_log_end
from minihuman.admin.policies import PolicyStore
from minihuman.errors import MinihumanError
from minihuman.experiment.machine.activity import ActivityRequest
from minihuman.experiment.machine.inputs import ActivityInput
from minihuman.experiment.machine.running_episode import RunningEpisode
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.experiment.protocol.protocol import Protocol, decode_protocol
from minihuman.log.paths import SegmentPath
from minihuman.runtime.agent_host import AgentHost
from minihuman.runtime.clip_sampler import ClipSampler
from minihuman.worlds.adapters.world import World
from minihuman.worlds.catalogue import WORLDS
from minihuman.worlds.contract import CLAUSES_VERSION, PICTURES_VERSION
from minihuman.worlds.source_digest import rules_digest
from tests.golden.make import segment
from tests.worlds.option_cases import GENERAL, one_world_a_kind, options_of

KINDS = {"every-grid": "MiniGrid-", "every-level": "BabyAI-", "every-room": "MiniWorld-"}
STEPS = 16  # of an episode, at most
OPTION_STEPS = 6
FIRST = ("view", "any_mission")  # others go with these alone
SUPERVISOR = "supervisor:knows_all=1,patience_steps=2,least_steps=1,critic_rate=0.7,rater_lapse=0.0"

_WORLDS = """
[study]
name = "{name}"
version = "1"
seed = 12
participants = 4
[keys]
check = false
[[groups]]
name = "all"
blocks = {blocks}
"""
_WORLD = """
[[blocks]]
name = "{name}"
world = "{world}"
actions = {actions}
max_steps = {steps}
episodes = 1
hold_ms = 0.0
"""
_PARTS = """
[study]
name = "every-part"
version = "1"
seed = 13
participants = 4
[keys]
pool = ["1", "2", "3", "4", "q"]
[bonus]
per_point = 0.1
currency = "EUR"
base = 5.0
most = 20.0
[[exclusions]]
reason = "did hardly anything"
level = "episode"
measure = "steps"
below = 2
[[groups]]
name = "all"
parts = ["consent", "asked", "load", "about-you", "how", "quiz", "on-key", "mixed", "goodbye"]
[[orders]]
name = "mixed"
parts = ["real-time", "level", "room"]
order = "latin-square"
[[pages]]
name = "consent"
agree = true
title = "Consent"
text = "{long}"
[[pages]]
name = "how"
text = "Find the green square."
example = { world = "minihuman/MiniGrid-Empty-5x5-v0", seed = 1, marks = { agent = "you", "green goal" = "the goal" } }
[[pages]]
name = "goodbye"
closing = true
text = "{points} points are {bonus} {currency}."
[[questions]]
name = "asked"
title = "Questions"
[[questions.items]]
name = "likert"
kind = "likert"
ask = "How was it?"
low = "bad"
high = "good"
points = 5
[[questions.items]]
name = "slider"
kind = "slider"
ask = "How much?"
low = "little"
high = "much"
step = 5
show_value = true
[[questions.items]]
name = "choice"
kind = "choice"
ask = "Which?"
options = ["one", "another"]
codes = ["a", "b"]
[[questions.items]]
name = "choices"
kind = "choices"
ask = "Which of them?"
options = ["this", "that", "the other"]
[[questions.items]]
name = "number"
kind = "number"
ask = "How many?"
unit = "years"
minimum = 1
maximum = 120
[[questions.items]]
name = "text"
kind = "text"
ask = "What?"
[[questions.items]]
name = "long-text"
kind = "long_text"
ask = "What else?"
required = false
[[questions]]
name = "load"
form = "nasa-tlx"
shuffle = true
[[questions]]
name = "about-you"
form = "demographics"
[[questions]]
name = "quiz"
tries = 2
wrong = "Not so."
back_to = "how"
[[questions.items]]
name = "goal"
kind = "choice"
ask = "Where to?"
options = ["the green square", "a wall"]
right = 1
[[questions.items]]
name = "sum"
kind = "number"
ask = "One and one?"
right = 2
[[blocks]]
name = "on-key"
world = "minihuman/MiniGrid-Empty-5x5-v0"
actions = ["left", "right", "forward"]
max_steps = 20
episodes = 6
until = { successes = 2, of = 2 }
points = { goal = 10, timeout = -1, failure = -5, per_step = -0.1, per_reward = 2 }
show_points = true
marks = true
interval_ms = 300
fixation_ms = 500
instruction = "Find the green square."
feedback = { goal = "Good: {points}, {total} in all.", timeout = "Too late." }
rest = "Have a rest."
[[blocks]]
name = "real-time"
world = "minihuman/MiniGrid-Empty-5x5-v0"
actions = ["left", "right", "forward"]
max_steps = 20
episodes = 1
pace = "real_time"
step_period_ms = 300.0
noop = "done"
key_map = "shown"
[[blocks]]
name = "level"
world = "minihuman/BabyAI-GoToSeqS5R2-v1"
actions = ["left", "right", "forward", "toggle", "pickup"]
max_steps = 40
episodes = 2
key_map = "fixed"
fixed = { 1 = "left", 2 = "right", 3 = "forward", 4 = "toggle", q = "pickup" }
show_keys = true
view = "full"
palette = "colour-safe"
[[blocks]]
name = "room"
world = "minihuman/MiniWorld-OneRoom-v0"
actions = ["turn_left", "turn_right", "move_forward"]
max_steps = 40
episodes = 2
seeds = "same"
mission = "To the box."
"""
_LIMITED = """
[study]
name = "time-limit"
version = "1"
seed = 15
participants = 4
[keys]
check = false
[[groups]]
name = "all"
blocks = ["limited"]
[[blocks]]
name = "limited"
world = "minihuman/MiniWorld-OneRoom-v0"
actions = ["turn_left", "turn_right", "move_forward"]
max_steps = 40
episodes = 2
max_s = 2.0
block_max_s = 3.0
"""
_LESSON = """
[study]
name = "every-lesson"
version = "1"
seed = 14
participants = 4
[keys]
pool = ["1", "2", "3", "4"]
spare = "distractor"
check = false
[[groups]]
name = "all"
parts = ["taught", "rated", "watched", "correct", "compare", "dispute"]
[[blocks]]
name = "taught"
kind = "takeover"
world = "minihuman/MiniGrid-Empty-6x6-v0"
actions = ["left", "right", "forward"]
distractors = ["drop"]
max_steps = 16
episodes = 4
agent = { policy = "", step_ms = 400, learner = "cloning:updates=10", update_every = 1, wait_s = 1 }
[[blocks]]
name = "watched"
kind = "takeover"
world = "minihuman/MiniGrid-Empty-6x6-v0"
actions = ["left", "right", "forward"]
distractors = ["drop"]
max_steps = 8
episodes = 1
agent = { policy = "random", step_ms = 400, acts = "likeliest" }
[[blocks]]
name = "rated"
kind = "rating"
world = "minihuman/MiniGrid-Empty-6x6-v0"
actions = ["left", "right", "forward"]
distractors = ["drop"]
max_steps = 12
episodes = 1
agent = { policy = "latest", step_ms = 700 }
[[activities]]
name = "correct"
kind = "correction"
plan = { source = "taught", episodes = 3, steps = 6 }
[[activities]]
name = "compare"
kind = "preferences"
plan = { source = "taught", pairs = 3, steps = 3 }
[[activities]]
name = "dispute"
kind = "preferences"
plan = { source = "rated", pairs = 1, steps = 2, pairing = "disagreement", wait_s = 1, view = "full" }
"""
_LONG = "I take part of my own free will, and may stop at any time without saying why. " * 24

# of each option the first that does with those before it
_OWN_VALUES: dict[str, Any] = {
    "agent_view_size": 5,
    "length": 8,
    "obs_height": 30,
    "obs_width": 40,
    "room_size": 6,
    "size": 9,
    "step_m": 0.5,
    "tile_size": 8,
    "turn_deg": 30,
    "window_height": 60,
    "window_width": 80,
}
_VALUES: tuple[Any, ...] = (
    *(True, 1, 2, 3, 5, 7, 8, 9, 12, 40, 0.5, 2.5, 30.0, [1, 1], [2, 2], [3, 3], [1.0, 0.0, -2.0]),
    *("first_person", "top", "colour-safe", "wall", "box", "key", "red", "blue", "color", "loc"),
    *("RoomsFabric", "go to a ball"),
    *(["goto"], ["action"], {"forward_step": 0.3}, ["turn_left", "turn_right", "move_forward"]),
)


class Lessons(AgentHost):
    """An agent's seat whose learner is nobody: it gives one policy, then none."""

    def __init__(self, plan: SessionPlan, data: Path) -> None:
        path = SegmentPath.of_plan(data, plan)
        logs = lambda: [file for file in (path.log, path.part) if file.exists()]  # noqa: E731
        stretches = ClipSampler(logs, seed=plan.study_seed, index=plan.participant.index)
        super().__init__(PolicyStore(data / plan.study), {}, logs=logs, clips=stretches, patient=True)
        self._learnt = 0

    def answer(self, want: ActivityRequest, play: RunningEpisode | None, t_ns: int) -> ActivityInput | None:
        if not isinstance(want, PolicyRequest) or not want.learning:
            return super().answer(want, play, t_ns)
        self._learnt += 1
        return NewPolicy(t_ns, "optimal:0.4") if self._learnt == 1 else NewPolicy(t_ns, want.policy, "nothing learnt")


def worlds(name: str) -> Protocol:
    """A study whose blocks are the worlds of a kind, an episode in each with a key for every action."""
    return _of_worlds(name, ((entry.id, {}) for entry in WORLDS if entry.name.startswith(KINDS[name])), STEPS)


def options() -> Protocol:
    """A study whose blocks are a world of every family, with all the options that it takes."""
    return _of_worlds("every-option", ((world, _taken(world)) for world in one_world_a_kind()), OPTION_STEPS)


def parts() -> Protocol:
    """A study with every kind of part that nobody but the participant has a part in."""
    return decode_protocol(_PARTS.replace("{long}", _LONG).encode())


def limited() -> Protocol:
    """A study in which episodes end by the time that they may take."""
    return decode_protocol(_LIMITED.encode())


def lesson() -> Protocol:
    """A study with every kind of part that an agent, too, has a part in."""
    return decode_protocol(_LESSON.encode())


def _of_worlds(name: str, chosen: Iterable[tuple[str, dict[str, Any]]], steps: int) -> Protocol:
    blocks, toml = [], ""
    for world_id, its_options in chosen:
        blocks.append(world_id.partition("/")[2].lower())
        with closing(World(world_id, its_options)) as world:
            actions = json.dumps(list(world.action_names))
        toml += _WORLD.format(name=blocks[-1], world=world_id, actions=actions, steps=steps)
        if its_options:
            toml += f"options = {{ {', '.join(_fields(its_options))} }}\n"
    return decode_protocol((_WORLDS.format(name=name, blocks=json.dumps(blocks)) + toml).encode())


def _taken(world_id: str) -> dict[str, Any]:
    """As many of a world's options as go together."""
    found: dict[str, Any] = {}
    names = options_of(world_id, general=world_id in GENERAL)
    for name in sorted(names, key=lambda name: name not in FIRST):
        for value in (_OWN_VALUES.get(name, _VALUES[0]), *_VALUES):
            if _does(world_id, found | {name: value}):
                found[name] = value
                break
        else:
            print(f"{world_id}: nothing tried does for {name}", file=sys.stderr)
    return found


def _does(world_id: str, its_options: dict[str, Any]) -> bool:
    try:
        with closing(World(world_id, its_options)) as world:
            for seed in range(8):
                world.reset(seed)
            return (world.step_limit or OPTION_STEPS) >= OPTION_STEPS and len(world.action_names) > 1
    except MinihumanError:
        return False


def _fields(its_options: dict[str, Any]) -> Iterator[str]:
    for name, value in its_options.items():
        said = f"{{ {', '.join(_fields(value))} }}" if isinstance(value, dict) else json.dumps(value)
        yield f"{name} = {said}"


def make(data: Path) -> None:
    """Play every one of them."""
    facts = {"rules": rules_digest(), "pictures": str(PICTURES_VERSION), "clauses": str(CLAUSES_VERSION)}
    for protocol in (*map(worlds, KINDS), options()):
        record_log_end(segment(data, protocol, "random", facts=facts))
    record_log_end(segment(data, parts(), facts=facts))
    record_log_end(segment(data, limited(), facts=facts))
    record_log_end(segment(data, lesson(), SUPERVISOR, facts=facts, seat=Lessons))


if __name__ == "__main__":
    make(Path(sys.argv[1]))
