"""XLand-MiniGrid, stepped from states of ours: what it makes of them is what our kernels have to make of them.

`python -m tests.worlds.grid.ruleset.xminigrid_oracle` writes `transitions.npz` anew, where xminigrid 0.9.3 is there;
with the path of its `scripts/ruleset_generator.py`, it writes `generated_tasks.json`.
"""

import importlib.util
import json
import random
import sys
from collections.abc import Callable
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from minihuman.worlds.grid.ruleset import dynamics as numbers
from minihuman.worlds.grid.ruleset.dynamics import ruleset_row_length
from minihuman.worlds.grid.ruleset.generator import PRESETS, generate_tasks
from minihuman.worlds.grid.ruleset.layouts import ROOMS, lay_out_tasks
from minihuman.worlds.grid.ruleset.tasks import RuleGoal, RuleTask, TileRule, build_task_set, parse_task
from minihuman.worlds.rng import read_rng_state

RECORDED = Path(__file__).parent / "transitions.npz"
RECORDED_TASKS = Path(__file__).parent / "generated_tasks.json"
SIZE = 13
VIEW = 5
MOST_RULES = 20
STEPS_PER_STATE = 5
ACTION_SHARES = (0.35, 0.1, 0.1, 0.2, 0.22, 0.03)  # so that things are carried and put down more often than by chance


class Transitions(NamedTuple):
    """States, actions, and what XLand-MiniGrid makes of them."""

    before: np.ndarray  # int32[steps, worlds, row]
    actions: np.ndarray  # int64[steps, worlds]
    tiles: np.ndarray  # uint8[steps, worlds, SIZE, SIZE]: kind | colour << 4
    agents: np.ndarray  # int32[steps, worlds, 4]: row, column, direction, pocket
    images: np.ndarray  # uint8[steps, worlds, VIEW, VIEW, 2]
    terminated: np.ndarray  # bool[steps, worlds]
    truncated: np.ndarray  # bool[steps, worlds]
    rewards: np.ndarray  # float32[steps, worlds]


