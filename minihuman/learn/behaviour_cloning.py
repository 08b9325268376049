"""Behaviour cloning: train a policy to imitate people, evaluate it, and write it with its card.

Training stops when the policy no longer improves on the data of participants who are not in the training data. The
evaluation uses fixed held-out episodes.
"""

import json
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import torch
from torch.nn import functional

from minihuman.dataset.selection import Selection
from minihuman.errors import LearnError
from minihuman.learn.demonstrations import Demonstrations, read_demonstrations
from minihuman.learn.policy.file import PolicyCard, get_versions, save_policy
from minihuman.learn.policy.network import EncoderName, Policy, build_policy
from minihuman.learn.policy.observation import (
    EpisodeEncoder,
    Observation,
    ObservationEncoder,
    ViewMode,
    get_image_shape,
)
from minihuman.learn.ppo import episode_seed
from minihuman.statistics.scores import wilson_interval
from minihuman.statistics.units import find_units
from minihuman.storage.durable_files import write_atomically
from minihuman.worlds.adapters.world import World

ChooseAction = Callable[[Observation], int]  # returns the number of the action for an observation


@dataclass(frozen=True, slots=True)
class Evaluation:
    """The outcome of an evaluation: the episodes played, and how many of them terminated with a reward."""

    episodes: int
    successes: int
    mean_return: float
    mean_steps: float

    @property
    def rate(self) -> float:
        """The success rate."""
        return self.successes / self.episodes

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % Wilson interval of the success rate."""
        return wilson_interval(self.successes, self.episodes)

    def __str__(self) -> str:
        """Return the success rate with its interval."""
        low, high = self.interval
        return f"{self.rate:.2f} [{low:.2f}, {high:.2f}]"


def evaluate_policy(
    choose: ChooseAction,
    world_id: str,
    options: dict[str, Any],
    eyesight: ObservationEncoder,
    *,
    episodes: int,
    seed: int,
    most_steps: int | None = None,
) -> Evaluation:
    """Evaluate a policy on held-out episodes; in a team world, it plays every seat.

    An episode ends when the world ends it or after ``most_steps``, so at least one of the two must have a limit.

    Args:
        choose: the policy.
        world_id: a Gymnasium id.
        options: the options of the world.
        eyesight: the settings by which observations are encoded for the policy.
        episodes: the number of episodes.
        seed: the seed on which alone the seeds of the episodes depend.
        most_steps: the number of steps after which an episode ends; None for the world's own limit.
    """
    env: Any = World(world_id, options, trusted=True).env  # with its own step limit
    encoder = eyesight.episode_encoder()
    returns = []
    lengths = []
    successes = 0
    for episode in range(episodes):
        raw, _ = env.reset(seed=held_out_seed(seed, episode))
        episode_return, length, has_succeeded = _play_episode(env, raw, choose, encoder, most_steps)
        returns.append(episode_return)
        lengths.append(length)
        successes += has_succeeded
    return Evaluation(episodes, successes, float(np.mean(returns)), float(np.mean(lengths)))


def _play_episode(
    env: Any, raw: Any, choose: ChooseAction, encoder: EpisodeEncoder, most_steps: int | None
) -> tuple[float, int, bool]:
    """Play an episode from its first observation ``raw``, for at most ``most_steps`` steps; None sets no limit.

    Returns:
        The episode's return, its number of steps, and whether it terminated with a reward.
    """
    world = env.unwrapped
    team = getattr(world, "team", None)
    first_action = int(env.action_space.start)
    episode_return = 0.0
    length = 0
    while True:
        if team is not None:  # the world takes the actions of the other bodies from its joint action
            observations = [team.observation(body) for body in range(team.bodies)]
            world.joint = [choose(encoder.encode(world, observation)) for observation in observations]
        action = choose(encoder.encode(world, raw))
        raw, reward, terminated, truncated, _ = env.step(first_action + action)
        episode_return += float(reward)
        length += 1
        if terminated or truncated or length == most_steps:
            return episode_return, length, bool(terminated and reward > 0)


def held_out_seed(seed: int, episode: int) -> int:
    """Return the reset seed of an evaluation's episode, 2**31 or more; those of training and sessions are below."""
    return 2**31 + episode_seed(seed, episode)


