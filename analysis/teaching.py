"""What teaching is worth: simulated trials of takeovers, ratings and comparisons, and all of them by the minute.

    python analysis/teaching.py takeovers|ratings|comparisons|minutes OUT [--worlds Empty-8x8] [--seeds 5] [--workers 2]

Writes rows, table and, for takeovers, the figure into OUT (extra `learn`); an interrupted run resumes.
"""

import argparse
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TypeVar

from minihuman.errors import LearnError, MinihumanError
from teaching_study.feedback import COMPARED, PAIRINGS, RATED, run_comparisons, run_ratings
from teaching_study.minutes import MINUTES_TRIALS, run_minutes
from teaching_study.takeovers import TAKEOVER_TRIALS, run_takeovers

Name = TypeVar("Name", bound=str)


def takeovers(given: argparse.Namespace, command: str) -> str:
    """What takeovers add to demonstrations."""
    names = select(given.worlds, TAKEOVER_TRIALS, "--worlds")
    return run_takeovers(given.out, names, given.seeds, workers=given.workers, command=command, episodes=given.episodes)


def ratings(given: argparse.Namespace, command: str) -> str:
    """What TAMER and Deep COACH learn from ratings."""
    names = select(given.worlds, RATED, "--worlds")
    return run_ratings(given.out, names, given.seeds, workers=given.workers, command=command, episodes=given.episodes)


def comparisons(given: argparse.Namespace, command: str) -> str:
    """What a policy learns from 200 comparisons."""
    names, pairings = select(given.worlds, COMPARED, "--worlds"), select(given.pairs, PAIRINGS, "--pairs")
    return run_comparisons(
        given.out, names, pairings, given.seeds, workers=given.workers, command=command, episodes=given.episodes
    )


def minutes(given: argparse.Namespace, command: str) -> str:
    """What each way to teach comes to after the same minutes of a person's time."""
    names = select(given.worlds, MINUTES_TRIALS, "--worlds")
    return run_minutes(given.out, names, given.seeds, workers=given.workers, command=command, episodes=given.episodes)


def select(text: str, known: Iterable[Name], option: str) -> list[Name]:
    """The known names that a list with commas holds.

    Raises:
        LearnError: if one is unknown.
    """
    by_name = {str(each): each for each in known}
    names = text.split(",")
    if unknown := [name for name in names if name not in by_name]:
        raise LearnError(f"{option} has {unknown[0]!r}; it is some of {', '.join(by_name)}")
    return [by_name[name] for name in names]


def parse(arguments: list[str]) -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True)
    for command, worlds, episodes in (
        (takeovers, "DoorKey-8x8,FourRooms,FourRooms-remembered", None),
        (ratings, "Empty-8x8,FourRooms-easy,FourRooms-gap", 100),
        (comparisons, "Empty-6x6,Empty-8x8", 200),
        (minutes, "FourRooms-easy,Empty-8x8", 200),
    ):
        each = commands.add_parser(command.__name__, help=command.__doc__)
        each.set_defaults(command=command)
        each.add_argument("out", type=Path, help="the folder of the results; an unfinished run there resumes")
        each.add_argument("--worlds", default=worlds, help=f"trials, by default {worlds}")
        each.add_argument("--seeds", type=int, default=5, help="simulated participants per world")
        each.add_argument("--episodes", type=int, default=episodes, help="held-out episodes per evaluation")
        each.add_argument("--workers", type=int, default=2, help="processes")
        if command is comparisons:
            each.add_argument("--pairs", default="random", help="how to choose pairs, as in random,disputed")
    return parser.parse_args(arguments)


if __name__ == "__main__":  # processes of the pool import this module
    given = parse(sys.argv[1:])
    try:
        print(given.command(given, " ".join(["python analysis/teaching.py", *sys.argv[1:]])), end="")
    except MinihumanError as error:
        sys.exit(f"teaching.py: {error}")
