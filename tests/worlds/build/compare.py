"""Compare the page's worlds with Python's: every id, state, observation and pictures, in Node, Chromium or Firefox.

    nice -n 10 python -m tests.worlds.build.compare                   200 seeds x 200 steps, pictures at 80 x 60
    nice -n 10 python -m tests.worlds.build.compare --large           20 seeds x 20 steps, pictures at 800 x 600
    nice -n 10 python -m tests.worlds.build.compare --engine firefox --minutes 3

A round is some seeds of every id; after `--minutes` of wall time it ends with the round. The page never gets Python's
digests. Prints what ran, with the number of differences; the exit status is 1 if there is one.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, get_args

import gymnasium

import minihuman
from minihuman.worlds.catalogue import WORLDS
from minihuman.worlds.first_person.env import FirstPersonEnv
from tests.worlds.build.page_cases import LARGE, USUAL, Extent, Files, differing, page_case
from tests.worlds.build.player import Engine, page_player

SEEDS_PER_ROUND = 5
Batch = tuple[list[dict[str, Any]], dict[str, str]]  # cases, and Python's digests by their ids


def make_worlds(only: str) -> tuple[dict[str, Any], list[str]]:
    """Every world whose id contains a text, and the ids of those whose rules are Python's."""
    worlds, foreign = {}, []
    for entry in WORLDS:
        if only in entry.id:
            env: Any = gymnasium.make(entry.id).unwrapped
            if isinstance(env, FirstPersonEnv):
                env = gymnasium.make(entry.id, trig=1).unwrapped
            if env.is_compiled:
                worlds[entry.id] = env
            else:
                foreign.append(entry.id)
    return worlds, foreign


def make_batches(worlds: dict[str, Any], seeds: Sequence[int], files: Files, extent: Extent) -> Iterator[Batch]:
    """The cases of each world."""
    for world_id, env in worlds.items():
        cases, expected = [], {}
        for seed in seeds:
            name = f"{world_id} seed {seed}"
            case, expected[name] = page_case(env, seed, files, name, extent)
            cases.append(case)
        yield cases, expected


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--engine", choices=get_args(Engine), default="node")
    parser.add_argument("--simd", action="store_true", help="the modules with SIMD instructions")
    parser.add_argument("--large", action="store_true")
    parser.add_argument("--seeds", type=int, help="by default 200, with --large 20")
    parser.add_argument("--first", type=int, default=0, help="the first seed, to go on where an earlier run ended")
    parser.add_argument("--minutes", type=float, default=120.0)
    parser.add_argument("--only", default="", help="ids that contain this")
    asked = parser.parse_args()
    extent, seeds = (LARGE, asked.seeds or 20) if asked.large else (USUAL, asked.seeds or 200)
    gymnasium.logger.min_level = gymnasium.logger.ERROR  # ids with a corrected version say so
    worlds, foreign = make_worlds(asked.only)
    began_s, cpu_s, compared, wrong = time.monotonic(), time.process_time(), 0, []
    first = asked.first
    while first < seeds and time.monotonic() - began_s < asked.minutes * 60:
        chosen = range(first, min(seeds, first + SEEDS_PER_ROUND))
        with (
            tempfile.TemporaryDirectory(prefix="minihuman-") as name,
            page_player(asked.engine, Path(name), simd=asked.simd) as player,
        ):
            waiting: list[dict[str, str]] = []
            for cases, expected in make_batches(worlds, chosen, Files(Path(name)), extent):
                player.submit(cases)
                waiting.append(expected)
                if len(waiting) > 2:  # the page plays while Python does
                    wrong += differing(waiting.pop(0), player.digests())
            for expected in waiting:
                wrong += differing(expected, player.digests())
        compared += len(chosen) * len(worlds)
        first = chosen.stop
        print(
            f"to seed {first - 1}: {compared} cases, {len(wrong)} differ, {time.monotonic() - began_s:.0f} s",
            flush=True,
        )
    pictures = -(-extent.steps // extent.every)
    print(
        f"{asked.engine}{', SIMD' if asked.simd else ''}: {len(worlds)} ids x seeds {asked.first} to {first - 1} x "
        f"{extent.steps} steps of state and observation, {pictures} pictures of each view at "
        f"{extent.size_px[0]} x {extent.size_px[1]} a case: {len(wrong)} of {compared} cases differ"
    )
    print(f"not compiled, so not in a page: {', '.join(foreign) or 'none'}")
    took_s = time.process_time() - cpu_s
    print(f"minihuman {minihuman.__version__}, Python {sys.version.split()[0]}; {took_s:.0f} CPU-s in Python")
    print(*wrong[:20], sep="\n")
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
