"""How well a policy plays: on fresh levels, and on the levels that a study's participants played, beside them."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from minihuman.dataset.selection import Selection
from minihuman.errors import LearnError
from minihuman.learn.behaviour_cloning import Evaluation, held_out_seed
from minihuman.learn.demonstrations import LoggedEpisode, check_equal_options, select_episodes
from minihuman.learn.policy.file import load_policy
from minihuman.learn.policy.network import Policy
from minihuman.learn.training_settings import WorldChoice
from minihuman.learn.training_worlds import BatchEncoder, Level, TrainingWorlds, make_worlds
from minihuman.worlds.adapters.world import World

MOST_STEPS = 100_000  # of an episode, in a world without a step limit
TOGETHER = 16  # worlds


@dataclass(frozen=True, slots=True)
class PlayedEpisode:
    """What came of an episode."""

    episode_return: float
    steps: int
    has_succeeded: bool  # it terminated with a reward


def play_levels(
    policy: Policy,
    worlds: TrainingWorlds,
    encoder: BatchEncoder,
    levels: Sequence[Level],
    *,
    seed: int,
    most_steps: Sequence[int] | None = None,
) -> list[PlayedEpisode]:
    """Play an episode of each level, each action drawn from the policy; return them in the order of the levels.

    Args:
        policy: the policy, on the CPU.
        worlds: the worlds in which episodes are played side by side.
        encoder: what encodes their observations.
        levels: the levels to play.
        seed: the seed of the drawn actions.
        most_steps: a step limit for each level; None for the worlds' own alone.
    """
    limits = most_steps or [MOST_STEPS] * len(levels)
    random = torch.Generator().manual_seed(seed)
    n = worlds.num_envs
    playing = list(range(n))  # the level of each world; numbers past the last play a level again that does not count
    played: dict[int, PlayedEpisode] = {}
    worlds.begin(range(n), [levels[number % len(levels)] for number in playing])
    hidden = torch.zeros(n, policy.features_dim)
    starts = torch.ones(n)
    returns = np.zeros(n)
    lengths = np.zeros(n, np.int64)
    while len(played) < len(levels):
        with torch.no_grad():
            log_probs, _, hidden = policy.think_on(encoder.encode(worlds), hidden, starts)
            actions = torch.multinomial(log_probs.exp(), 1, generator=random).squeeze(1)
        transition = worlds.step(actions.numpy())
        returns += transition.rewards
        lengths += 1
        over = transition.terminated | transition.truncated
        over |= lengths >= np.array([limits[number % len(levels)] for number in playing])
        ended = np.flatnonzero(over).tolist()
        for i in ended:
            if playing[i] < len(levels):
                success = bool(transition.terminated[i] and transition.rewards[i] > 0)
                played[playing[i]] = PlayedEpisode(float(returns[i]), int(lengths[i]), success)
            playing[i] = max(playing) + 1
        returns[over] = lengths[over] = 0
        starts = torch.as_tensor(over, dtype=torch.float32)
        if ended:
            worlds.begin(ended, [levels[playing[i] % len(levels)] for i in ended])
    return [played[number] for number in range(len(levels))]


def summarize(episodes: Sequence[PlayedEpisode]) -> Evaluation:
    """Return the number of episodes, how many succeeded, and the means of returns and lengths."""
    return Evaluation(
        len(episodes),
        sum(episode.has_succeeded for episode in episodes),
        float(np.mean([episode.episode_return for episode in episodes])),
        float(np.mean([episode.steps for episode in episodes])),
    )


def evaluate_in_batch(
    policy: Policy, choices: Sequence[WorldChoice], encoder: BatchEncoder, *, episodes: int, seed: int
) -> list[Evaluation]:
    """Evaluate a policy in each of some worlds, on levels that no training draws; they depend on ``seed`` alone."""
    evaluations = []
    for choice in choices:
        worlds = make_worlds([choice], min(TOGETHER, episodes), 1)
        levels = [Level(0, held_out_seed(seed, episode)) for episode in range(episodes)]
        evaluations.append(summarize(play_levels(policy, worlds, encoder, levels, seed=seed)))
    return evaluations


@dataclass(frozen=True, slots=True)
class PersonBesidePolicy:
    """A participant's episodes in a world, and a policy's on the same levels."""

    participant: str
    person: Evaluation
    policy: Evaluation


@dataclass(frozen=True, slots=True)
class Comparison:
    """A policy beside the participants of a study, on the levels that each of them played."""

    world: str
    people: tuple[PersonBesidePolicy, ...]
    account: tuple[str, ...]  # which episodes are included, and why others are not

    def __str__(self) -> str:
        """Return a table with a line for each participant and for all of them."""
        columns = f"{'episodes':>10}{'success':>16}{'return':>16}{'steps':>16}"
        lines = [f"{self.world}: the person, the policy on the same levels", f"{'participant':16}{columns}"]
        lines += [_format_pair(pair.participant, pair.person, pair.policy) for pair in self.people]
        everyone = _pool([pair.person for pair in self.people])
        lines.append(_format_pair("everyone", everyone, _pool([pair.policy for pair in self.people])))
        below = sum(pair.person.rate < pair.policy.rate for pair in self.people)
        equal = sum(pair.person.rate == pair.policy.rate for pair in self.people)
        lines.append(f"The policy succeeds more often than {below} of {len(self.people)} people, as often as {equal}.")
        return "\n".join(lines)


def _format_pair(name: str, person: Evaluation, policy: Evaluation) -> str:
    success = f"{person.rate:.2f}, {policy.rate:.2f}"
    returns = f"{person.mean_return:.2f}, {policy.mean_return:.2f}"
    steps = f"{person.mean_steps:.1f}, {policy.mean_steps:.1f}"
    return f"{name:16}{person.episodes:10}{success:>16}{returns:>16}{steps:>16}"


def _pool(parts: Sequence[Evaluation]) -> Evaluation:
    """Return the evaluation of the episodes of all parts together."""
    weights = [part.episodes for part in parts]
    return Evaluation(
        sum(weights),
        sum(part.successes for part in parts),
        float(np.average([part.mean_return for part in parts], weights=weights)),
        float(np.average([part.mean_steps for part in parts], weights=weights)),
    )


def compare_with_people(path: Path, study: Path, selection: Selection, *, world: str = "", seed: int = 1) -> Comparison:
    """Have a policy play the levels that a study's participants played, with their options and step limits.

    Args:
        path: the policy file.
        study: the study's folder, or a log.
        selection: the participants' episodes to compare with.
        world: the world; by default the first that the policy was trained in.
        seed: the seed of the policy's actions.

    Raises:
        LearnError: if the study has no such episode, or the policy observes something else in the world.
    """
    torch.set_num_threads(1)
    policy, card = load_policy(path)
    world = world or card.world
    if world not in card.worlds:
        raise LearnError(f"{path} was trained in {', '.join(card.worlds)}, not in {world}; choose one of its worlds")
    if card.eyesight.sight != "view":
        raise LearnError(f"{path} observes more than the world shows; compare a policy of --sight view")
    episodes, account = select_episodes(study, world, selection)
    plan = check_equal_options(episodes)
    if any(episode.team is not None for _, episode in episodes):
        raise LearnError(f"{world} is a team world; let the policy take a seat of a study, and report that study")
    example = World(world, plan.options)
    if card.eyesight.space(example.unwrapped) != card.observation_space:
        raise LearnError(f"{path} was trained with other options than {study} has, {plan.options}; train with these")
    example.reset(plan.seed)
    encoder = BatchEncoder(card.eyesight.missions, card.eyesight.spreads(example.unwrapped, example.observation))
    worlds = make_worlds([WorldChoice(world, plan.options)], min(TOGETHER, len(episodes)), 1)
    levels = [Level(0, episode.plan.seed) for _, episode in episodes]
    limits = [episode.plan.max_steps for _, episode in episodes]
    played = play_levels(policy, worlds, encoder, levels, seed=seed, most_steps=limits)
    return Comparison(world, tuple(_pair_people(episodes, played)), tuple(account.lines()))


def _pair_people(episodes: Sequence[LoggedEpisode], played: Sequence[PlayedEpisode]) -> list[PersonBesidePolicy]:
    """Return each participant's episodes beside the policy's on the same levels."""
    pairs: dict[str, list[tuple[PlayedEpisode, PlayedEpisode]]] = {}
    for (log, episode), by_policy in zip(episodes, played, strict=True):
        by_person = PlayedEpisode(episode.return_, len(episode.actions), episode.outcome == "goal")
        pairs.setdefault(log.plan.participant.id, []).append((by_person, by_policy))
    return [
        PersonBesidePolicy(name, summarize([pair[0] for pair in own]), summarize([pair[1] for pair in own]))
        for name, own in pairs.items()
    ]
