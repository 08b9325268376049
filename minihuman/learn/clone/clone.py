"""Behaviour cloning: a policy that does what people did, stopped when it no longer helps on other people."""

from dataclasses import dataclass

import numpy as np
import torch
from torch.nn import functional

from minihuman.errors import LearnError
from minihuman.learn.agent.network import Eyes, Policy, bare_policy
from minihuman.learn.clone.demonstrations import Demonstrations


@dataclass(frozen=True, slots=True)
class Cloning:
    """How a clone is trained."""

    validation_share: float = 0.2  # of the participants, at least one
    batch_size: int = 64
    learning_rate: float = 1e-3
    weight_decay: float = 1e-4
    most_epochs: int = 60
    patience: int = 8  # epochs without a better validation loss before it stops
    mirrored: bool = False  # add each step left for right; for worlds that look the same in a mirror
    seed: int = 1


@dataclass(frozen=True, slots=True)
class Cloned:
    """What came of it. Losses are mean cross-entropies a step, in nats."""

    epochs: int  # until the best validation loss
    training_loss: float
    validation_loss: float
    agreement: float  # share of the validation steps in which the likeliest action is the one taken
    training_episodes: int
    validation_episodes: int
    training_participants: tuple[str, ...]
    validation_participants: tuple[str, ...]


def split(demonstrations: Demonstrations, *, share: float, seed: int) -> tuple[Demonstrations, Demonstrations]:
    """Training and validation demonstrations; nobody is in both.

    Raises:
        LearnError: if only one participant took part.
    """
    people = list(demonstrations.participants)
    if len(people) < 2:
        raise LearnError(
            f"only {', '.join(people)} played {demonstrations.world}; a split by participant needs two or more"
        )
    order = [people[index] for index in np.random.default_rng(seed).permutation(len(people))]
    held = max(1, round(share * len(people)))
    return demonstrations.by(order[held:]), demonstrations.by(order[:held])


def clone(
    training: Demonstrations, validation: Demonstrations, *, eyes: Eyes, settings: Cloning
) -> tuple[Policy, Cloned]:
    """Train Stable-Baselines3's own policy class on what people did, and keep its best epoch."""
    torch.manual_seed(settings.seed)
    steps = _stack(training)
    if settings.mirrored:
        steps = _with_mirror_images(steps, training.action_names, eyes)
    images, missions, actions = steps
    held_out = _stack(validation)
    policy = bare_policy(training.space, len(training.action_names), eyes)
    policy.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
    optimiser = torch.optim.Adam(
        policy.parameters(), lr=settings.learning_rate, weight_decay=settings.weight_decay, fused=True
    )
    best, best_epoch, best_training, agreement = float("inf"), 0, float("nan"), 0.0
    kept = policy.state_dict()
    for epoch in range(1, settings.most_epochs + 1):
        losses = []
        for rows in torch.split(torch.randperm(len(actions)), settings.batch_size):
            loss = functional.nll_loss(policy.log_probabilities(_pick(images, missions, rows)), actions[rows])
            optimiser.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            optimiser.step()
            losses.append(loss.item())
        with torch.no_grad():
            judged = policy.log_probabilities(_pick(*held_out[:2], slice(None)))
        validation_loss = float(functional.nll_loss(judged, held_out[2]))
        if validation_loss < best:
            best, best_epoch, best_training = validation_loss, epoch, float(np.mean(losses))
            agreement = float((judged.argmax(dim=1) == held_out[2]).float().mean())
            kept = {name: value.clone() for name, value in policy.state_dict().items()}
        elif epoch - best_epoch >= settings.patience:
            break
    policy.load_state_dict(kept)
    policy.set_training_mode(False)
    return policy, Cloned(
        epochs=best_epoch,
        training_loss=best_training,
        validation_loss=best,
        agreement=agreement,
        training_episodes=len(training.episodes),
        validation_episodes=len(validation.episodes),
        training_participants=training.participants,
        validation_participants=validation.participants,
    )


Steps = tuple[torch.Tensor, torch.Tensor | None, torch.Tensor]  # images, missions, actions; one row a step


def _stack(demonstrations: Demonstrations) -> Steps:
    seen = [observation for episode in demonstrations.episodes for observation in episode.observations]
    images = torch.as_tensor(np.stack([observation["image"] for observation in seen]))
    missions = None
    if "mission" in seen[0]:
        missions = torch.as_tensor(np.stack([observation["mission"] for observation in seen]))
    return images, missions, torch.as_tensor(np.concatenate([episode.actions for episode in demonstrations.episodes]))


def _pick(images: torch.Tensor, missions: torch.Tensor | None, rows: torch.Tensor | slice) -> dict[str, torch.Tensor]:
    return {"image": images[rows]} | ({} if missions is None else {"mission": missions[rows]})


def _with_mirror_images(steps: Steps, action_names: tuple[str, ...], eyes: Eyes) -> Steps:
    images, missions, actions = steps
    sideways = 3 if eyes == "atari" else 2  # pictures are [row, column], grid codes [column, row]
    swapped = torch.tensor([action_names.index(_OTHER_SIDE.get(name, name)) for name in action_names])
    return (
        torch.cat((images, images.flip(sideways))),
        None if missions is None else torch.cat((missions, missions)),
        torch.cat((actions, swapped[actions])),
    )


_OTHER_SIDE = {"left": "right", "right": "left", "turn_left": "turn_right", "turn_right": "turn_left"}
