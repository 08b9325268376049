"""Behaviour cloning: train a policy to do what people did, stop when it no longer improves on other people, evaluate
it on fixed held-out episodes, and write it with its card."""

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
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
from minihuman.learn.policy.observation import Observation, ObservationEncoder, ViewMode, get_image_shape
from minihuman.learn.ppo import episode_seed
from minihuman.statistics.scores import wilson_interval
from minihuman.statistics.units import find_units
from minihuman.storage.durable_files import write_atomically
from minihuman.worlds.adapters.world import World

ChooseAction = Callable[[Observation], int]  # an action from what is seen


@dataclass(frozen=True, slots=True)
class Evaluation:
    """Episodes played and how many succeeded: ended by themselves with a reward."""

    episodes: int
    successes: int
    mean_return: float
    mean_steps: float

    @property
    def rate(self) -> float:
        """Return the success rate."""
        return self.successes / self.episodes

    @property
    def interval(self) -> tuple[float, float]:
        """Return the success rate's 95 % Wilson interval."""
        return wilson_interval(self.successes, self.episodes)

    def __str__(self) -> str:
        """Return the rate with its interval."""
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
    """Play held-out episodes, in a team world in every seat; their seeds come from ``seed`` alone.

    An episode ends when the world says so, or after ``most_steps``; one or the other has to.
    """
    env: Any = World(world_id, options, trusted=True).env  # with its own step limit
    world = env.unwrapped
    team = getattr(world, "team", None)
    first_action = int(env.action_space.start)
    encoder = eyesight.episode_encoder()
    returns = []
    steps = []
    successes = 0
    for episode in range(episodes):
        raw, _ = env.reset(seed=held_out_seed(seed, episode))
        total = 0.0
        length = 0
        ended = False
        terminated = False
        reward = 0.0
        while not ended:
            if team is not None:  # what the other bodies do
                world.joint = [choose(encoder.encode(world, team.observation(body))) for body in range(team.bodies)]
            raw, reward, terminated, truncated, _ = env.step(first_action + choose(encoder.encode(world, raw)))
            total = total + float(reward)
            length = length + 1
            ended = terminated or truncated or length == most_steps
        returns.append(total)
        steps.append(length)
        successes += terminated and reward > 0
    return Evaluation(episodes, successes, float(np.mean(returns)), float(np.mean(steps)))


def held_out_seed(seed: int, episode: int) -> int:
    """Return the reset seed of a held-out episode: above 2**31, where no training or session seed of ours lies."""
    return 2**31 + episode_seed(seed, episode)


def make_sampling_policy(policy: Policy, seed: int) -> ChooseAction:
    """Make a policy that draws each action from its own probabilities, repeatably."""
    random = torch.Generator().manual_seed(seed)

    def choose(observation: Observation) -> int:
        return int(torch.multinomial(policy.probabilities(observation), 1, generator=random))

    return choose


def make_random_policy(actions: int, seed: int) -> ChooseAction:
    """Make a policy that takes any action at any time: what a policy has to beat."""
    rng = np.random.default_rng(seed)
    return lambda _: int(rng.integers(actions))


@dataclass(frozen=True, slots=True)
class CloningSettings:
    """The settings of cloning."""

    validation_share: float = 0.2  # of the participants, at least one
    batch_size: int = 64
    learning_rate: float = 1e-3
    weight_decay: float = 1e-4
    most_epochs: int = 60
    patience: int = 8  # epochs without a better validation loss before it stops
    mirrored: bool = False  # add each step left for right; for worlds that look the same in a mirror
    seed: int = 1