def make_sampling_policy(policy: Policy, seed: int) -> ChooseAction:
    """Return a function that draws each action from the policy's probabilities, reproducibly for a seed."""
    random = torch.Generator().manual_seed(seed)

    def choose(observation: Observation) -> int:
        return int(torch.multinomial(policy.probabilities(observation), 1, generator=random))

    return choose


def make_random_policy(actions: int, seed: int) -> ChooseAction:
    """Return a function that draws each of a number of actions with the same chance, as a baseline for policies."""
    rng = np.random.default_rng(seed)
    return lambda _: int(rng.integers(actions))


@dataclass(frozen=True, slots=True)
class CloningSettings:
    """The settings of behaviour cloning."""

    validation_share: float = 0.2  # of the participants, at least one
    batch_size: int = 64
    learning_rate: float = 1e-3
    weight_decay: float = 1e-4
    most_epochs: int = 60
    patience: int = 8  # epochs without a better validation loss before it stops
    mirrored: bool = False  # add each step left for right; for worlds that look the same in a mirror
    seed: int = 1
    hidden: tuple[int, ...] = (64, 64)  # sizes of the actor's and the critic's layers


@dataclass(frozen=True, slots=True)
class CloningResult:
    """The result of behaviour cloning; losses are mean cross-entropies per step, in nats."""

    epochs: int  # until the best validation loss
    training_loss: float
    validation_loss: float
    agreement: float  # share of the validation steps in which the likeliest action is the one taken
    training_episodes: int
    validation_episodes: int
    training_participants: tuple[str, ...]
    validation_participants: tuple[str, ...]


def split_by_participant(
    demonstrations: Demonstrations, *, share: float, seed: int
) -> tuple[Demonstrations, Demonstrations]:
    """Split demonstrations at random by participant; return the training data and the validation data.

    No participant is in both, and participants who played together are in the same part. The validation data have a
    share (0 to 1) of the participants or teams, and at least one of them.

    Raises:
        LearnError: if only one participant or one team took part.
    """
    teams = [(episode.team, episode.participant) for episode in demonstrations.episodes if episode.team]
    unit_of = find_units(pd.DataFrame(teams, columns=["team", "participant"]))
    people = list(dict.fromkeys(unit_of.get(participant, participant) for participant in demonstrations.participants))
    if len(people) < 2:
        raise LearnError(
            f"{demonstrations.world} was played by only one participant or team, {', '.join(people)}; splitting the "
            "data needs two or more"
        )
    order = [people[index] for index in np.random.default_rng(seed).permutation(len(people))]
    held_out = order[: max(1, round(share * len(people)))]
    validation_participants = [
        participant for participant in demonstrations.participants if unit_of.get(participant, participant) in held_out
    ]
    training_participants = [
        participant for participant in demonstrations.participants if participant not in validation_participants
    ]
    return demonstrations.by(training_participants), demonstrations.by(validation_participants)


