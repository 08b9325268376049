"""Commands that train agents on what people did (extra `learn`): learn clone, learn teach."""

import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

from minihuman.cli.command_line import Subgroup
from minihuman.cli.options import Option, StudyOrLog, selection_options
from minihuman.errors import LearnError


class SightChoice(StrEnum):
    """What a clone sees."""

    view = "view"
    whole = "whole"
    remembered = "remembered"


def command_line() -> str:
    """The command that is running, as results name it."""
    return " ".join(["minihuman", *sys.argv[1:]])


def need_torch() -> None:
    """Make sure that the extra `learn` is installed.

    Raises:
        LearnError: if it is not.
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
    world: Annotated[str, Option(help="The world whose episodes are learned from.")],
    out: Annotated[Path, Option(help="The policy file to write; its model card is written beside it.")],
    sight: Annotated[SightChoice, Option(help="What the policy observes.")] = SightChoice.view,
    missions: Annotated[bool, Option(help="Also give the policy the mission.")] = False,
    sizes: Annotated[str, Option(help="The numbers of demonstrations to try, such as 5,10,25.")] = "",
    mirrored: Annotated[bool, Option(help="Augment the data with mirrored steps.")] = False,
    episodes: Annotated[int, Option(min=1, help="The number of held-out episodes for evaluation.")] = 200,
    finetune: Annotated[
        int, Option(min=0, help="Fine-tune the clone by this many steps of PPO, and train as long from scratch.")
    ] = 0,
    finetune_runs: Annotated[int, Option(min=1, help="The number of PPO runs, with and without cloning.")] = 1,
    success: Annotated[float, Option(help="Measure how many steps PPO needs to reach this success rate.")] = 0.9,
    seed: Annotated[int, Option(min=0, help="The random seed of the data split, training and evaluation.")] = 1,
    *,
    selection: Any,
) -> None:
    """Train a policy by behavioural cloning in one world, and evaluate it.

    Example: minihuman learn clone sessions/my-study --world minihuman/MiniGrid-FourRooms-v0 --out clone.pt
    """
    need_torch()
    from minihuman.learn.behaviour_cloning import CloneStudy, CloningSettings, clone_study

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
        cloning=CloningSettings(mirrored=mirrored, seed=seed),
    )
    print(clone_study(source, out, study, command=command_line()), end="")


def _numbers(text: str) -> tuple[int, ...]:
    try:
        return tuple(int(part) for part in text.split(",") if part)
    except ValueError:
        raise LearnError(f"--sizes is {text!r}; it is whole numbers with commas, as in 5,10,25") from None


@selection_options()
def teach(
    study: StudyOrLog,
    world: Annotated[str, Option(help="The world whose episodes are learned from.")],
    out: Annotated[Path, Option(help="The policy file to write; it names the data it was trained on.")],
    learner: Annotated[
        str, Option(help="The learner, such as hg-dagger or tamer, with settings as in tamer:NAME=VALUE.")
    ] = "hg-dagger",
    start: Annotated[Path | None, Option(help="The policy to start from, for learners that support it.")] = None,
    sight: Annotated[SightChoice, Option(help="What the policy observes.")] = SightChoice.view,
    seed: Annotated[int, Option(min=0, help="The random seed of the training.")] = 1,
    *,
    selection: Any,
) -> None:
    """Train a policy on demonstrations, takeovers and ratings.

    Example: minihuman learn teach sessions/my-study --world minihuman/MiniGrid-FourRooms-v0 --out taught.pt
    """
    need_torch()
    from minihuman.learn.policy.observation import ObservationEncoder
    from minihuman.learn.teaching.log_dataset import read_study_dataset
    from minihuman.learn.teaching.provenance import make_policy

    if out.exists():
        raise LearnError(f"{out} already exists; choose another folder with --out")
    taught = read_study_dataset(
        study, world, eyesight=ObservationEncoder(False, sight=sight.value), selection=selection
    )
    made = make_policy(taught, learner, out, seed=seed, start=start)
    print(f"{out}: {learner} of {taught.labelled_steps} steps by people, {taught.steps} in all; {made.sha256[:16]}")


learn = Subgroup("learn", help="Train agents from people's data.", commands=(clone, teach))
