"""Joint steps per CPU-second of our kitchen, of Overcooked-AI's and of CoGrid's, in one process, taking turns.

    pip install --no-deps overcooked-ai==1.1.0 cogrid==0.3.2
    python -m benchmarks.kitchen [--short]

All play cramped_room with random joint actions, two cooks, 400 steps an episode, resets included. Each line is the
median over rounds in which one after the other plays. Overcooked-AI is timed twice: its step alone, and with both
cooks' lossless encodings, as ours is. ``--short`` plays a hundredth of the steps and measures nothing.
"""

import argparse
import importlib.metadata
import platform
import statistics
import sys
import time
from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np

import minihuman

WORLD = "minihuman/Team-CrampedRoom-v0"
HORIZON = 400
ROUNDS = 5
BATCH = 64
Round = Callable[[], float]


def joint_actions(steps: int) -> list[tuple[int, int]]:
    """Random actions of two cooks."""
    return [(int(one), int(other)) for one, other in np.random.default_rng(0).integers(0, 6, (steps, 2))]


def timed(play: Callable[[], int]) -> Round:
    """A round of play: joint steps per CPU-second."""

    def round_() -> float:
        start = time.process_time()
        steps = play()
        return steps / (time.process_time() - start)

    return round_


def native(steps: int) -> Round:
    """Our kitchen, with both observations."""
    world, actions = minihuman.make_team(WORLD, max_steps=HORIZON), joint_actions(steps)

    def play() -> int:
        world.reset(0)
        for joint in actions:
            done = world.step(joint)
            world.observation(0)
            world.observation(1)
            if done.truncated:
                world.reset(0)
        return len(actions)

    return timed(play)


def batched(steps: int) -> Round:
    """Our kitchens in a batch."""
    batch = minihuman.make_team(WORLD, max_steps=HORIZON).batch(BATCH)
    actions = np.random.default_rng(0).integers(0, 6, (max(steps // BATCH, 2), BATCH, 2))

    def play() -> int:
        batch.reset(0)
        for joint in actions:
            batch.step(joint)
        return actions.shape[0] * BATCH

    return timed(play)


def parallel(env: Any, names: tuple[str, str], actions: list[tuple[int, int]], keys: tuple[Any, Any]) -> Round:
    """Any environment of PettingZoo's parallel API."""
    joints = [{names[0]: one, names[1]: other} for one, other in actions]
    joints = joints if names == keys else [dict(zip(keys, joint.values(), strict=True)) for joint in joints]

    def play() -> int:
        env.reset(seed=0)
        for joint in joints:
            env.step(joint)
            if not env.agents:
                env.reset()
        return len(joints)

    return timed(play)


def pettingzoo(steps: int) -> Round:
    """Our kitchen with PettingZoo's parallel API."""
    env = minihuman.parallel_env(WORLD, max_steps=HORIZON)
    names = env.possible_agents[0], env.possible_agents[1]
    return parallel(env, names, joint_actions(steps), names)


def overcooked(steps: int, *, encoded: bool) -> Round:
    """Overcooked-AI's environment, on NumPy 2 and with Gymnasium in place of gym."""
    np.Inf = np.inf
    for name in ("gym", "gym.envs", "gym.envs.registration"):
        sys.modules.setdefault(name, sys.modules[name.replace("gym", "gymnasium", 1)])
    from overcooked_ai_py.mdp.actions import Action
    from overcooked_ai_py.mdp.overcooked_env import OvercookedEnv
    from overcooked_ai_py.mdp.overcooked_mdp import OvercookedGridworld

    env = OvercookedEnv.from_mdp(OvercookedGridworld.from_layout_name("cramped_room"), horizon=HORIZON, info_level=0)
    joints = [tuple(Action.INDEX_TO_ACTION[each] for each in joint) for joint in joint_actions(steps)]

    def play() -> int:
        env.reset()
        for joint in joints:
            state, _, done, _ = env.step(joint)
            if encoded:
                env.lossless_state_encoding_mdp(state)
            if done:
                env.reset()
        return len(joints)

    return timed(play)


def cogrid(steps: int) -> Round:
    """CoGrid's kitchen on NumPy."""
    import cogrid.envs  # noqa: F401
    from cogrid.envs import registry

    env = registry.make("Overcooked-CrampedRoom-V0")
    env.reset(seed=0)
    first, second = env.agents[0], env.agents[1]
    n = int(env.action_space(first).n)
    actions = [(int(one), int(other)) for one, other in np.random.default_rng(0).integers(0, n, (steps, 2))]
    return parallel(env, ("0", "1"), actions, (first, second))


def main() -> None:
    """Play in turns and print the table."""
    parser = argparse.ArgumentParser(description="Joint steps per CPU-second of kitchens.")
    parser.add_argument("--short", action="store_true", help="Show that everything runs; measure nothing.")
    share = 100 if parser.parse_args().short else 1
    players: dict[str, Round] = {
        "ours, native, both observations": native(200_000 // share),
        f"ours, batch of {BATCH}, both observations": batched(1_000_000 // share),
        "ours, PettingZoo's parallel API": pettingzoo(100_000 // share),
        "Overcooked-AI, step alone": overcooked(4_000 // share, encoded=False),
        "Overcooked-AI, both encodings": overcooked(2_000 // share, encoded=True),
        "CoGrid, NumPy": cogrid(300 // min(share, 10)),
    }
    rates: dict[str, list[float]] = {name: [] for name in players}
    for play in players.values():
        play()  # compiles, and fills caches
    for _ in range(ROUNDS if share == 1 else 1):
        for name, play in players.items():
            rates[name].append(play())
    found = {name: statistics.median(values) for name, values in rates.items()}
    peers = list(players)[3:]
    print("| who | joint steps a CPU-second | " + " | ".join(f"against {peer}" for peer in peers) + " |")
    print("|---|---|" + "---|" * len(peers))
    for name, rate in found.items():
        ratios = [statistics.median(map(float.__truediv__, rates[name], rates[peer])) for peer in peers]
        print(f"| {name} | {rate:,.0f} | " + " | ".join(f"{ratio:,.1f}" for ratio in ratios) + " |")
    versions = {name: importlib.metadata.version(name) for name in ("overcooked-ai", "cogrid", "numpy", "numba")}
    print(
        f"\n{versions | {'gymnasium': gymnasium.__version__}}, Python {platform.python_version()}, {platform.machine()}"
    )


if __name__ == "__main__":
    main()
