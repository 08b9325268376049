"""Steps per CPU-second of our grid worlds and of Minigrid's, in one process, taking turns.

    python -m benchmarks.grid [--others] [--short]

Each line is the median over rounds in which first the one, then the other plays: the machine's other work meets both.
Then batches of three sizes, and large ones on two threads beside the same on one (their column is headed "minigrid"),
in steps per second of wall time. ``--others`` adds navix and xminigrid (both need jax) where they are installed:
DoorKey-8x8 in batches of 64 and of 1,024 beside ours, in turn on the same CPU; that column is then theirs.
``--short`` plays one round of a hundredth of the steps: it shows that everything runs, and measures nothing.
"""

import argparse
import importlib.metadata
import platform
import statistics
import time
from collections.abc import Callable
from operator import itemgetter

import gymnasium
import minigrid  # noqa: F401
import numpy as np
from gymnasium.wrappers import TransformObservation
from minigrid.wrappers import ImgObsWrapper, RGBImgPartialObsWrapper

import minihuman
from minihuman.worlds.grid.env import GridWorld
from minihuman.worlds.grid.object_kinds import door, goal, key
from minihuman.worlds.grid.wrappers import PictureObservation

WORLDS = ("FourRooms-v0", "DoorKey-8x8-v0", "MultiRoom-N6-v0", "Dynamic-Obstacles-8x8-v0")
LARGE = ("MiniGrid-FourRooms-v0", "MiniGrid-DoorKey-8x8-v0", "BabyAI-GoTo-v0", "BabyAI-BossLevel-v0")
ROUNDS = 7
N = 64
SIZES = N, 1_024, 4_096  # of batches
THREADED = 4_096, 16_384


class WrittenInPython(GridWorld):
    """DoorKey-8x8 as a user writes it."""

    def __init__(self, size: int = 8) -> None:
        super().__init__(width=size, height=size, max_steps=10 * size**2)

    def layout(self, grid):
        grid.wall_rect()
        grid.put(goal(), grid.width - 2, grid.height - 2)
        split = grid.integer(2, grid.width - 2)
        grid.down(split, 0)
        grid.place_agent(size=(split, grid.height))
        grid.put(door("yellow", locked=True), split, grid.integer(1, grid.width - 2))
        grid.place(key("yellow"), size=(split, grid.height))


def stepping(env: gymnasium.Env, steps: int) -> Callable[[], float]:
    """A round of random play, resets included: steps per CPU-second."""
    actions = np.random.default_rng(0).integers(0, env.action_space.n, steps).tolist()

    def round_() -> float:
        env.reset(seed=0)
        start = time.process_time()
        for action in actions:
            _, _, terminated, truncated, _ = env.step(action)
            if terminated or truncated:
                env.reset()
        return steps / (time.process_time() - start)

    return round_


def resetting(env: gymnasium.Env, resets: int) -> Callable[[], float]:
    """A round of resets: resets per CPU-second."""

    def round_() -> float:
        env.reset(seed=0)
        start = time.process_time()
        for _ in range(resets):
            env.reset()
        return resets / (time.process_time() - start)

    return round_


def batched(
    name: str, steps: int, count: int = N, threads: int = 1, clock: Callable[[], float] = time.process_time
) -> Callable[[], float]:
    """A round of random play in a batch: steps of single worlds per second of the clock."""
    worlds = gymnasium.make_vec(
        f"minihuman/{name}", num_envs=count, vectorization_mode="vector_entry_point", threads=threads
    )
    actions = np.random.default_rng(0).integers(0, worlds.single_action_space.n, (steps, count))

    def round_() -> float:
        worlds.reset(seed=0)
        start = clock()
        for action in actions:
            worlds.step(action)
        return actions.size / (clock() - start)

    return round_


def compare(what: str, ours: Callable[[], float], theirs: Callable[[], float], wanted: float, *, rounds: int) -> None:
    """Play rounds in turn and print medians and the median of the rounds' ratios."""
    ours(), theirs()  # compile and warm up
    pairs = [(ours(), theirs()) for _ in range(rounds)]
    ratio = statistics.median(mine / its for mine, its in pairs)
    mine, its = (statistics.median(column) for column in zip(*pairs, strict=True))
    print(f"{what:44}{mine:12,.0f}{its:12,.0f}{ratio:9.{2 if wanted < 5 else 0}f}x   at least {wanted:g}x", flush=True)


def pixels(env: gymnasium.Env) -> gymnasium.Env:
    """Our 56 x 56 picture of the agent's view, alone."""
    drawn = PictureObservation(env, tile_px=8)
    return TransformObservation(drawn, itemgetter("image"), drawn.observation_space["image"])