def clone_policy(
    training: Demonstrations, validation: Demonstrations, *, eyes: EncoderName, settings: CloningSettings
) -> tuple[Policy, CloningResult]:
    """Train a policy to imitate demonstrations; return it, as it was at the lowest validation loss, and the losses."""
    torch.manual_seed(settings.seed)
    steps = _stack_steps(training)
    if settings.mirrored:
        steps = _add_mirrored_steps(steps, training.action_names, eyes)
    held_out = _stack_steps(validation)
    policy = build_policy(training.space, len(training.action_names), eyes, hidden=settings.hidden)
    policy.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    optimiser = torch.optim.Adam(
        policy.parameters(), lr=settings.learning_rate, weight_decay=settings.weight_decay, fused=True
    )
    best_validation_loss = float("inf")
    best_epoch = 0
    best_training_loss = float("nan")
    best_agreement = 0.0
    best_weights = policy.state_dict()
    for epoch in range(1, settings.most_epochs + 1):
        training_loss = _train_epoch(policy, optimiser, steps, settings.batch_size)
        validation_loss, agreement = _compare_with_people(policy, held_out)
        if validation_loss < best_validation_loss:
            best_validation_loss = validation_loss
            best_epoch = epoch
            best_training_loss = training_loss
            best_agreement = agreement
            best_weights = {name: weights.clone() for name, weights in policy.state_dict().items()}
        elif epoch - best_epoch >= settings.patience:
            break
    policy.load_state_dict(best_weights)
    policy.set_training_mode(False)
    return policy, CloningResult(
        epochs=best_epoch,
        training_loss=best_training_loss,
        validation_loss=best_validation_loss,
        agreement=best_agreement,
        training_episodes=len(training.episodes),
        validation_episodes=len(validation.episodes),
        training_participants=training.participants,
        validation_participants=validation.participants,
    )


Steps = tuple[torch.Tensor, torch.Tensor | None, torch.Tensor]  # images, missions, actions; one row per step


def _compare_with_people(policy: Policy, steps: Steps) -> tuple[float, float]:
    """Return a policy's mean cross-entropy over people's steps in nats, and its agreement with them.

    The agreement is the share of steps in which the most likely action is the one that the person took.
    """
    images, missions, actions = steps
    with torch.no_grad():
        log_probs = policy.log_probabilities(_pick_rows(images, missions, slice(None)))
    loss = float(functional.nll_loss(log_probs, actions))
    return loss, float((log_probs.argmax(dim=1) == actions).float().mean())


def _train_epoch(policy: Policy, optimiser: torch.optim.Adam, steps: Steps, batch_size: int) -> float:
    """Train a policy on all steps once, in minibatches of ``batch_size`` steps; return the minibatches' mean loss."""
    images, missions, actions = steps
    losses = []
    for rows in torch.split(torch.randperm(len(actions)), batch_size):
        loss = functional.nll_loss(policy.log_probabilities(_pick_rows(images, missions, rows)), actions[rows])
        optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        optimiser.step()
        losses.append(loss.item())
    return float(np.mean(losses))


def _stack_steps(demonstrations: Demonstrations) -> Steps:
    """Return the images, the missions (None if unobserved) and the actions of all steps, one row per step."""
    observations = list(chain.from_iterable(episode.observations for episode in demonstrations.episodes))
    images = torch.as_tensor(np.stack([observation["image"] for observation in observations]))
    missions = None
    if "mission" in observations[0]:
        missions = torch.as_tensor(np.stack([observation["mission"] for observation in observations]))
    actions = torch.as_tensor(np.concatenate([episode.actions for episode in demonstrations.episodes]))
    return images, missions, actions


def _pick_rows(
    images: torch.Tensor, missions: torch.Tensor | None, rows: torch.Tensor | slice
) -> dict[str, torch.Tensor]:
    """Return the observations of the steps in some rows: images, and missions unless they are None."""
    if missions is None:
        return {"image": images[rows]}
    return {"image": images[rows], "mission": missions[rows]}


def _add_mirrored_steps(steps: Steps, action_names: tuple[str, ...], eyes: EncoderName) -> Steps:
    """Return steps followed by the same steps mirrored: images flipped, and left and right actions exchanged."""
    images, missions, actions = steps
    left_right_axis = 2  # grid codes are [step, channel, column, row]
    if eyes == "atari":
        left_right_axis = 3  # pictures are [step, channel, row, column]
    if missions is not None:
        missions = torch.cat((missions, missions))
    swapped = torch.tensor([action_names.index(_OTHER_SIDE.get(name, name)) for name in action_names])
    return torch.cat((images, images.flip(left_right_axis))), missions, torch.cat((actions, swapped[actions]))


