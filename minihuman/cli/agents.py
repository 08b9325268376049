"""Commands that train agents on people's data (extra `learn`) and compare players: learn, bench."""

import sys
from pathlib import Path
from typing import Annotated, Any, Literal

from minihuman.cli.command_line import Subgroup
from minihuman.cli.options import (
    Argument,
    Option,
    StudyOrLog,
    TrustOption,
    ask_trust,
    print_account,
    selection_options,
    show_progress,
)
from minihuman.cli.training_options import (
    admit_training,
    compose_job,
    describe_progress,
    describe_training,
    training_options,
)
from minihuman.errors import ExportError, LearnError

_SIGHT_HELP = (
    "What the policy observes: what the world shows (view), the whole grid (whole), or the nearby cells seen so far "
    "(remembered)."
)


_Sight = Literal["view", "whole", "remembered"]


def format_command_line() -> str:
    """Return the program's arguments as one line that begins with ``minihuman``, to be recorded in results."""
    return " ".join(["minihuman", *sys.argv[1:]])


def require_torch() -> None:
    """Check that the packages of the extra `learn` are installed.

    Raises:
        LearnError: if PyTorch or Stable-Baselines3 is missing.
    """
    try:
        import stable_baselines3  # noqa: F401
        import torch  # noqa: F401
    except ImportError:
        raise LearnError(
            'training needs PyTorch and Stable-Baselines3; run: pip install "torch>=2.6" "stable-baselines3>=2.4"'
        ) from None


@selection_options(outcome=("goal",))
def clone(
    source: StudyOrLog,
    world: Annotated[str, Option(help="The world whose episodes the policy learns from.")],
    out: Annotated[Path, Option(help="The policy file to write; its model card is written beside it.")],
    sight: Annotated[_Sight, Option(help=_SIGHT_HELP)] = "view",
    missions: Annotated[bool, Option(help="Also let the policy observe the mission.")] = False,
    sizes: Annotated[str, Option(help="The numbers of demonstrations to try, such as 5,10,25.")] = "",
    mirrored: Annotated[bool, Option(help="Augment the data with mirrored steps.")] = False,
    episodes: Annotated[int, Option(min=1, help="The number of held-out episodes to evaluate the policy on.")] = 200,
    seed: Annotated[int, Option(min=0, help="The random seed of the data split, training and evaluation.")] = 1,
    *,
    selection: Any,
) -> None:
    """Train a policy by behavioural cloning in one world, and evaluate it.

    Example: minihuman learn clone sessions/my-study --world minihuman/MiniGrid-FourRooms-v0 --out clone.pt
    """
    require_torch()
    from minihuman.learn.behaviour_cloning import CloneStudy, CloningSettings, clone_study

    study = CloneStudy(
        world=world,
        sight=sight,
        missions=missions,
        sizes=_parse_sizes(sizes),
        evaluation_episodes=episodes,
        selection=selection,
        cloning=CloningSettings(mirrored=mirrored, seed=seed),
    )
    print(clone_study(source, out, study, command=format_command_line()), end="")


def _parse_sizes(text: str) -> tuple[int, ...]:
    try:
        return tuple(int(part) for part in text.split(",") if part)
    except ValueError:
        raise LearnError(
            f"--sizes {text!r} is not valid; give whole numbers separated by commas, as in 5,10,25"
        ) from None


@selection_options()
def teach(
    study: StudyOrLog,
    world: Annotated[str, Option(help="The world whose episodes the policy learns from.")],
    out: Annotated[Path, Option(help="The policy file to write; it records the data that it was trained on.")],
    learner: Annotated[
        str, Option(help="The learner, such as hg-dagger or tamer; settings follow a colon, as in tamer:NAME=VALUE.")
    ] = "hg-dagger",
    start: Annotated[Path | None, Option(help="The policy to start from, for learners that support it.")] = None,
    sight: Annotated[_Sight, Option(help=_SIGHT_HELP)] = "view",
    seed: Annotated[int, Option(min=0, help="The random seed of training.")] = 1,
    *,
    selection: Any,
) -> None:
    """Train a policy on demonstrations, takeovers and ratings.

    Example: minihuman learn teach sessions/my-study --world minihuman/MiniGrid-FourRooms-v0 --out taught.pt
    """
    require_torch()
    from minihuman.learn.policy.observation import ObservationEncoder
    from minihuman.learn.teaching.log_dataset import read_study_dataset
    from minihuman.learn.teaching.provenance import make_policy

    if out.exists():
        raise LearnError(f"{out} already exists; choose another file with --out")
    # False: the policy does not observe missions
    taught = read_study_dataset(study, world, eyesight=ObservationEncoder(False, sight=sight), selection=selection)
    policy = make_policy(taught, learner, out, seed=seed, start=start)
    print(f"{out}: {learner} of {taught.labelled_steps} steps by people, {taught.steps} in all; {policy.sha256[:16]}")


