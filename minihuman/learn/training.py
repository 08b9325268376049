"""A training run by PPO from beginning to end: worlds, network, clone, checkpoints, policy file, curve, evaluation.

On the CPU of one machine, a run that is killed and resumed ends with exactly the same weights as one that is not.
"""

import csv
import io
import math
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import msgspec
import torch
from gymnasium import spaces

from minihuman.dataset.selection import Selection
from minihuman.errors import LearnError
from minihuman.learn.batch_ppo import BatchPpo, CurvePoint
from minihuman.learn.behaviour_cloning import CloningSettings, Evaluation, clone_policy, split_by_participant
from minihuman.learn.curriculum import Curriculum, make_curriculum
from minihuman.learn.demonstrations import read_demonstrations
from minihuman.learn.evaluation import evaluate_in_batch
from minihuman.learn.policy.action_distributions import is_vector_space
from minihuman.learn.policy.file import PolicyCard, read_checkpoint, save_atomically, save_policy
from minihuman.learn.policy.network import EncoderName, Policy, build_policy
from minihuman.learn.policy.observation import ObservationEncoder, get_image_shape
from minihuman.learn.training_settings import TrainingJob, TrainingSettings
from minihuman.learn.training_worlds import BatchEncoder, TrainingWorlds, make_worlds
from minihuman.storage.durable_files import write_atomically
from minihuman.worlds.adapters.world import World
from minihuman.worlds.team import TeamWorld

LARGEST_VIEW = 20  # the most cells on a side of a grid's view; larger images are taken for pictures
CHECKPOINT_SUFFIX = ".checkpoint"
_MAY_CHANGE = ("checkpoint_every", "evaluation")  # settings that do not change the weights
DEFAULT_SELECTION = Selection(outcome=("goal",))
_VALIDATION_SHARE = 0.2  # of the participants whose episodes are cloned


@dataclass(frozen=True, slots=True)
class TrainingReport:
    """The learning curve and the evaluations of a training run."""

    points: list[CurvePoint]
    evaluations: list[Evaluation]  # on fresh levels of each world; empty if the policy was not evaluated
    clone: Evaluation | None = None  # of the clone that the run began with, in the first world


@dataclass(frozen=True, slots=True)
class _SharedInterface:
    """What all worlds of a job have in common for a policy: observation space, actions and encoders."""

    space: spaces.Dict
    action_names: tuple[str, ...]
    eyesight: ObservationEncoder
    eyes: EncoderName
    encoder: BatchEncoder
    is_continuous: bool

    def build_policy(self, settings: TrainingSettings) -> Policy:
        """Build a policy with fresh weights for the worlds, on the CPU."""
        return build_policy(
            self.space,
            len(self.action_names),
            self.eyes,
            memory=settings.memory,
            hidden=settings.hidden,
            initial_std=settings.initial_std if self.is_continuous else None,
        )


class TrainingStoppedError(Exception):
    """Raised by a `follow` function to end a training early; the policy is then written and evaluated as usual."""


def train(
    job: TrainingJob,
    out: Path,
    *,
    resume: bool = False,
    selection: Selection = DEFAULT_SELECTION,
    follow: Callable[[CurvePoint, Curriculum], None] = lambda point, curriculum: None,
) -> TrainingReport:
    """Train a policy, evaluate it, and write the policy and, next to it, its learning curve as CSV.

    Args:
        job: the worlds and settings.
        out: the policy file to write.
        resume: whether to continue from the checkpoint beside ``out``, if there is one.
        selection: the rule for which episodes of people are cloned, if the policy begins with a clone.
        follow: a function that is called after each update; `TrainingStoppedError` from it ends the training early.

    Raises:
        LearnError: if PPO cannot learn in the worlds, a file exists already, or the checkpoint is of another job.
    """
    checkpoint = out.with_name(out.name + CHECKPOINT_SUFFIX)
    _require_no_overwriting(out, checkpoint, resume=resume)
    _prepare_torch(job.settings)
    worlds = _make_worlds(job)
    interface = _describe_worlds(job)
    saved = _read_job_checkpoint(job, checkpoint) if resume and checkpoint.exists() else None
    policy, clone = _make_policies(job, interface, saved, selection)
    curriculum = make_curriculum(len(job.worlds), job.settings, job.settings.seed)
    run = BatchPpo(policy, worlds, curriculum, interface.encoder, job.settings, clone)
    points = _begin_or_restore(run, saved)
    with suppress(TrainingStoppedError):
        for point in _yield_updates(run, job.settings):
            points.append(point)
            if _is_checkpoint_due(run, worlds, job.settings):
                _save_progress(_make_checkpoint(job, run, points, clone), points, out)
            follow(point, curriculum)
    _write_curve(points, out.with_suffix(".csv"))
    save_policy(policy.cpu(), _make_card(job, interface, run.steps), out)
    checkpoint.unlink(missing_ok=True)
    return _evaluate(job, interface, policy, clone, points, is_team=worlds.begins_by_itself)