_OTHER_SIDE = {"left": "right", "right": "left", "turn_left": "turn_right", "turn_right": "turn_left"}


_EYES: dict[ViewMode, EncoderName] = {"whole": "map", "remembered": "near"}


@dataclass(frozen=True, slots=True)
class CloneStudy:
    """The settings of a cloning study: the demonstrations to clone and the evaluation of the clones."""

    world: str
    sight: ViewMode = "view"
    missions: bool = False
    sizes: tuple[int, ...] = ()  # numbers of demonstrations to clone from, beside all of them
    evaluation_episodes: int = 200
    selection: Selection = field(default_factory=lambda: Selection(outcome=("goal",)))
    cloning: CloningSettings = field(default_factory=CloningSettings)


@dataclass(frozen=True, slots=True)
class CloneEvaluation:
    """The training and the evaluation of a clone of a given number of demonstrations."""

    demonstrations: int
    cloned: CloningResult
    played: Evaluation


def clone_study(source: Path, out: Path, study: CloneStudy, *, command: str) -> str:
    """Clone a study's demonstrations, evaluate the clones, write the results, and return the card in Markdown.

    The files are the policy cloned from all demonstrations (``out``), its card (``out`` + .md) and the numbers (.json).

    Raises:
        LearnError: if a file exists already, a number of demonstrations is below 1, or there is nothing to clone. Then
            nothing is written.
    """
    torch.set_num_threads(1)  # small networks are faster on one thread, and their sums have a fixed order
    files = {kind: out.with_name(out.name + kind) for kind in ("", ".md", ".json")}
    _require_new_files(files.values())
    for size in study.sizes:
        if size < 1:
            raise LearnError(f"{size} is not a valid number of demonstrations; use 1 or more")
    demonstrations = read_demonstrations(
        source, study.world, ObservationEncoder(study.missions, sight=study.sight), study.selection
    )
    if any(episode.team for episode in demonstrations.episodes) and study.cloning.mirrored:
        raise LearnError(f"{study.world} is a world of teams; remove --mirrored, which needs a world of one body")
    eyes = _choose_encoder(study.sight, get_image_shape(demonstrations.space))
    training, validation = split_by_participant(
        demonstrations, share=study.cloning.validation_share, seed=study.cloning.seed
    )
    rows = []
    policy = None
    available = len(training.episodes)
    for size in sorted({min(size, available) for size in (*study.sizes, available)}):
        policy, cloned = clone_policy(training.first(size), validation, eyes=eyes, settings=study.cloning)
        played = _evaluate_player(make_sampling_policy(policy, study.cloning.seed), demonstrations, study)
        rows.append(CloneEvaluation(size, cloned, played))
    assert policy is not None
    random_policy = make_random_policy(len(demonstrations.action_names), study.cloning.seed)
    chance = _evaluate_player(random_policy, demonstrations, study)
    text = build_card_text(study, demonstrations, rows, chance, command)
    out.parent.mkdir(parents=True, exist_ok=True)
    save_policy(policy, _build_card(demonstrations, eyes, study), out)
    write_atomically(json.dumps(_collect_numbers(study, rows, chance, command), indent=1), files[".json"])
    write_atomically(text, files[".md"])
    return text


def _require_new_files(paths: Iterable[Path]) -> None:
    """Raise LearnError if one of the files exists already."""
    for path in paths:
        if path.exists():
            raise LearnError(f"{path} already exists; choose another file with --out")


def _choose_encoder(sight: ViewMode, image_shape: tuple[int, int, int]) -> EncoderName:
    """Return the name of the encoder that suits a view mode and images of a shape (channels, height, width)."""
    channels, height, _ = image_shape
    if sight in _EYES:
        return _EYES[sight]
    if height >= 36:  # which the Atari network needs
        return "atari"
    if channels == 3:
        return "grid"
    return "planes"


