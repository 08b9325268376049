"""Steps per CPU-second of worlds of rules, ours and XLand-MiniGrid's, of the same tasks, taking turns; and of drawing.

    python -m benchmarks.rules [--short]

Both step 1,024 worlds in one thread, with autoreset, and take the same actions. XLand-MiniGrid is given the tasks of
our sets in its own numbers; 100 of its steps are one compiled call, so that no time is lost in Python, and compilation
is not counted. Ours are called step by step. What is drawn is a task with its layout, from a set of so many tasks.
"""

import argparse
import os
import statistics
import tempfile
import time
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false"  # before JAX is imported
os.environ.setdefault("JAX_PLATFORMS", "cpu")

import gymnasium
import jax
import jax.numpy as jnp
import numpy as np
import xminigrid
from xminigrid.types import RuleSet
from xminigrid.wrappers import GymAutoResetWrapper

import minihuman  # noqa: F401
from minihuman.worlds.grid.ruleset.encodings import encode_tasks
from minihuman.worlds.grid.ruleset.env import RulesetWorld
from minihuman.worlds.grid.ruleset.generator import PRESETS, generate_tasks
from minihuman.worlds.grid.ruleset.layouts import lay_out_task
from minihuman.worlds.grid.ruleset.tasks import build_task_set, find_task_set
from minihuman.worlds.rng import read_rng_state

WORLDS = 1024
STEPS = 100  # of XLand-MiniGrid in one call
ROUNDS = 3
CASES = (("small", 1, 9), ("small", 4, 13), ("medium", 4, 13))


def stepping_ours(task_set: str, rooms: int, size: int, actions: np.ndarray) -> Callable[[], float]:
    """A round of our steps: steps per CPU-second."""
    options = {"task_set": task_set, "rooms": rooms, "height": size, "width": size}
    batch = gymnasium.make_vec("minihuman/Rules-v0", WORLDS, "vector_entry_point", autoreset_mode="SameStep", **options)
    batch.reset(seed=0)

    def round_() -> float:
        start = time.process_time()
        for step in range(10 * STEPS):
            batch.step(actions[step % STEPS])
        return 10 * STEPS * WORLDS / (time.process_time() - start)

    return round_


def read_rulesets(name: str) -> RuleSet:
    """The first 1,024 tasks of a set, in XLand-MiniGrid's form; where there are fewer, some are there twice."""
    tasks = find_task_set(name)
    world = RulesetWorld(task_set=name, height=255, width=255)
    rows = []
    things = []
    for number in range(WORLDS):
        at = number % len(tasks)
        lay_out_task(world.row, np.ones(6, np.uint64), tasks.records, tasks.starts, at, at + 1, 1)
        rows.append(world.row[: 16 + 4 * world.most_rules].copy())
        things.append(tasks[at].things)
    goals, rules = encode_tasks(np.array(rows), world.most_rules)
    most = max(map(len, things))
    tiles = [[(tile & 15, tile >> 4) for tile in (*some, *[0] * (most - len(some)))] for some in things]
    return RuleSet(jnp.array(goals), jnp.array(rules), jnp.array(tiles, jnp.uint8))


def stepping_theirs(task_set: str, rooms: int, size: int, actions: np.ndarray) -> Callable[[], float]:
    """A round of XLand-MiniGrid's steps: steps per CPU-second."""
    environment, parameters = xminigrid.make(f"XLand-MiniGrid-R{rooms}-{size}x{size}")
    environment = GymAutoResetWrapper(environment)
    rulesets = read_rulesets(task_set)

    def reset(key: Any, ruleset: Any) -> Any:
        return environment.reset(parameters.replace(ruleset=ruleset), key)

    def step(timestep: Any, ruleset: Any, action: Any) -> Any:
        return environment.step(parameters.replace(ruleset=ruleset), timestep, action)

    def run(timesteps: Any, chosen: Any) -> Any:
        return jax.lax.scan(lambda now, row: (jax.vmap(step)(now, rulesets, row), None), timesteps, chosen)[0]

    compiled = jax.jit(run)
    chosen = jnp.array(actions)
    timesteps = jax.jit(jax.vmap(reset))(jax.random.split(jax.random.key(0), WORLDS), rulesets)
    timesteps = jax.block_until_ready(compiled(timesteps, chosen))

    def round_() -> float:
        start = time.process_time()
        jax.block_until_ready(compiled(timesteps, chosen))
        return STEPS * WORLDS / (time.process_time() - start)

    return round_


def print_drawing(count: int) -> None:
    """Print how large a file of tasks is, and how long drawing one takes."""
    start = time.process_time()
    tasks = build_task_set(generate_tasks(PRESETS["high"], count))
    generated_s = time.process_time() - start
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "tasks.npz")
        tasks.save(path)
        size_mb = path.stat().st_size / 1e6
        start = time.process_time()
        world = RulesetWorld(task_set=str(path), difficulty=[2, 6])
        read_s = time.process_time() - start
        first = world.source.first, world.source.last
        rng_state = np.zeros(6, np.uint64)
        read_rng_state(np.random.default_rng(0), rng_state)
        lay_out_task(world.row, rng_state, tasks.records, tasks.starts, *first, 1)  # which compiles it where it is not
        start = time.process_time()
        for _ in range(10_000):
            lay_out_task(world.row, rng_state, tasks.records, tasks.starts, *first, 1)
        drawn_us = (time.process_time() - start) * 100
        start = time.process_time()
        for _ in range(10_000):
            world.reset()
        reset_us = (time.process_time() - start) * 100
    print(
        f"\n{count:,} tasks of the preset high: generated in {generated_s:.0f} CPU-s, a file of {size_mb:.1f} MB, read "
        f"in {read_s:.1f} CPU-s;\ndrawing a task of difficulty 2 to 6 and its layout: {drawn_us:.1f} us; a whole "
        f"reset, with its instruction and observation: {reset_us:.1f} us"
    )


def main() -> None:
    """Print a table of ratios, and a line about drawing."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--short", action="store_true", help="one case, one round: shows only that it runs")
    short = parser.parse_args().short
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})  # one thread each
    versions = ", ".join(f"{name} {version(name)}" for name in ("xminigrid", "jax", "numpy"))
    print(f"{versions}; {WORLDS} worlds, one thread; million steps per CPU-second, medians of {1 if short else ROUNDS}")
    print("| tasks | rooms | cells | ours | XLand-MiniGrid | ratio | least ratio |\n|---|---|---|---|---|---|---|")
    actions = np.random.default_rng(0).integers(0, 6, (STEPS, WORLDS))
    for task_set, rooms, size in CASES[: 1 if short else None]:
        ours = stepping_ours(task_set, rooms, size, actions)
        theirs = stepping_theirs(task_set, rooms, size, actions)
        ours()
        rounds = [(ours(), theirs()) for _ in range(1 if short else ROUNDS)]
        mine, its = (statistics.median(rates) / 1e6 for rates in zip(*rounds, strict=True))
        ratios = [a / b for a, b in rounds]
        print(
            f"| {task_set} | {rooms} | {size} x {size} | {mine:.2f} | {its:.3f} | {statistics.median(ratios):.0f} | "
            f"{min(ratios):.0f} |",
            flush=True,
        )
    print_drawing(10_000 if short else 1_000_000)


if __name__ == "__main__":
    main()