def _yield_updates(run: BatchPpo, settings: TrainingSettings) -> Iterator[CurvePoint]:
    """Update the policy until the run has made all its steps, and yield the curve's point after each update."""
    while run.steps < settings.steps:
        yield run.update()


def _is_checkpoint_due(run: BatchPpo, worlds: TrainingWorlds, settings: TrainingSettings) -> bool:
    """Return whether a checkpoint is due; a team world's run has none."""
    every = settings.checkpoint_every
    return every > 0 and not worlds.begins_by_itself and run.updates % every == 0


def _prepare_torch(settings: TrainingSettings) -> None:
    """Seed torch's global generator and limit torch to one thread.

    Raises:
        LearnError: if the device of the settings is not available.
    """
    torch.manual_seed(settings.seed)
    torch.set_num_threads(1)  # small networks: more threads only wait for each other
    device = settings.device
    if device != "cpu" and not (device == "cuda" and torch.cuda.is_available()):
        raise LearnError(f"device {device!r} is not here; use cpu, or cuda where PyTorch finds a GPU")


def _require_no_overwriting(out: Path, checkpoint: Path, *, resume: bool) -> None:
    """Check that no file would be overwritten, unless the run resumes from the checkpoint.

    Raises:
        LearnError: if the policy file or the curve exists, or a checkpoint that the run does not resume from.
    """
    if resume and checkpoint.exists():
        return
    if checkpoint.exists():
        raise LearnError(f"{checkpoint} is a run that was interrupted; resume it with --resume, or delete the file")
    for path in (out, out.with_suffix(".csv")):
        if path.exists():
            raise LearnError(f"{path} already exists; choose another file with --out")


def _make_worlds(job: TrainingJob) -> TrainingWorlds:
    """Make the worlds of a job.

    Raises:
        LearnError: if the worlds cannot be trained in together, or a setting does not apply to a team world.
    """
    settings = job.settings
    worlds = make_worlds(job.worlds, settings.worlds, settings.steps / 2)
    if worlds.begins_by_itself and (settings.curriculum != "uniform" or settings.levels or settings.from_people):
        raise LearnError(
            "a team world draws its own levels and has no clone to begin with; omit curriculum, levels and from_people"
        )
    return worlds


def _describe_worlds(job: TrainingJob) -> _SharedInterface:
    """Describe the first world's observations and actions; `make_worlds` has checked that all worlds share them.

    Raises:
        LearnError: if PPO cannot learn the actions, or they are continuous and people are to be cloned.
    """
    settings = job.settings
    worlds = [World(choice.id, choice.options, trusted=True) for choice in job.worlds]
    first: Any = worlds[0].unwrapped
    image_shape = get_image_shape(ObservationEncoder(settings.missions).space(first))
    channels, height, _ = image_shape
    is_grid = channels == 3 and 1 < height <= LARGEST_VIEW
    # The codes of team worlds, and of kinds that a world defines itself, would exceed a byte if they were spread.
    has_own_kinds = any(getattr(world.unwrapped, "kinds", ()) for world in worlds)
    is_wide = has_own_kinds or isinstance(getattr(first, "team", None), TeamWorld)
    eyesight = ObservationEncoder(settings.missions, scaling="spread" if is_grid and not is_wide else "raw")
    action_space = worlds[0].action_space
    is_continuous = is_vector_space(action_space)
    _require_learnable_actions(job, action_space, is_team=hasattr(first, "team"))
    action_names = worlds[0].action_names
    if is_continuous:
        action_names = tuple(f"component_{n}" for n in range(spaces.flatdim(action_space)))
    return _SharedInterface(
        space=eyesight.space(first),
        action_names=action_names,
        is_continuous=is_continuous,
        eyesight=eyesight,
        eyes=choose_encoder(image_shape, settings, is_wide=is_wide),
        encoder=BatchEncoder(settings.missions, is_grid and not is_wide, settings.device),
    )