def navix_worlds(count: int) -> Callable[[], float]:
    """A round of navix's DoorKey-8x8: steps of single worlds per CPU-second."""
    import jax
    import navix

    env = navix.make("Navix-DoorKey-8x8-v0")
    step = jax.jit(jax.vmap(env.step))
    return jax_round(step, jax.jit(jax.vmap(env.reset))(jax.random.split(jax.random.PRNGKey(0), count)), count, 500)


def xminigrid_worlds(count: int) -> Callable[[], float]:
    """A round of xminigrid's DoorKey-8x8: steps of single worlds per CPU-second."""
    import jax
    import xminigrid

    env, parameters = xminigrid.make("MiniGrid-DoorKey-8x8")
    step = jax.jit(jax.vmap(lambda timestep, action: env.step(parameters, timestep, action)))
    seeds = jax.random.split(jax.random.PRNGKey(0), count)
    return jax_round(step, jax.jit(jax.vmap(lambda seed: env.reset(parameters, seed)))(seeds), count, 20_000)


def jax_round(step: Callable, state: object, count: int, steps: int) -> Callable[[], float]:
    """Rounds of a jitted batch step, each of about ``steps`` steps of single worlds."""
    import jax

    actions = np.random.default_rng(0).integers(0, 6, (max(10, steps // count), count))
    state = jax.block_until_ready(step(state, actions[0]))

    def round_() -> float:
        now = state
        start = time.process_time()
        for action in actions:
            now = step(now, action)
        jax.block_until_ready(now)
        return actions.size / (time.process_time() - start)

    return round_


def main() -> None:
    """Print every comparison."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--others", action="store_true", help="also navix and xminigrid")
    arguments.add_argument("--short", action="store_true", help="one round of a hundredth of the steps")
    asked = arguments.parse_args()
    rounds, share = (1, 100) if asked.short else (ROUNDS, 1)
    versions = ", ".join(f"{name} {importlib.metadata.version(name)}" for name in ("minigrid", "numba", "numpy"))
    print(f"minihuman {minihuman.__version__}; {versions}; Python {platform.python_version()}; {time.strftime('%F')}")
    print(f"{'':44}{'ours':>12}{'minigrid':>12}{'ratio':>10}")
    for name in WORLDS:
        make = lambda name=name: gymnasium.make(f"minihuman/MiniGrid-{name}")  # noqa: E731
        theirs = gymnasium.make(f"MiniGrid-{name}")
        compare(
            f"{name}, one world", stepping(make(), 10_000 // share), stepping(theirs, 400 // share), 80, rounds=rounds
        )
        compare(
            f"{name}, batch of {N}",
            batched(f"MiniGrid-{name}", 400 // share),
            stepping(theirs, 400 // share),
            350,
            rounds=rounds,
        )
        compare(
            f"{name}, reset",
            resetting(make(), max(1, 500 // share)),
            resetting(theirs, max(1, 20 // share)),
            5,
            rounds=rounds,
        )
        picture = ImgObsWrapper(RGBImgPartialObsWrapper(gymnasium.make(f"MiniGrid-{name}"), tile_size=8))
        compare(
            f"{name}, 56 x 56 pictures",
            stepping(pixels(make()), 5_000 // share),
            stepping(picture, 200 // share),
            50,
            rounds=rounds,
        )
    theirs = gymnasium.make("MiniGrid-DoorKey-8x8-v0")
    compare(
        "DoorKey-8x8 written in Python, one world",
        stepping(WrittenInPython(), 10_000 // share),
        stepping(theirs, 400 // share),
        15,
        rounds=rounds,
    )
    for name in LARGE:
        rates = [
            statistics.median(play() for _ in range(rounds))
            for play in [batched(name, max(2, 200_000 // count // share), count) for count in SIZES]
        ]
        shown = "".join(f"{rate / 1e6:9.2f} M" for rate in rates)
        print(f"{name}, batches of {', '.join(map(str, SIZES))}:{shown} steps per CPU-second", flush=True)
    for name in LARGE:
        for count in THREADED:
            steps = max(2, 400_000 // count // share)
            one, two = (batched(name, steps, count, threads, time.perf_counter) for threads in (1, 2))
            compare(f"{name}, batch of {count}: two threads, one", two, one, 1.8, rounds=rounds)
    if asked.others:
        for peer, make, wanted in (("navix", navix_worlds, (200, 200)), ("xminigrid", xminigrid_worlds, (30, 20))):
            for count, least in zip(SIZES, wanted, strict=False):
                ours = batched("MiniGrid-DoorKey-8x8-v0", max(2, 200_000 // count // share), count)
                what = f"{peer} {importlib.metadata.version(peer)}, DoorKey-8x8, batch of {count}"
                compare(what, ours, make(count), least, rounds=rounds)


if __name__ == "__main__":
    main()
