"""Commands of teaching (extra `learn`): learn teach, and by simulated people takeovers, ratings, comparisons."""

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Any, TypeVar

import typer

from minihuman.cli.choosing import choosing
from minihuman.cli.training import SightChoice, command_line, need_torch
from minihuman.cli.typed import add
from minihuman.errors import LearnError

Name = TypeVar("Name", bound=str)


def add_to(learn: typer.Typer) -> None:
    """Add these commands to those of learning."""
    add(learn, teach, takeovers, ratings, comparisons)


@choosing()
def teach(
    source: Annotated[Path, typer.Argument(metavar="STUDY", help="A study's folder of logs, or one log.")],
    world: Annotated[str, typer.Option(help="The world in which somebody taught.")],
    out: Annotated[Path, typer.Option(help="The policy file; it says what it was made from.")],
    learner: Annotated[str, typer.Option(help="hg-dagger, tamer and others, settings behind a colon.")] = "hg-dagger",
    start: Annotated[Path | None, typer.Option(help="The policy to go on from, for learners that do.")] = None,
    sight: Annotated[SightChoice, typer.Option(help="What the policy sees.")] = SightChoice.view,
    seed: Annotated[int, typer.Option(help="Of all chance in learning.")] = 1,
    *,
    selection: Any,
) -> None:
    """Make a policy of what people showed, took over and rated in one world.

    Example: minihuman learn teach sessions/my-study --world minihuman/MiniGrid-FourRooms-v0 --out taught.pt
    """
    need_torch()
    from minihuman.learn.agent.observe import Eyesight
    from minihuman.learn.teach.from_logs import of_study
    from minihuman.learn.teach.made import make_policy

    if out.exists():
        raise LearnError(f"{out} is there already; choose another --out")
    taught = of_study(source, world, eyesight=Eyesight(False, sight=sight.value), selection=selection)
    made = make_policy(taught, learner, out, seed=seed, start=start)
    print(f"{out}: {learner} of {taught.labelled_steps} steps by people, {taught.steps} in all; {made.sha256[:16]}")


Results = Annotated[Path, typer.Option(help="Where numbers and table go; an unfinished run there goes on.")]
Seeds = Annotated[int, typer.Option(min=1, help="Simulated people a world.")]
Judged = Annotated[int, typer.Option(min=1, help="Held-out episodes to judge a policy by.")]
Workers = Annotated[int, typer.Option(min=1, help="Processes at a time.")]


def takeovers(
    out: Results,
    worlds: Annotated[str, typer.Option(help="Trials, as in DoorKey-8x8,FourRooms.")] = (
        "DoorKey-8x8,FourRooms,FourRooms-remembered"
    ),
    seeds: Seeds = 5,
    episodes: Annotated[
        int | None, typer.Option(min=1, help="Held-out episodes to judge a policy by; each trial's own if not given.")
    ] = None,
    workers: Workers = 2,
) -> None:
    """Find out by simulation what a person's takeovers and corrections are worth beside demonstrations.

    Example: minihuman learn takeovers --out results/takeovers
    """
    need_torch()
    from minihuman.learn.teach.takeover_report import run_takeovers
    from minihuman.learn.teach.takeovers import TRIALS

    names = _some_of(worlds, TRIALS, "--worlds")
    print(run_takeovers(out, names, seeds, workers=workers, command=command_line(), episodes=episodes), end="")


def ratings(
    out: Results,
    worlds: Annotated[str, typer.Option(help="Trials, as in Empty-8x8.")] = "Empty-8x8,FourRooms-easy,FourRooms-gap",
    seeds: Seeds = 5,
    episodes: Judged = 100,
    workers: Workers = 2,
) -> None:
    """Find out by simulation what TAMER and Deep COACH make of a quarter of an hour of a person's ratings.

    Example: minihuman learn ratings --out results/ratings
    """
    need_torch()
    from minihuman.learn.teach.ratings import RATED
    from minihuman.learn.teach.said_report import run_ratings

    names = _some_of(worlds, RATED, "--worlds")
    print(run_ratings(out, names, seeds, workers=workers, command=command_line(), episodes=episodes), end="")


def comparisons(
    out: Results,
    worlds: Annotated[str, typer.Option(help="Trials, as in Empty-6x6,Empty-8x8.")] = "Empty-6x6,Empty-8x8",
    pairs: Annotated[str, typer.Option(help="How pairs are chosen, as in random,disputed.")] = "random",
    seeds: Seeds = 5,
    episodes: Judged = 200,
    workers: Workers = 2,
) -> None:
    """Find out by simulation what a policy makes of 200 comparisons, beside the true reward.

    Example: minihuman learn comparisons --out results/comparisons
    """
    need_torch()
    from minihuman.learn.teach.compared import COMPARED
    from minihuman.learn.teach.said_report import PAIRINGS, run_comparisons

    names, chosen = _some_of(worlds, COMPARED, "--worlds"), _some_of(pairs, PAIRINGS, "--pairs")
    print(
        run_comparisons(out, names, chosen, seeds, workers=workers, command=command_line(), episodes=episodes), end=""
    )


def _some_of(text: str, known: Iterable[Name], option: str) -> list[Name]:
    found = {str(each): each for each in known}
    names = text.split(",")
    if odd := [name for name in names if name not in found]:
        raise LearnError(f"{option} has {odd[0]!r}; it is some of {', '.join(found)}")
    return [found[name] for name in names]