def _require_learnable_actions(job: TrainingJob, action_space: spaces.Space[Any], *, is_team: bool) -> None:
    """Check that PPO can learn the actions of a job's worlds.

    Args:
        job: the worlds and settings.
        action_space: the action space of the first world.
        is_team: whether it is a team world.

    Raises:
        LearnError: if the actions are neither numbered nor vectors, or are vectors and people are to be cloned.
    """
    is_continuous = is_vector_space(action_space)
    if not is_continuous and not isinstance(action_space, spaces.Discrete) and not is_team:
        raise LearnError(
            f"{job.worlds[0].id} has the action space {action_space}; PPO learns numbered actions (Discrete) or one "
            "vector (Box): give a first-person world with continuous control its moves alone, as in "
            'actions = ["move_forward"]'
        )
    if is_continuous and job.settings.from_people:
        raise LearnError(
            f"{job.worlds[0].id} has continuous actions, and people's are cloned as numbered actions only; omit "
            "from_people"
        )


def choose_encoder(image_shape: tuple[int, int, int], settings: TrainingSettings, *, is_wide: bool) -> EncoderName:
    """Return the name of the encoder for images of a shape (channels, height, width).

    Args:
        image_shape: the shape of the images.
        settings: the settings, which name the kind of network.
        is_wide: whether a grid has codes that would exceed a byte if they were spread.
    """
    channels, height, _ = image_shape
    if height == 1:  # a vector, which is encoded as an image of one pixel
        return "flat"
    if height > LARGEST_VIEW:
        return "flat" if settings.network == "mlp" else "atari"
    if channels != 3:
        return "flat" if settings.network == "mlp" else "planes"
    if settings.network == "cnn":
        return "near cells" if is_wide else "near"
    return "cells" if is_wide else "codes"


def _make_policies(
    job: TrainingJob, interface: _SharedInterface, saved: dict[str, Any] | None, selection: Selection
) -> tuple[Policy, Policy | None]:
    """Return the policy to train and the clone of people with which it begins; the clone is None without people.

    Args:
        job: the worlds and settings.
        interface: the observations and actions of the worlds.
        saved: the checkpoint of a run that resumes, which has the clone; None for a new run.
        selection: the rule for which episodes are cloned.
    """
    settings = job.settings
    policy = interface.build_policy(settings)
    if not settings.from_people:
        return policy.to(settings.device), None
    if saved is None:
        clone = _clone_people(job, interface, selection)
    else:
        clone = interface.build_policy(settings)
        clone.load_state_dict(saved["clone"])
    clone.requires_grad_(False)
    critic = {name: part for name, part in policy.state_dict().items() if "value_net" in name}
    policy.load_state_dict(clone.state_dict() | critic)  # the fresh critic, since cloning trains only the actor
    return policy.to(settings.device), clone.to(settings.device)


def _clone_people(job: TrainingJob, interface: _SharedInterface, selection: Selection) -> Policy:
    """Return a policy that imitates a study's people in the job's first world, with all of the world's actions.

    Args:
        job: the worlds and settings; these name the study.
        interface: the observations and actions of the worlds.
        selection: the rule for which episodes are cloned.

    Raises:
        LearnError: if the study has no such episodes, or its options of the world lead to other observations.
    """
    settings = job.settings
    choice = job.worlds[0]
    demonstrations = read_demonstrations(Path(settings.from_people), choice.id, interface.eyesight, selection)
    if demonstrations.space != interface.space:
        raise LearnError(
            f"{settings.from_people} has {choice.id} with options {demonstrations.options}, which shows other images "
            f"than with {choice.options}; train with the study's options"
        )
    demonstrations = replace(demonstrations, action_names=interface.action_names)
    training, validation = split_by_participant(demonstrations, share=_VALIDATION_SHARE, seed=settings.seed)
    if settings.demonstrations:
        training = training.first(settings.demonstrations)
    clone, _ = clone_policy(
        training,
        validation,
        eyes=interface.eyes,
        settings=CloningSettings(seed=settings.seed, hidden=settings.hidden),
    )
    return clone


def _begin_or_restore(run: BatchPpo, saved: dict[str, Any] | None) -> list[CurvePoint]:
    """Begin a run, or restore it from its checkpoint ``saved``; return the learning curve so far."""
    if saved is None:
        run.begin()
        return []
    run.restore(saved["run"])
    return [CurvePoint(*point) for point in saved["points"]]


