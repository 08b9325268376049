"""Commands that train agents (extra `learn`): learn transfer, report, clone; those of teaching are in `cli.teach`."""

import time
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from minihuman.cli import teach
from minihuman.cli.choosing import choosing
from minihuman.cli.training import SightChoice, command_line, need_torch
from minihuman.cli.typed import typed
from minihuman.errors import LearnError

learn = typer.Typer(help="Train agents: the transfer study, and policies that people teach.", no_args_is_help=True)

Out = Annotated[Path, typer.Option(help="The study's folder; an unfinished study there goes on.")]


class ProtocolChoice(StrEnum):
    """The two protocols of the transfer study."""

    intended = "as-intended"
    published = "as-published"
    published_in_may = "as-published-2023-05-28"


class EngineChoice(StrEnum):
    """Where jobs run."""

    local = "local"
    ray = "ray"


def add_to(app: typer.Typer) -> None:
    """Add these commands, those of teaching among them."""
    app.add_typer(learn, name="learn")


@learn.command()
def transfer(
    out: Out,
    protocol: Annotated[ProtocolChoice, typer.Option(help="What the table meant, or what the code did.")] = (
        ProtocolChoice.intended
    ),
    runs: Annotated[int, typer.Option(help="Independent runs of the source and of every transfer.")] = 5,
    baselines: Annotated[int, typer.Option(help="Runs of the baseline, which every comparison has in it.")] = 10,
    first_run: Annotated[int, typer.Option(min=0, help="Leave the runs before this one to another machine.")] = 0,
    steps: Annotated[int, typer.Option(help="Steps of the baseline and of each transfer.")] = 200_000,
    source_steps: Annotated[
        int | None, typer.Option(help="Steps of the source; by default the protocol's own.")
    ] = None,
    seed: Annotated[int, typer.Option(help="The study's seed; every job derives its own.")] = 1,
    only: Annotated[str | None, typer.Option(help="Some transfers only, as in M,ACM.")] = None,
    quick: Annotated[bool, typer.Option(help="Far fewer steps; says so in every output.")] = False,
    workers: Annotated[int | None, typer.Option(help="Processes at a time; by default one a core.")] = None,
    engine: Annotated[EngineChoice, typer.Option(help="A local pool, or a Ray cluster.")] = EngineChoice.local,
    address: Annotated[str | None, typer.Option(help="The Ray cluster's address; without it a local one.")] = None,
    device: Annotated[str, typer.Option(help="auto takes a GPU where there is one; cpu is repeatable.")] = "auto",
    beside: Annotated[
        Path | None, typer.Option(help="CSV of improvements to set beside ours instead of the paper's.")
    ] = None,
) -> None:
    """Train source, baseline and transfers, and table what transferring weights is worth.

    Example: minihuman learn transfer --protocol as-intended --runs 3 --out results/transfer
    """
    need_torch()
    from minihuman.learn.transfer.engines import open_engine
    from minihuman.learn.transfer.plan import TRANSFERS, Study
    from minihuman.learn.transfer.plan import quick as quickly
    from minihuman.learn.transfer.published import beside_of
    from minihuman.learn.transfer.run import run_study
    from minihuman.learn.transfer.summary import Run, write_report

    study = Study(
        protocol=protocol.value,
        runs=runs,
        baselines=baselines,
        steps=steps,
        source_steps=source_steps,
        seed=seed,
        transfers=TRANSFERS if only is None else tuple(only.upper().split(",")),
    )
    study = quickly(study) if quick else study
    published = beside_of(study, beside)
    started = time.monotonic()
    results = run_study(
        study,
        out,
        lambda: open_engine(engine.value, workers=workers, address=address),
        first_run=first_run,
        device=device,
    )
    run = Run(command=command_line(), engine=engine.value, wall_s=time.monotonic() - started)
    print(write_report(study, results, out, run, beside=published))


@learn.command()
def report(
    folders: Annotated[list[Path], typer.Argument(metavar="FOLDER...", help="Folders with runs of one study.")],
    out: Annotated[Path, typer.Option(help="Where the table, curves and figure go.")],
    beside: Annotated[
        Path | None, typer.Option(help="CSV of improvements to set beside ours instead of the paper's.")
    ] = None,
) -> None:
    """Table what runs there are, at any time and from several machines.

    Example: minihuman learn report results/transfer from-the-other-machine --out table
    """
    need_torch()
    from minihuman.learn.transfer.folder import read_merged
    from minihuman.learn.transfer.published import beside_of
    from minihuman.learn.transfer.summary import Run, write_report

    study, results = read_merged(folders)
    published = beside_of(study, beside)
    out.mkdir(parents=True, exist_ok=True)
    print(write_report(study, results, out, Run(command=command_line(), engine="", wall_s=0.0), beside=published))


@learn.command()
@typed
@choosing(outcome=("goal",))
def clone(
    source: Annotated[Path, typer.Argument(metavar="STUDY", help="A study's folder of logs, or one log.")],
    world: Annotated[str, typer.Option(help="The world whose episodes to learn from.")],
    out: Annotated[Path, typer.Option(help="The policy file; its card goes beside it.")],
    sight: Annotated[
        SightChoice, typer.Option(help="The view, a grid whole, or what was seen of it.")
    ] = SightChoice.view,
    missions: Annotated[bool, typer.Option(help="The mission is part of what is seen.")] = False,
    sizes: Annotated[str, typer.Option(help="Numbers of demonstrations to try, as in 5,10,25.")] = "",
    mirrored: Annotated[bool, typer.Option(help="Learn every step left for right too.")] = False,
    episodes: Annotated[int, typer.Option(min=1, help="Held-out episodes to judge it by.")] = 200,
    finetune: Annotated[int, typer.Option(min=0, help="Steps of PPO from the clone and from nothing.")] = 0,
    finetune_runs: Annotated[int, typer.Option(min=1, help="Runs of each.")] = 1,
    success: Annotated[float, typer.Option(help="The success rate that PPO is timed to.")] = 0.9,
    seed: Annotated[int, typer.Option(help="Split, training and held-out episodes derive from it.")] = 1,
    *,
    selection: Any,
) -> None:
    """Train a policy to do what people did in one world, and say how well it does.

    Example: minihuman learn clone sessions/my-study --world minihuman/MiniGrid-FourRooms-v0 --out clone.pt
    """
    need_torch()
    from minihuman.learn.clone.clone import Cloning
    from minihuman.learn.clone.study import CloneStudy, clone_study

    study = CloneStudy(
        world=world,
        sight=sight.value,
        missions=missions,
        sizes=_numbers(sizes),
        evaluation_episodes=episodes,
        finetune_steps=finetune,
        finetune_runs=finetune_runs,
        success=success,
        selection=selection,
        cloning=Cloning(mirrored=mirrored, seed=seed),
    )
    print(clone_study(source, out, study, command=command_line()), end="")


def _numbers(text: str) -> tuple[int, ...]:
    try:
        return tuple(int(part) for part in text.split(",") if part)
    except ValueError:
        raise LearnError(f"--sizes is {text!r}; it is whole numbers with commas, as in 5,10,25") from None


teach.add_to(learn)  # behind the others in the help