@dataclass(frozen=True, slots=True)
class CloningResult:
    """The result of cloning. Losses are mean cross-entropies per step, in nats."""

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
    """Split demonstrations into training and validation; no participant is in both, nor people who played together.

    Raises:
        LearnError: if only one participant, or one team, took part.
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
    return demonstrations.by(
        [participant for participant in demonstrations.participants if participant not in validation_participants]
    ), demonstrations.by(validation_participants)


def clone_policy(
    training: Demonstrations, validation: Demonstrations, *, eyes: EncoderName, settings: CloningSettings
) -> tuple[Policy, CloningResult]:
    """Train Stable-Baselines3's own policy class on what people did, and keep its best epoch."""
    torch.manual_seed(settings.seed)
    steps = _stack(training)
    if settings.mirrored:
        steps = _with_mirror_images(steps, training.action_names, eyes)
    held_out = _stack(validation)
    policy = build_policy(training.space, len(training.action_names), eyes)
    policy.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    optimiser = torch.optim.Adam(
        policy.parameters(), lr=settings.learning_rate, weight_decay=settings.weight_decay, fused=True
    )
    best = float("inf")
    best_epoch = 0
    best_training = float("nan")
    agreement = 0.0
    best_weights = policy.state_dict()
    for epoch in range(1, settings.most_epochs + 1):
        training_loss = _train_epoch(policy, optimiser, steps, settings.batch_size)
        validation_loss, share_equal = _compare_with_people(policy, held_out)
        if validation_loss < best:
            best = validation_loss
            best_epoch = epoch
            best_training = training_loss
            agreement = share_equal
            best_weights = {name: value.clone() for name, value in policy.state_dict().items()}
        elif epoch - best_epoch >= settings.patience:
            break
    policy.load_state_dict(best_weights)
    policy.set_training_mode(False)
    return policy, CloningResult(
        epochs=best_epoch,
        training_loss=best_training,
        validation_loss=best,
        agreement=agreement,
        training_episodes=len(training.episodes),
        validation_episodes=len(validation.episodes),
        training_participants=training.participants,
        validation_participants=validation.participants,
    )


Steps = tuple[torch.Tensor, torch.Tensor | None, torch.Tensor]  # images, missions, actions; one row per step


def _compare_with_people(policy: Policy, steps: Steps) -> tuple[float, float]:
    """Return the mean cross-entropy of steps, and the share in which the likeliest action is the one taken."""
    images, missions, actions = steps
    with torch.no_grad():
        log_probs = policy.log_probabilities(_pick(images, missions, slice(None)))
    loss = float(functional.nll_loss(log_probs, actions))
    return loss, float((log_probs.argmax(dim=1) == actions).float().mean())


def _train_epoch(policy: Policy, optimiser: torch.optim.Adam, steps: Steps, batch_size: int) -> float:
    """Pass through all steps once, in minibatches; return the mean loss."""
    images, missions, actions = steps
    losses = []
    for rows in torch.split(torch.randperm(len(actions)), batch_size):
        loss = functional.nll_loss(policy.log_probabilities(_pick(images, missions, rows)), actions[rows])
        optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        optimiser.step()
        losses.append(loss.item())
    return float(np.mean(losses))


def _stack(demonstrations: Demonstrations) -> Steps:
    observations = [observation for episode in demonstrations.episodes for observation in episode.observations]
    images = torch.as_tensor(np.stack([observation["image"] for observation in observations]))
    missions = None
    if "mission" in observations[0]:
        missions = torch.as_tensor(np.stack([observation["mission"] for observation in observations]))
    return images, missions, torch.as_tensor(np.concatenate([episode.actions for episode in demonstrations.episodes]))


def _pick(images: torch.Tensor, missions: torch.Tensor | None, rows: torch.Tensor | slice) -> dict[str, torch.Tensor]:
    if missions is None:
        return {"image": images[rows]}
    return {"image": images[rows], "mission": missions[rows]}


def _with_mirror_images(steps: Steps, action_names: tuple[str, ...], eyes: EncoderName) -> Steps:
    images, missions, actions = steps
    sideways = 2  # grid codes are [column, row]
    if eyes == "atari":
        sideways = 3  # pictures are [row, column]
    if missions is not None:
        missions = torch.cat((missions, missions))
    swapped = torch.tensor([action_names.index(_OTHER_SIDE.get(name, name)) for name in action_names])
    return torch.cat((images, images.flip(sideways))), missions, torch.cat((actions, swapped[actions]))


_OTHER_SIDE = {"left": "right", "right": "left", "turn_left": "turn_right", "turn_right": "turn_left"}


_EYES: dict[ViewMode, EncoderName] = {"whole": "map", "remembered": "near"}