def _make_checkpoint(job: TrainingJob, run: BatchPpo, points: list[CurvePoint], clone: Policy | None) -> dict[str, Any]:
    """Return the content of a checkpoint: the job, the run's state, the curve so far and the clone's weights."""
    return {
        "job": msgspec.to_builtins(job),
        "run": run.save(),
        "points": [tuple(asdict(point).values()) for point in points],
        "clone": {} if clone is None else clone.state_dict(),
    }


def _save_progress(contents: dict[str, Any], points: list[CurvePoint], out: Path) -> None:
    """Write a checkpoint, and the curve so far as CSV.

    Args:
        contents: the content of the checkpoint.
        points: the points of the curve.
        out: the policy file; the two files are written next to it.
    """
    save_atomically(contents, out.with_name(out.name + CHECKPOINT_SUFFIX))
    _write_curve(points, out.with_suffix(".csv"))


def _read_job_checkpoint(job: TrainingJob, checkpoint: Path) -> dict[str, Any]:
    """Return the content of a job's checkpoint.

    Raises:
        LearnError: if the file cannot be read, or is of a job with other worlds or settings.
    """
    saved = read_checkpoint(checkpoint)
    this_job = msgspec.to_builtins(job)
    saved_job = saved.get("job", {})
    if saved_job.get("worlds") != this_job["worlds"]:
        raise LearnError(f"{checkpoint} is of a run in other worlds, {saved_job.get('worlds')}; choose another --out")
    for name, setting in this_job["settings"].items():
        if name not in _MAY_CHANGE and saved_job["settings"].get(name) != setting:
            raise LearnError(
                f"{checkpoint} is of a run whose {name} is {saved_job['settings'].get(name)!r}, not {setting!r}; "
                "resume with the same settings, or choose another --out"
            )
    return saved


def _write_curve(points: list[CurvePoint], path: Path) -> None:
    """Write a learning curve with at least one point as CSV, with a row for each point."""
    rows = io.StringIO()
    writer = csv.DictWriter(rows, list(asdict(points[0])), lineterminator="\n")
    writer.writeheader()
    writer.writerows(map(asdict, points))
    write_atomically(rows.getvalue(), path)


def _make_card(job: TrainingJob, interface: _SharedInterface, steps: int) -> PolicyCard:
    """Return the card of a policy that was trained for a number of steps."""
    first, *others = job.worlds
    return PolicyCard(
        world=first.id,
        world_options=first.options,
        action_names=interface.action_names,
        image_shape=get_image_shape(interface.space),
        eyesight=interface.eyesight,
        eyes=interface.eyes,
        trained_by="cloning, then batch ppo" if job.settings.from_people else "batch ppo",
        steps=steps,
        seed=job.settings.seed,
        notes={"settings": msgspec.to_builtins(job.settings), "worlds": msgspec.to_builtins(job.worlds)},
        other_worlds=tuple(dict.fromkeys(choice.id for choice in others if choice.id != first.id)),
        memory=job.settings.memory,
        hidden=job.settings.hidden,
        is_continuous=interface.is_continuous,
    )


def _evaluate(
    job: TrainingJob,
    interface: _SharedInterface,
    policy: Policy,
    clone: Policy | None,
    points: list[CurvePoint],
    *,
    is_team: bool,
) -> TrainingReport:
    """Return the report of a run, with the evaluations of the policy and its clone on fresh levels.

    The report has no evaluations for a team world, or if the settings ask for none.
    """
    episodes = job.settings.evaluation
    if not episodes or is_team:
        return TrainingReport(points, [])
    policy.set_training_mode(False)
    encoder = replace(interface.encoder, device="cpu")
    seed = job.settings.seed
    evaluations = evaluate_in_batch(policy, job.worlds, encoder, episodes=episodes, seed=seed)
    if clone is None:
        return TrainingReport(points, evaluations)
    (clone_evaluation,) = evaluate_in_batch(clone.cpu(), job.worlds[:1], encoder, episodes=episodes, seed=seed)
    return TrainingReport(points, evaluations, clone_evaluation)


def count_steps(settings: TrainingSettings) -> int:
    """Return the number of steps that a run makes: the settings' number, rounded up to whole rollouts of all worlds."""
    steps_per_rollout = settings.worlds * settings.rollout
    return math.ceil(settings.steps / steps_per_rollout) * steps_per_rollout