def build_card_text(
    study: CloneStudy,
    demonstrations: Demonstrations,
    rows: list[CloneEvaluation],
    chance: Evaluation,
    command: str,
) -> str:
    """Return a policy's card in Markdown: its training data, its performance, and how the performance was measured."""
    players = sorted({episode.player for episode in demonstrations.episodes})
    last = rows[-1].cloned
    sight = _SIGHTS[study.sight]
    if study.missions:
        sight += " and the mission"
    success_note = f"Success over {study.evaluation_episodes} held-out episodes, each action drawn from the policy"
    if any(episode.team for episode in demonstrations.episodes):
        success_note += " in every seat"
    success_note += ", with its 95 %"
    lines = [
        f"# A policy cloned from {', '.join(players)} demonstrations of {study.world}",
        "",
        f"Options: {demonstrations.options or 'none'}. It sees {sight}.",
        f"Actions: {', '.join(demonstrations.action_names)}.",
        *(f"- {line}" for line in demonstrations.account.lines()),
        "",
        f"Training participants: {', '.join(last.training_participants)}.",
        f"Validation participants: {', '.join(last.validation_participants)}.",
        "",
        success_note,
        "Wilson interval:",
        "",
        "| demonstrations | success | mean return | epochs | validation loss | agreement |",
        "| --- | --- | --- | --- | --- | --- |",
        *[
            f"| {row.demonstrations} | {row.played} | {row.played.mean_return:.3f} | {row.cloned.epochs} "
            f"| {row.cloned.validation_loss:.3f} | {row.cloned.agreement:.2f} |"
            for row in rows
        ],
        f"| chance | {chance} | {chance.mean_return:.3f} | - | - | - |",
        "",
    ]
    lines += [f"Command: `{command}`", "", f"Versions: {_join_versions()}"]
    return "\n".join(lines) + "\n"


def _join_versions() -> str:
    """Return the packages on which a policy's results depend with their versions, separated by commas."""
    return ", ".join(f"{package} {version}" for package, version in get_versions().items())


def _collect_numbers(
    study: CloneStudy, rows: list[CloneEvaluation], chance: Evaluation, command: str
) -> dict[str, Any]:
    """Return the results of a cloning study as values for JSON; ``chance`` is the evaluation of random actions."""
    return {
        "study": asdict(study),
        "rows": [asdict(row) | {"success": row.played.rate, "interval": row.played.interval} for row in rows],
        "chance": asdict(chance) | {"success": chance.rate, "interval": chance.interval},
        "command": command,
        "versions": get_versions(),
    }


def _evaluate_player(choose: ChooseAction, demonstrations: Demonstrations, study: CloneStudy) -> Evaluation:
    """Evaluate a function that chooses actions on the held-out episodes of a cloning study."""
    return evaluate_policy(
        choose,
        study.world,
        demonstrations.options,
        demonstrations.eyesight,
        episodes=study.evaluation_episodes,
        seed=study.cloning.seed,
        most_steps=demonstrations.most_steps,
    )


def _build_card(demonstrations: Demonstrations, eyes: EncoderName, study: CloneStudy) -> PolicyCard:
    """Return the card of a policy that was cloned from demonstrations."""
    return PolicyCard(
        world=study.world,
        world_options=demonstrations.options,
        action_names=demonstrations.action_names,
        image_shape=get_image_shape(demonstrations.space),
        eyesight=demonstrations.eyesight,
        eyes=eyes,
        trained_by="cloning",
        steps=0,
        seed=study.cloning.seed,
        notes={"demonstrations": len(demonstrations.episodes)},
        hidden=study.cloning.hidden,
    )


_SIGHTS = {
    "view": "the world's own observation",
    "whole": "the whole grid, turned its way up",
    "remembered": "the cells near it that were in view so far, turned its way up",
}