@dataclass(frozen=True, slots=True)
class CloneStudy:
    """The settings of a cloning study: what to clone, and how to evaluate it."""

    world: str
    sight: ViewMode = "view"
    missions: bool = False
    sizes: tuple[int, ...] = ()  # numbers of demonstrations to clone from, beside all of them
    evaluation_episodes: int = 200
    selection: Selection = field(default_factory=lambda: Selection(outcome=("goal",)))
    cloning: CloningSettings = field(default_factory=CloningSettings)


@dataclass(frozen=True, slots=True)
class CloneEvaluation:
    """A clone from a number of demonstrations, and its evaluation."""

    demonstrations: int
    cloned: CloningResult
    played: Evaluation


def clone_study(source: Path, out: Path, study: CloneStudy, *, command: str) -> str:
    """Clone, judge, and write the policy (``out``), its card (``out`` + .md) and numbers (.json); returns the card.

    The policy is the clone from all demonstrations.

    Raises:
        LearnError: if a file is there already, a number of demonstrations is below 1, or nothing can be cloned; nothing
            is written then.
    """
    torch.set_num_threads(1)  # such small networks are faster so, and sums come in one order
    files = {kind: out.with_name(out.name + kind) for kind in ("", ".md", ".json")}
    if existing_paths := [path for path in files.values() if path.exists()]:
        raise LearnError(f"{existing_paths[0]} already exists; choose another file with --out")
    if odd := [size for size in study.sizes if size < 1]:
        raise LearnError(f"{odd[0]} is not a valid number of demonstrations; use 1 or more")
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
    sizes = sorted({*(size for size in study.sizes if size < len(training.episodes)), len(training.episodes)})
    for size in sizes:
        policy, cloned = clone_policy(training.first(size), validation, eyes=eyes, settings=study.cloning)
        played = _play(make_sampling_policy(policy, study.cloning.seed), demonstrations, study)
        rows.append(CloneEvaluation(size, cloned, played))
    assert policy is not None
    random = make_random_policy(len(demonstrations.action_names), study.cloning.seed)
    chance = _play(random, demonstrations, study)
    text = build_card_text(study, demonstrations, rows, chance, command)
    out.parent.mkdir(parents=True, exist_ok=True)
    save_policy(policy, _card(demonstrations, eyes, study), out)
    write_atomically(json.dumps(_numbers(study, rows, chance, command), indent=1), files[".json"])
    write_atomically(text, files[".md"])
    return text


def _choose_encoder(sight: ViewMode, image_shape: tuple[int, int, int]) -> EncoderName:
    """Choose the network that suits a sight, or an image of channels, height and width."""
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
    """Write the card in Markdown: what it learnt from, how well it plays, and how that was found."""
    players = sorted({episode.player for episode in demonstrations.episodes})
    last = rows[-1].cloned
    sight = _SIGHTS[study.sight]
    if study.missions:
        sight += " and the mission"
    success = f"Success over {study.evaluation_episodes} held-out episodes, each action drawn from the policy"
    if any(episode.team for episode in demonstrations.episodes):
        success += " in every seat"
    success += ", with its 95 %"
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
        success,
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
    lines += [f"Command: `{command}`", "", "Versions: " + ", ".join(f"{k} {v}" for k, v in get_versions().items())]
    return "\n".join(lines) + "\n"


def _numbers(study: CloneStudy, rows: list[CloneEvaluation], chance: Evaluation, command: str) -> dict[str, Any]:
    return {
        "study": asdict(study),
        "rows": [asdict(row) | {"success": row.played.rate, "interval": row.played.interval} for row in rows],
        "chance": asdict(chance) | {"success": chance.rate, "interval": chance.interval},
        "command": command,
        "versions": get_versions(),
    }


def _play(choose: ChooseAction, demonstrations: Demonstrations, study: CloneStudy) -> Evaluation:
    return evaluate_policy(
        choose,
        study.world,
        demonstrations.options,
        demonstrations.eyesight,
        episodes=study.evaluation_episodes,
        seed=study.cloning.seed,
        most_steps=demonstrations.most_steps,
    )


def _card(demonstrations: Demonstrations, eyes: EncoderName, study: CloneStudy) -> PolicyCard:
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
    )


_SIGHTS = {
    "view": "the world's own observation",
    "whole": "the whole grid, turned its way up",
    "remembered": "the cells near it that were in view so far, turned its way up",
}
