"""Evaluation of policies: on fresh levels, and on the levels that a study's participants played, for comparison."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from minihuman.dataset.selection import Selection
from minihuman.errors import LearnError
from minihuman.learn.behaviour_cloning import Evaluation, held_out_seed
from minihuman.learn.demonstrations import LoggedEpisode, get_shared_plan, select_episodes
from minihuman.learn.policy.file import load_policy
from minihuman.learn.policy.network import Policy
from minihuman.learn.training_settings import WorldChoice
from minihuman.learn.training_worlds import BatchEncoder, TrainingLevel, TrainingWorlds, make_worlds
from minihuman.worlds.adapters.world import World

MAX_STEPS = 100_000  # of an episode, in a world without a step limit
MOST_WORLDS = 16  # that are stepped side by side


@dataclass(frozen=True, slots=True)
class EpisodeScore:
    """The return, length and success of an episode."""

    episode_return: float
    steps: int
    has_succeeded: bool  # it terminated with a reward


def play_levels(
    policy: Policy,
    worlds: TrainingWorlds,
    encoder: BatchEncoder,
    levels: Sequence[TrainingLevel],
    *,
    seed: int,
    most_steps: Sequence[int] | None = None,
) -> list[EpisodeScore]:
    """Play an episode of each level, drawing each action from the policy; return the scores in the levels' order.

    Args:
        policy: the policy, on the CPU.
        worlds: the worlds in which episodes are played side by side.
        encoder: the encoder of their observations.
        levels: the levels to play.
        seed: the seed of the drawn actions.
        most_steps: a step limit for each level; None for ``MAX_STEPS``. The worlds' own limits apply in any case.
    """
    limits = most_steps or [MAX_STEPS] * len(levels)
    queue = _LevelQueue(worlds, levels)
    random = torch.Generator().manual_seed(seed)
    hidden = torch.zeros(worlds.num_envs, policy.features_dim)
    starts = torch.ones(worlds.num_envs)
    while len(queue.scores) < len(levels):
        with torch.no_grad():
            outputs, _, hidden = policy.compute_step_outputs(encoder.encode(worlds), hidden, starts)
            actions = policy.distribution.draw(outputs, random)
        starts = torch.as_tensor(queue.step(actions.numpy(), limits), dtype=torch.float32)
    return [queue.scores[number] for number in range(len(levels))]


class _LevelQueue:
    """Worlds that play levels side by side, each taking the next level when its episode ends.

    A world that finds no level in the queue plays one again, whose score is ignored.
    """

    def __init__(self, worlds: TrainingWorlds, levels: Sequence[TrainingLevel]) -> None:
        self.scores: dict[int, EpisodeScore] = {}  # by the number of the level
        self._worlds = worlds
        self._levels = levels
        self._playing = list(range(worlds.num_envs))  # the number of each world's level; too high for a repetition
        self._returns = np.zeros(worlds.num_envs)
        self._lengths = np.zeros(worlds.num_envs, np.int64)
        self._begin(self._playing)

    def _begin(self, numbers: list[int]) -> None:
        """Begin, in the worlds with these numbers, the episodes of the levels that they play now."""
        # a number that is too high stands for a repetition, here and in ``step``
        levels = [self._levels[self._playing[number] % len(self._levels)] for number in numbers]
        self._worlds.begin(numbers, levels)

    def step(self, actions: NDArray[Any], limits: Sequence[int]) -> NDArray[np.bool_]:
        """Step all worlds, record the scores of the episodes that end, and begin the next levels.

        Args:
            actions: an action for each world.
            limits: the step limit of each level.

        Returns:
            Which of the worlds begin another level, bool[worlds].
        """
        joint_step = self._worlds.step(actions)
        self._returns += joint_step.rewards
        self._lengths += 1
        over = joint_step.terminated | joint_step.truncated
        over |= self._lengths >= np.array([limits[level % len(limits)] for level in self._playing])
        ended = np.flatnonzero(over).tolist()
        for number in ended:
            has_succeeded = bool(joint_step.terminated[number] and joint_step.rewards[number] > 0)
            if self._playing[number] < len(self._levels):
                score = EpisodeScore(float(self._returns[number]), int(self._lengths[number]), has_succeeded)
                self.scores[self._playing[number]] = score
            self._playing[number] = max(self._playing) + 1  # the next in the queue; too high once it is empty
        self._returns[over] = 0.0
        self._lengths[over] = 0
        if ended:
            self._begin(ended)
        return over


def summarise_scores(episodes: Sequence[EpisodeScore]) -> Evaluation:
    """Return the scores of some episodes as one evaluation: the counts, and the means of returns and steps."""
    return Evaluation(
        len(episodes),
        sum(episode.has_succeeded for episode in episodes),
        float(np.mean([episode.episode_return for episode in episodes])),
        float(np.mean([episode.steps for episode in episodes])),
    )


def evaluate_in_batch(
    policy: Policy, choices: Sequence[WorldChoice], encoder: BatchEncoder, *, episodes: int, seed: int
) -> list[Evaluation]:
    """Return a policy's evaluation in each of some worlds, on levels that no training draws.

    Args:
        policy: the policy, on the CPU.
        choices: the worlds.
        encoder: the encoder of the worlds' observations.
        episodes: the number of levels to play in each world.
        seed: the seed of the levels and of the policy's actions.
    """
    evaluations = []
    for choice in choices:
        worlds = make_worlds([choice], min(MOST_WORLDS, episodes), 1)
        levels = [TrainingLevel(0, held_out_seed(seed, episode)) for episode in range(episodes)]
        evaluations.append(summarise_scores(play_levels(policy, worlds, encoder, levels, seed=seed)))
    return evaluations


@dataclass(frozen=True, slots=True)
class PersonBesidePolicy:
    """A participant's evaluation in a world, and a policy's evaluation on the same levels."""

    participant: str
    person: Evaluation
    policy: Evaluation


@dataclass(frozen=True, slots=True)
class PeopleComparison:
    """A comparison of a policy with a study's participants, on the levels that each of them played."""

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
    """Return a line of the table of a comparison.

    Args:
        name: the participant's code, or a word for all participants.
        person: the evaluation of the participant.
        policy: the evaluation of the policy on the same levels.
    """
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