def draw_tasks(count: int) -> list[RuleTask]:
    """Return as many tasks of each preset of the generator."""
    return [task for name in PRESETS for task in generate_tasks(PRESETS[name], count // len(PRESETS), seed=5)]


def draw_rows(tasks: list[RuleTask], rng: np.random.Generator) -> np.ndarray:
    """Return a state of each task: any rooms, things anywhere, the agent often beside one, often with one in hand."""
    rows = np.zeros((len(tasks), ruleset_row_length(SIZE, SIZE, MOST_RULES)), np.int32)
    states = np.zeros((len(tasks), 6), np.uint64)
    rows[:, [numbers.HEIGHT, numbers.WIDTH]] = SIZE
    rows[:, numbers.MAX_STEPS] = rng.integers(20, 200, len(tasks))
    for state in states:
        read_rng_state(np.random.default_rng(int(rng.integers(1 << 40))), state)
    for i, task in enumerate(tasks):
        single = build_task_set([task])
        rooms = int(rng.choice(ROOMS))
        failed = lay_out_tasks(
            rows[i : i + 1], np.zeros(1, np.int64), states[i : i + 1], single.records, single.starts, 0, 1, rooms
        )
        assert failed < 0
        rows[i, numbers.STEP] = rng.integers(0, rows[i, numbers.MAX_STEPS] - 1)
        _scatter(rows[i], task, rng)
    return rows


def _scatter(row: np.ndarray, task: RuleTask, rng: np.random.Generator) -> None:
    """Add what the rules and the goal are about here and there, and make one of them nearly happen."""
    cells = row[-SIZE * SIZE :]
    needs = [rule.inputs for rule in task.rules] + [task.goal.tiles]
    tiles = [tile for need in needs for tile in need] + [rule.product for rule in task.rules] + [*task.things]
    free = np.flatnonzero(cells == numbers.BLACK_FLOOR)
    for cell in rng.permutation(free)[: len(free) // 4]:
        cells[cell] = rng.choice(tiles)
    place = int(rng.choice(np.flatnonzero(cells == numbers.BLACK_FLOOR)))
    direction = int(rng.integers(4))
    row[[numbers.Y, numbers.X, numbers.DIRECTION]] = *divmod(place, SIZE), direction
    need = needs[int(rng.integers(len(needs)))] or (tiles[0],)
    front = place + (-SIZE, 1, SIZE, -1)[direction]
    if cells[front] == numbers.GREY_WALL:
        return
    beside = front + int(rng.choice([-SIZE, 1, SIZE, -1]))
    if len(need) == 1:
        cells[front] = need[0]
    elif beside != place and cells[beside] != numbers.GREY_WALL:
        first, second = rng.permutation(need)
        cells[front] = numbers.BLACK_FLOOR
        cells[beside] = first
        row[numbers.POCKET] = second


@cache
def compile_step() -> Callable[..., Any]:
    """Return XLand-MiniGrid's step of many states at once, each with a task and a step limit of its own."""
    import jax
    import jax.numpy as jnp
    import xminigrid
    from xminigrid.types import EnvCarry, State, StepType, TimeStep

    environment, parameters = xminigrid.make("XLand-MiniGrid-R1-13x13", view_size=VIEW)

    def step(grid: Any, agent: Any, goal: Any, rules: Any, step_number: Any, max_steps: Any, action: Any) -> Any:
        state = State(jax.random.key(0), step_number, grid, agent, goal, rules, EnvCarry())
        image = jnp.zeros((VIEW, VIEW, 2), jnp.uint8)
        timestep = TimeStep(state, StepType.MID, jnp.asarray(0.0), jnp.asarray(1.0), image)
        return environment.step(parameters.replace(max_steps=max_steps), timestep, action)

    return jax.jit(jax.vmap(step))


def ask_xminigrid(rows: np.ndarray, tasks: list[RuleTask], actions: np.ndarray) -> Transitions:
    """Step XLand-MiniGrid from states, one task each."""
    import jax.numpy as jnp
    from xminigrid.types import AgentState

    stepped = compile_step()
    goals = jnp.array([encode_goal(task.goal) for task in tasks], jnp.uint8)
    padded = [[*map(encode_rule, task.rules), *[[0] * 7] * (MOST_RULES - len(task.rules))] for task in tasks]
    rules = jnp.array(padded, jnp.uint8)
    recorded: list[tuple[np.ndarray, ...]] = []
    now = rows.copy()
    for number in range(len(actions)):
        cells = now[:, -SIZE * SIZE :].reshape(-1, SIZE, SIZE)
        agent = AgentState(
            jnp.array(now[:, [numbers.Y, numbers.X]]),
            jnp.array(now[:, numbers.DIRECTION]),
            jnp.array(np.stack([now[:, numbers.POCKET] & 15, now[:, numbers.POCKET] >> 4], -1), jnp.uint8),
        )
        grid = jnp.array(np.stack([cells & 15, cells >> 4], -1), jnp.uint8)
        numbers_of_steps = jnp.array(now[:, numbers.STEP]), jnp.array(now[:, numbers.MAX_STEPS])
        after = stepped(grid, agent, goals, rules, *numbers_of_steps, jnp.array(actions[number]))
        before = now.copy()
        tiles = np.asarray(after.state.grid[..., 0]) | np.asarray(after.state.grid[..., 1]) << 4
        pockets = np.asarray(after.state.agent.pocket).astype(np.int32)
        now[:, -SIZE * SIZE :] = tiles.reshape(len(now), -1)
        now[:, [numbers.Y, numbers.X]] = np.asarray(after.state.agent.position)
        now[:, numbers.DIRECTION] = np.asarray(after.state.agent.direction)
        now[:, numbers.POCKET] = pockets[:, 0] | pockets[:, 1] << 4
        now[:, numbers.STEP] = np.asarray(after.state.step_num)
        terminated = np.asarray(after.discount) == 0
        truncated = now[:, numbers.STEP] == now[:, numbers.MAX_STEPS]
        agents = now[:, [numbers.Y, numbers.X, numbers.DIRECTION, numbers.POCKET]].copy()
        images = np.asarray(after.observation)
        assert (np.asarray(after.last()) == (terminated | truncated)).all()
        recorded.append(
            (before, actions[number], tiles, agents, images, terminated, truncated, np.asarray(after.reward))
        )
        now[:, numbers.STEP] = np.minimum(now[:, numbers.STEP], now[:, numbers.MAX_STEPS] - 1)  # it steps on
    return Transitions(*map(np.stack, zip(*recorded, strict=True)))


def encode_goal(goal: RuleGoal) -> list[int]:
    """Return a goal as XLand-MiniGrid's five numbers."""
    if goal.kind == numbers.GOAL_AGENT_AT:
        return [goal.kind, goal.first, goal.second, 0, 0]
    encoding = [goal.kind]
    for tile in goal.tiles:
        encoding += [tile & 15, tile >> 4]
    if goal.kind == numbers.GOAL_TILE_AT:
        encoding += [goal.second, goal.third]
    return [*encoding, *[0] * (5 - len(encoding))]


def encode_rule(rule: TileRule) -> list[int]:
    """Return a rule as XLand-MiniGrid's seven numbers."""
    encoding = [rule.kind]
    if rule.kind != numbers.NO_RULE:
        for tile in (*rule.inputs, rule.product):
            encoding += [tile & 15, tile >> 4]
    return [*encoding, *[0] * (7 - len(encoding))]


def record(count: int, rounds: int, seed: int) -> Transitions:
    """Return ``rounds * STEPS_PER_STATE`` random transitions of each of ``count`` tasks."""
    rng = np.random.default_rng(seed)
    tasks = draw_tasks(count)
    parts = []
    for _ in range(rounds):
        actions = rng.choice(6, (STEPS_PER_STATE, len(tasks)), p=ACTION_SHARES)
        actions[0] = rng.choice([numbers.FORWARD, numbers.PICK_UP, numbers.PUT_DOWN], len(tasks))
        parts.append(ask_xminigrid(draw_rows(tasks, rng), tasks, actions))
    return Transitions(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


def find_differences(transitions: Transitions) -> dict[str, int]:
    """Return how many transitions our kernel makes otherwise, by what differs."""
    counts = dict.fromkeys(("tiles", "agent", "image", "terminated", "truncated", "reward"), 0)
    image = np.zeros((VIEW, VIEW, 2), np.uint8)
    for number, world in np.ndindex(transitions.actions.shape):
        row = transitions.before[number, world].copy()
        row[numbers.PHASE] = numbers.PLAYING
        status = numbers.step_by_rules(row, int(transitions.actions[number, world]), image)
        tiles = row[-SIZE * SIZE :].reshape(SIZE, SIZE)
        agent = row[[numbers.Y, numbers.X, numbers.DIRECTION, numbers.POCKET]]
        earned = 1 - 0.9 * row[numbers.STEP] / row[numbers.MAX_STEPS] if status & numbers.TERMINATED else 0.0
        counts["tiles"] += not np.array_equal(tiles, transitions.tiles[number, world])
        counts["agent"] += not np.array_equal(agent, transitions.agents[number, world])
        counts["image"] += not np.array_equal(image, transitions.images[number, world])
        counts["terminated"] += bool(status & numbers.TERMINATED) != transitions.terminated[number, world]
        counts["truncated"] += bool(status & numbers.TRUNCATED) != transitions.truncated[number, world]
        counts["reward"] += abs(earned - transitions.rewards[number, world]) > 1e-6  # it computes in float32
    return counts


def write_recorded() -> None:
    transitions = record(100, 4, seed=9)
    np.savez_compressed(RECORDED, **transitions._asdict())


def read_recorded() -> Transitions:
    with np.load(RECORDED) as archive:
        return Transitions(*(archive[name] for name in Transitions._fields))


def write_recorded_tasks(script: Path) -> None:
    """Record what XLand-MiniGrid's own generator draws, as its ``main`` runs it: `ruleset_generator.py` at 0d306d14."""
    specification = importlib.util.spec_from_file_location("ruleset_generator", script)
    generator = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(generator)
    tasks: dict[str, list[Any]] = {}
    for name, settings in PRESETS.items():
        random.seed(42)
        known = set()
        tasks[name] = []
        while len(tasks[name]) < 60:
            drawn = generator.sample_ruleset(**asdict(settings))
            if generator.encode(drawn) in known:
                continue
            known.add(generator.encode(drawn))
            rules = [rule.encode().tolist() for rule in drawn["rules"]]
            tiles = [[int(part) for part in tile] for tile in drawn["init_tiles"]]
            tasks[name].append({"goal": drawn["goal"].encode().tolist(), "rules": rules, "init_tiles": tiles})
    RECORDED_TASKS.write_text(json.dumps(tasks, separators=(",", ":")) + "\n")


def read_recorded_tasks() -> dict[str, list[RuleTask]]:
    recorded = json.loads(RECORDED_TASKS.read_text())
    return {name: [parse_task(task) for task in tasks] for name, tasks in recorded.items()}


if __name__ == "__main__":
    if len(sys.argv) > 1:
        write_recorded_tasks(Path(sys.argv[1]))
    else:
        write_recorded()
