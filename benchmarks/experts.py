"""How well the experts do what is said, beside Minigrid's bot: success, steps, and what a call costs, by level.

    python -m benchmarks.experts OUT [--seeds 100] [--levels GoToObj-v0 ...] [--short]

Each episode is a line of OUT, and a run that is broken off goes on; then the table is printed. The bot never comes
back on some layouts, so it has a limit of processor time, and so has an answer: a level that it does not end is lost.
Steps are compared on the seeds that both the explorer and the bot solve.
"""

import argparse
import contextlib
import io
import json
import signal
import time
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import gymnasium
import minigrid  # noqa: F401  # registers its levels
import numpy as np
from minigrid.utils.baby_ai_bot import BabyAIBot

import minihuman  # noqa: F401
from minihuman.worlds.catalogue import BABYAI_WORLDS
from minihuman.worlds.grid.babyai.expert import plan_instruction
from minihuman.worlds.grid.babyai.exploring_expert import Explorer

LIMIT_S = 4.0  # of processor time for an episode of the bot's
PLAYERS = "explorer", "bot"
OURS = [entry.id.removeprefix("minihuman/BabyAI-") for entry in BABYAI_WORLDS]
LEVELS = [level for level in OURS if f"BabyAI-{level}" in gymnasium.registry]  # some are ours alone


class OutOfTime(BaseException):
    """Not an `Exception`: the bot must not catch it."""


@contextlib.contextmanager
def at_most(limit_s: float) -> Iterator[None]:
    """End what runs inside after so much processor time.

    Raises:
        OutOfTime: then.
    """

    def ring(*_: Any) -> None:
        raise OutOfTime

    before = signal.signal(signal.SIGVTALRM, ring)
    signal.setitimer(signal.ITIMER_VIRTUAL, limit_s)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0)
        signal.signal(signal.SIGVTALRM, before)


def planned(env: Any, seed: int) -> dict[str, Any]:
    """The planner that sees everything: whether there is a way, how long it is, what the call took in seconds."""
    env.reset(seed=seed)
    start = time.process_time()
    way = plan_instruction(env.state.row)
    return {
        "found": way.found,
        "unsolvable": way.unsolvable,
        "steps": len(way.actions),
        "bound": way.at_least,
        "longest_s": time.process_time() - start,
    }


def played(env: Any, seed: int, chooser: Callable[[Any], Callable[[int | None], int | None]]) -> dict[str, Any]:
    """An episode: the reward, how many steps, the longest call in seconds, why it ended early if it did."""
    env.reset(seed=seed)
    action, reward, steps, longest, over, why = None, 0.0, 0, 0.0, False, ""
    try:
        with at_most(LIMIT_S):
            choose = chooser(env)
            while not over:
                start = time.process_time()
                action = choose(action)
                longest = max(longest, time.process_time() - start)
                if action is None:
                    why = "nothing left to try"
                    break
                _, reward, terminated, truncated, _ = env.step(action)
                steps += 1
                over = terminated or truncated
    except OutOfTime:
        why = f"no end in {LIMIT_S:.0f} s"
    except Exception as error:  # whatever the bot ends with
        why = type(error).__name__
    return {"solved": bool(reward > 0), "steps": steps, "longest_s": longest, "why": why}


def explores(env: Any) -> Callable[[int | None], int | None]:
    """The exploring expert."""
    explorer = Explorer(env.state)
    return lambda action: explorer.action(env.state)


def bot(env: Any) -> Callable[[int | None], int | None]:
    """Minigrid's bot."""
    mind = BabyAIBot(env.unwrapped)
    return lambda action: mind.replan(action)


def run(out: Path, levels: list[str], seeds: int) -> None:
    """Play what is not in the file yet."""
    done = {(line["level"], line["seed"], line["who"]) for line in lines(out)}
    with out.open("a") as file:
        for level in levels:
            ours = gymnasium.make(f"minihuman/BabyAI-{level}").unwrapped
            theirs: Any = gymnasium.make(f"BabyAI-{level}").unwrapped
            plays: dict[str, Callable[[int], dict[str, Any]]] = {
                "planner": lambda seed, env=ours: planned(env, seed),  # type: ignore[misc]
                "explorer": lambda seed, env=ours: played(env, seed, explores),  # type: ignore[misc]
                "bot": lambda seed, env=theirs: played(env, seed, bot),  # type: ignore[misc]
            }
            for seed in range(seeds):
                for who, play in plays.items():
                    if (level, seed, who) not in done:
                        with contextlib.redirect_stdout(io.StringIO()):  # Minigrid prints layouts that it rejects
                            result = play(seed)
                        file.write(json.dumps({"level": level, "seed": seed, "who": who, **result}) + "\n")
                        file.flush()


def lines(out: Path) -> list[dict[str, Any]]:
    """What was played so far."""
    return [json.loads(line) for line in out.read_text().splitlines()] if out.exists() else []


def table(episodes: list[dict[str, Any]], levels: list[str]) -> None:
    """Print a row a level."""
    print("| level | solvable | explorer | bot | steps of both: explorer | bot | longest call: planner | explorer |")
    print("|---|---|---|---|---|---|---|---|")
    sums = np.zeros(2)
    for level in levels:
        mine = [line for line in episodes if line["level"] == level]
        by = {
            who: {line["seed"]: line for line in mine if line["who"] == who} for who in ("planner", "explorer", "bot")
        }
        solved = {who: {seed for seed, line in by[who].items() if line["solved"]} for who in ("explorer", "bot")}
        both = sorted(solved["explorer"] & solved["bot"])
        steps = [np.mean([by[who][seed]["steps"] for seed in both]) if both else np.nan for who in ("explorer", "bot")]
        sums += np.nan_to_num(steps)
        longest = [max(line["longest_s"] for line in by[who].values()) for who in ("planner", "explorer")]
        print(
            f"| {level} | {sum(line['found'] for line in by['planner'].values())} | {len(solved['explorer'])} |"
            f" {len(solved['bot'])} | {steps[0]:.2f} | {steps[1]:.2f} | {longest[0]:.3f} s | {longest[1]:.3f} s |"
        )
    print(f"\nIn all {sums[0]:.0f} and {sums[1]:.0f} steps, one episode a level.")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--seeds", type=int, default=100)
    parser.add_argument("--levels", nargs="+", default=LEVELS, choices=LEVELS, metavar="LEVEL")
    parser.add_argument("--short", action="store_true", help="one level, two seeds: shows only that it runs")
    given = parser.parse_args()
    if given.short:
        given.levels, given.seeds = ["GoToObj-v0"], 2
    warnings.simplefilter("ignore")
    run(given.out, given.levels, given.seeds)
    table(lines(given.out), given.levels)