def compare_with_people(
    path: Path, study: Path, selection: Selection, *, world: str = "", seed: int = 1
) -> PeopleComparison:
    """Compare a policy with a study's participants: it plays their levels, with the same options and step limits.

    Args:
        path: the policy file.
        study: the study's folder, or a log.
        selection: the participants' episodes to compare with.
        world: the world; by default the first that the policy was trained in.
        seed: the seed of the policy's actions.

    Raises:
        LearnError: if the policy was not trained in the world or with its observations, the study has no episode in it,
            or it is a team world.
    """
    torch.set_num_threads(1)
    policy, card = load_policy(path)
    world = world or card.world
    if world not in card.worlds:
        raise LearnError(f"{path} was trained in {', '.join(card.worlds)}, not in {world}; choose one of its worlds")
    if card.eyesight.sight != "view":
        raise LearnError(f"{path} observes more than the world shows; compare a policy of --sight view")
    episodes, account = select_episodes(study, world, selection)
    plan = get_shared_plan(episodes)
    if any(episode.team is not None for _, episode in episodes):
        raise LearnError(f"{world} is a team world; let the policy take a seat of a study, and report that study")
    example = World(world, plan.options)
    if card.eyesight.space(example.unwrapped) != card.observation_space:
        raise LearnError(f"{path} was trained with other options than {study} has, {plan.options}; train with these")
    example.reset(plan.seed)
    encoder = BatchEncoder(card.eyesight.missions, card.eyesight.spreads(example.unwrapped, example.observation))
    worlds = make_worlds([WorldChoice(world, plan.options)], min(MOST_WORLDS, len(episodes)), 1)
    levels = [TrainingLevel(0, episode.plan.seed) for _, episode in episodes]
    limits = [episode.plan.max_steps for _, episode in episodes]
    policy_scores = play_levels(policy, worlds, encoder, levels, seed=seed, most_steps=limits)
    return PeopleComparison(world, tuple(_pair_people(episodes, policy_scores)), tuple(account.lines()))


def _pair_people(episodes: Sequence[LoggedEpisode], policy_scores: Sequence[EpisodeScore]) -> list[PersonBesidePolicy]:
    """Return the evaluation of each participant with the policy's on the same levels.

    ``policy_scores`` are the policy's scores on the levels of the episodes, in the same order.
    """
    person_scores_of: dict[str, list[EpisodeScore]] = {}
    policy_scores_of: dict[str, list[EpisodeScore]] = {}
    for (log, episode), policy_score in zip(episodes, policy_scores, strict=True):
        participant = log.plan.participant.id
        person_score = EpisodeScore(episode.return_, len(episode.actions), episode.outcome == "goal")
        person_scores_of.setdefault(participant, []).append(person_score)
        policy_scores_of.setdefault(participant, []).append(policy_score)
    return [
        PersonBesidePolicy(
            participant, summarise_scores(person_scores), summarise_scores(policy_scores_of[participant])
        )
        for participant, person_scores in person_scores_of.items()
    ]