@selection_options(outcome=("goal",))
@training_options
def ppo(
    world: Annotated[
        list[str] | None,
        Argument("The worlds to learn, such as minihuman/MiniGrid-DoorKey-5x5-v0; none with --job.", "WORLD..."),
    ] = None,
    out: Annotated[
        Path, Option(help="The policy file to write; its learning curve is written beside it as CSV.")
    ] = Path("policy.pt"),
    job: Annotated[Path | None, Option(help="A TOML file with worlds and settings; options given here win.")] = None,
    option: Annotated[list[str] | None, Option(help="An option of all worlds, as NAME=VALUE; repeatable.")] = None,
    resume: Annotated[bool, Option("--resume", help="Continue an interrupted training from its checkpoint.")] = False,
    trust: TrustOption = False,
    *,
    settings: dict[str, Any],
    selection: Any,
) -> None:
    """Train a policy by proximal policy optimisation, with or without people's data, and write its learning curve.

    Example: minihuman learn ppo minihuman/MiniGrid-DoorKey-5x5-v0 --out door.pt
    """
    require_torch()
    from minihuman.learn.training import count_steps, train

    training = compose_job(world or [], job, option or [], settings)
    admit_training(training, (job or Path("job")).absolute().parent, ask_trust(trust or job is None))
    steps = count_steps(training.settings)
    if steps != training.settings.steps:
        print_account([f"training for {steps} steps: whole rollouts of {training.settings.worlds} worlds"])
    with show_progress(f"training for {steps} steps in {', '.join(choice.id for choice in training.worlds)}") as show:
        report = train(
            training,
            out,
            resume=resume,
            selection=selection,
            follow=lambda point, curriculum: show(describe_progress(point, steps, curriculum.describe())),
        )
    print(describe_training(out, training, report))


@selection_options()
def compare(
    policy: Annotated[Path, Argument("The policy file.", "POLICY")],
    study: StudyOrLog,
    world: Annotated[str, Option(help="The world; by default the first that the policy was trained in.")] = "",
    seed: Annotated[int, Option(min=0, help="The random seed of the policy's actions.")] = 1,
    *,
    selection: Any,
) -> None:
    """Have a policy play the levels that a study's participants played, and print both their scores.

    Example: minihuman learn compare door.pt sessions/my-study
    """
    require_torch()
    from minihuman.learn.evaluation import compare_with_people

    comparison = compare_with_people(policy, study, selection, world=world, seed=seed)
    print_account(comparison.account)
    print(comparison)


learn = Subgroup("learn", help="Train agents, on people's data or without.", commands=(clone, ppo, teach, compare))


def new(
    kind: Annotated[Literal["grid", "first-person", "kitchen"], Option(help="The kind of worlds to use.")] = "grid",
    seed: Annotated[int, Option(min=0, help="The random seed of the levels; a new seed gives new levels.")] = 1,
    levels: Annotated[int, Option(min=1, max=1000, help="The number of levels of each family of worlds.")] = 5,
    out: Annotated[Path | None, Option(help="The protocol file to write; by default, baseline-KIND-SEED.toml.")] = None,
) -> None:
    """Write a protocol with a new set of levels.

    Example: minihuman bench new --kind grid --seed 20261124
    """
    from minihuman.planning.benchmark import compose_baseline

    path = out or Path(f"baseline-{kind}-{seed}.toml")
    if path.exists():
        raise ExportError(f"{path} already exists; choose another file with --out")
    path.write_text(compose_baseline(kind, seed, levels=levels), encoding="utf-8", newline="\n")
    print(path)


def run(
    protocols: Annotated[list[Path], Argument("The sets' protocol files.", "PROTOCOL...")],
    data: Annotated[Path, Option(help="The folder in which each player gets a data folder.")] = Path("bench"),
    players: Annotated[
        str, Option(help="The players and how many runs each plays, as NAME=RUNS; a policy is policy:FILE=RUNS.")
    ] = "human-like=12,exploring=3,optimal=3,random=3",
    out: Annotated[Path, Option(help="The folder to write the table and the figure to.")] = Path("scores"),
    seed: Annotated[int, Option(min=0, help="The random seed of the players and of the bootstrap.")] = 1,
) -> None:
    """Have players play sets of levels, and score them.

    Runs that were played earlier are kept. People and models that played the same protocols with the same --data folder
    are scored too.

    Example: minihuman bench run protocols/baseline-grid.toml --out scores
    """
    from minihuman.planning.benchmark import parse_players, run_baseline
    from minihuman.reporting.scorecard import format_scorecard, write_scorecard

    with show_progress("") as progress:
        card = run_baseline(protocols, data, parse_players(players), seed=seed, on_progress=progress)
        paths = write_scorecard(card, out)
    print(format_scorecard(card))
    for path in paths:
        print(path)


bench = Subgroup("bench", help="Make benchmark sets of levels and score players on them.", commands=(new, run))
