"""Learning from preferences: pairs to compare, a reward model fitted to the answers, and a policy trained on it."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from minihuman.activities.episode_clips import EpisodeClip
from minihuman.errors import LearnError
from minihuman.learn.policy.network import Policy
from minihuman.learn.policy.observation import Observation
from minihuman.learn.ppo import PpoSettings, TrainingEnv, make_ppo
from minihuman.learn.teaching.dataset import Comparison, Dataset, LessonFragment
from minihuman.learn.teaching.learner import (
    LabelledSteps,
    Learner,
    LearningRequest,
    LearningResult,
    choose_encoder,
    collect_steps,
    copy_policy,
    make_fresh_policy,
    minimise_loss,
)
from minihuman.learn.teaching.log_dataset import make_fragment, make_lesson_name, read_session_dataset
from minihuman.learn.teaching.rating_learners import ActionValues

SHARES = {"left": 0.0, "right": 1.0, "equal": 0.5}  # the share of an answer that prefers the right fragment
LAPSES = 0.1  # the share of answers that are assumed to be random, as in Christiano and others
SPREAD = 0.1  # the standard deviation of a step's reward
_LEAST_STD = 1e-6  # by which rewards are divided even if all are equal
MAX_CACHED = 4096  # rewards of single steps that are kept, since small worlds often show the same observation again


@dataclass(frozen=True, slots=True)
class RewardFitting:
    """The settings for fitting a reward model."""

    members: int = 3  # networks of the ensemble, as in Christiano and others
    updates: int = 600  # of each network
    batch_size: int = 32  # comparisons
    learning_rate: float = 1e-3
    weight_decay: float = 1e-3


class RewardModel:
    """An ensemble of networks that predict a step's reward from its observation and action.

    The reward is the networks' mean. Comparisons of fragments of equal length do not determine a constant that is added
    to every step. As published, the rewards of each network are therefore standardised over the given steps, and their
    mean is scaled to a fixed standard deviation.

    Args:
        members: the networks, each of which returns a reward for each action.
        steps: the steps over which rewards are standardised.
    """

    def __init__(self, members: Sequence[nn.Module], steps: LabelledSteps) -> None:
        self._members = members
        raw = self._predict_raw_rewards(steps.observations, steps.actions)
        self._member_means = raw.mean(axis=1, keepdims=True)
        self._member_stds = np.maximum(raw.std(axis=1, keepdims=True), _LEAST_STD)
        standardised = (raw - self._member_means) / self._member_stds
        self._scale = SPREAD / max(_LEAST_STD, float(standardised.mean(axis=0).std()))
        self._reward_cache: dict[tuple[bytes, ...], float] = {}

    def rewards(self, observations: dict[str, torch.Tensor], actions: torch.Tensor) -> NDArray[np.float64]:
        """Return the standardised rewards of many steps, of shape (n,).

        Args:
            observations: the parts of the observations before the steps, each with n rows.
            actions: the actions of the steps, int64[n].
        """
        raw = self._predict_raw_rewards(observations, actions)
        standardised = (raw - self._member_means) / self._member_stds
        return np.asarray(self._scale * standardised.mean(axis=0))

    def reward(self, observation: Observation, action: int) -> float:
        """Return the standardised reward of one step; the latest rewards are cached."""
        key = (bytes([action]), *(part.tobytes() for part in observation.values()))
        if key not in self._reward_cache:
            if len(self._reward_cache) >= MAX_CACHED:
                self._reward_cache.clear()
            batch = {name: torch.as_tensor(part)[None] for name, part in observation.items()}
            self._reward_cache[key] = float(self.rewards(batch, torch.tensor([action]))[0])
        return self._reward_cache[key]

    def predict_answers(
        self, dataset: Dataset, pairs: Sequence[tuple[LessonFragment, LessonFragment]]
    ) -> NDArray[np.float64]:
        """Return each network's probability that a pair's right fragment is better, of shape (members, pairs).

        Args:
            dataset: the dataset with the lessons of the fragments.
            pairs: the left and the right fragment of each pair.
        """
        steps = collect_steps(dataset.lessons)
        first = get_first_rows(dataset)
        raw = torch.as_tensor(self._predict_raw_rewards(steps.observations, steps.actions))
        longest = _count_longest([side for pair in pairs for side in pair])
        left_rows, left_is_inside = _index_rows([left for left, _ in pairs], first, longest)
        right_rows, right_is_inside = _index_rows([right for _, right in pairs], first, longest)
        gains = []
        for member_rewards in raw:
            left_mean = _mean_inside(member_rewards[left_rows], left_is_inside)
            right_mean = _mean_inside(member_rewards[right_rows], right_is_inside)
            gains.append(right_mean - left_mean)
        return np.asarray(torch.sigmoid(longest * torch.stack(gains)))

    def _predict_raw_rewards(self, observations: dict[str, torch.Tensor], actions: torch.Tensor) -> NDArray[np.float64]:
        """Return each network's reward of each step before standardisation, of shape (members, n)."""
        with torch.no_grad():
            member_rewards = [member(observations).gather(1, actions[:, None])[:, 0] for member in self._members]
        return np.asarray(torch.stack(member_rewards).double())


def fit_reward(
    dataset: Dataset,
    settings: RewardFitting,
    rng: np.random.Generator,
    *,
    budget_s: float = float("inf"),
    checkpoint: Path | None = None,
) -> tuple[RewardModel, int]:
    """Fit a reward model to a dataset's comparisons, except those answered "cannot tell".

    The method follows Christiano, Leike, Brown, Martic, Legg and Amodei (2017), NeurIPS: the probability of an answer
    is a softmax of the fragments' summed rewards (Bradley and Terry, 1952), one answer in ten is assumed to be random,
    and "equal" counts half for each side. It differs in three ways. Each member of the ensemble learns from all
    comparisons, with its own initial weights and order, as in Lakshminarayanan, Pritzel and Blundell (2017), NeurIPS; a
    bootstrap sample would leave out a third of few answers. Weight decay is fixed, not chosen by held-out comparisons.
    Fragments of unequal length are compared by their mean rewards, so that a constant reward per step has no effect.

    The time limit is divided by the number of members. The first member stops at its part of the time, and the others
    make as many updates as it did, so that one number of updates reproduces the model.

    Returns:
        The model, and the number of updates of each member.

    Raises:
        LearnError: if there is no comparison whose answer is not "cannot tell".
    """
    comparisons = [comparison for comparison in dataset.comparisons if comparison.answer in SHARES]
    if not comparisons:
        raise LearnError(
            f"none of the {len(dataset.comparisons)} comparisons prefers a clip or rates two as equal; compare more "
            "pairs"
        )
    steps = collect_steps(dataset.lessons)
    answers = _encode_answers(dataset, comparisons)
    equal_steps = _find_equal_steps(steps)
    members = [ActionValues(make_fresh_policy(dataset, rng)) for _ in range(settings.members)]
    updates = settings.updates
    member_budget_s = budget_s / settings.members
    for number, member in enumerate(members):
        member_checkpoint = None
        if checkpoint is not None:
            member_checkpoint = checkpoint.with_name(f"{checkpoint.name}-{number}")
        updates, _ = minimise_loss(
            member,
            partial(_preference_loss, member, steps, equal_steps, answers, settings.batch_size),
            rng,
            updates=updates,
            learning_rate=settings.learning_rate,
            weight_decay=settings.weight_decay,
            budget_s=member_budget_s,
            checkpoint=member_checkpoint,
        )
        member_budget_s = float("inf")  # the others make as many updates as the first did
    return RewardModel(members, steps), updates


@dataclass(frozen=True, slots=True)
class _EncodedAnswers:
    """Comparisons and their answers as tensors."""

    rows: torch.Tensor  # int64[2, comparisons, longest] of the left and right fragments' steps
    inside: torch.Tensor  # float32 of the same shape, 1 where a fragment has that step
    shares: torch.Tensor  # float32[comparisons] of "right" in each answer

    @property
    def longest(self) -> int:
        """The number of steps of the longest fragment."""
        return self.rows.shape[2]


def _encode_answers(dataset: Dataset, comparisons: Sequence[Comparison]) -> _EncodedAnswers:
    """Return comparisons as tensors; the answer of each must be in ``SHARES``, so that it is not "cannot tell"."""
    first = get_first_rows(dataset)
    left_sides = [comparison.left for comparison in comparisons]
    right_sides = [comparison.right for comparison in comparisons]
    longest = _count_longest([*left_sides, *right_sides])
    sides = [_index_rows(left_sides, first, longest), _index_rows(right_sides, first, longest)]
    rows, inside = (torch.stack(parts) for parts in zip(*sides, strict=True))
    return _EncodedAnswers(rows, inside, torch.tensor([SHARES[comparison.answer] for comparison in comparisons]))


def _preference_loss(
    member: nn.Module,
    steps: LabelledSteps,
    equal_steps: torch.Tensor,
    answers: _EncodedAnswers,
    batch_size: int,
    generator: torch.Generator,
) -> torch.Tensor:
    """Return a network's mean cross-entropy over a minibatch of answers that is drawn with the generator.

    Args:
        member: the network.
        steps: the steps of all lessons.
        equal_steps: for each step, the row of the first step with the same observation.
        answers: the answers to draw from.
        batch_size: the number of answers in the minibatch.
        generator: the source of randomness.
    """
    minibatch = torch.randint(len(answers.shares), (batch_size,), generator=generator)
    rows = answers.rows[:, minibatch].flatten(0, 1)  # those of all left fragments, then those of all right ones
    inside = answers.inside[:, minibatch].flatten(0, 1)
    left, right = _mean_rewards(member, steps, equal_steps, rows, inside).chunk(2)
    p_right = (1 - LAPSES) * torch.sigmoid(answers.longest * (right - left)) + LAPSES / 2
    share = answers.shares[minibatch]
    return -(share * p_right.log() + (1 - share) * (1 - p_right).log()).mean()


def _count_longest(fragments: Sequence[LessonFragment]) -> int:
    """Return the number of steps of the longest fragment."""
    return max(fragment.last - fragment.first + 1 for fragment in fragments)


def get_first_rows(dataset: Dataset) -> dict[str, int]:
    """Return the row of each lesson's first step among the steps of all lessons, by the lesson's name."""
    starts = np.cumsum([0, *(len(lesson.actions) for lesson in dataset.lessons)])
    return {lesson.name: int(start) for lesson, start in zip(dataset.lessons, starts[:-1], strict=True)}


def _index_rows(
    fragments: Sequence[LessonFragment], first_rows: dict[str, int], longest: int
) -> tuple[torch.Tensor, torch.Tensor]:
    """Return the rows of each fragment's steps int64[n, longest], and a mask float32[n, longest] of the rows in use.

    Args:
        fragments: the n fragments.
        first_rows: the row of each lesson's first step, as `get_first_rows` returns it.
        longest: the number of steps of the longest fragment.
    """
    rows = torch.zeros(len(fragments), longest, dtype=torch.int64)
    inside = torch.zeros(len(fragments), longest)
    for index, fragment in enumerate(fragments):
        length = fragment.last - fragment.first + 1
        start = first_rows[fragment.lesson] + fragment.first
        rows[index, :length] = torch.arange(start, start + length)
        inside[index, :length] = 1
    return rows, inside


def _mean_rewards(
    member: nn.Module, steps: LabelledSteps, equal_steps: torch.Tensor, rows: torch.Tensor, inside: torch.Tensor
) -> torch.Tensor:
    """Return a network's mean reward over the steps of each fragment, float32[n].

    The network evaluates each different observation once.

    Args:
        member: the network.
        steps: the steps of all lessons.
        equal_steps: for each step, the row of the first step with the same observation.
        rows: the rows of the fragments' steps, as `_index_rows` returns them.
        inside: the mask of these rows.
    """
    flat_rows = rows.flatten()
    distinct_rows, indices = equal_steps[flat_rows].unique(return_inverse=True)  # type: ignore[no-untyped-call]
    step_rewards = member(steps.pick(distinct_rows))[indices, steps.actions[flat_rows]]
    return _mean_inside(step_rewards.view(rows.shape), inside)


def _find_equal_steps(steps: LabelledSteps) -> torch.Tensor:
    """Return for each step the row of the first step with the same observation, int64[n]."""
    flat_observations = [
        np.ascontiguousarray(part.numpy()).reshape(len(part), -1) for part in steps.observations.values()
    ]
    first_rows: dict[bytes, int] = {}
    equal_rows = []
    for row in range(len(steps.actions)):
        observation = b"".join(part[row].tobytes() for part in flat_observations)
        first_rows.setdefault(observation, row)
        equal_rows.append(first_rows[observation])
    return torch.tensor(equal_rows)


def _mean_inside(step_rewards: torch.Tensor, inside: torch.Tensor) -> torch.Tensor:
    """Return the mean reward of each fragment, float32[n], over the steps that the mask ``inside`` marks."""
    return torch.div((step_rewards * inside).sum(dim=1), inside.sum(dim=1))


Pair = tuple[LessonFragment, LessonFragment]
EVERY_EPISODE = 2**31  # more episodes than a session can have


def compute_disagreement(model: RewardModel, dataset: Dataset, pairs: Sequence[Pair]) -> NDArray[np.float64]:
    """Return the variance, over the networks, of the probability that each pair's right side is better, (pairs,)."""
    return np.asarray(model.predict_answers(dataset, pairs).var(axis=0))


def choose_disputed_pair(
    logs: Sequence[Path],
    block: str,
    pairs: Sequence[tuple[EpisodeClip, EpisodeClip]],
    *,
    seed: int,
) -> int:
    """Return the index of the pair of clips on which a reward model's networks disagree most; 0 before any answer.

    Args:
        logs: the session's logs, finished or live, all in one folder
        block: the name of the block whose episodes are compared
        pairs: pairs of clips of the block's episodes
        seed: the seed of the ensemble

    Raises:
        LearnError: if the block has no episode, or an episode does not replay.
    """
    dataset = read_session_dataset(logs, block, EVERY_EPISODE)
    if not any(comparison.answer in SHARES for comparison in dataset.comparisons):
        return 0
    session = dataset.lessons[0].name.partition(":")[0]
    model, _ = fit_reward(dataset, RewardFitting(), np.random.default_rng(seed))

    def make_side(clip: EpisodeClip) -> LessonFragment:
        return make_fragment(clip, make_lesson_name(session, clip.episode, clip.attempt))

    fragments = [(make_side(left), make_side(right)) for left, right in pairs]
    return int(compute_disagreement(model, dataset, fragments).argmax())


RewardFunction = Callable[[Observation, int, Any], float]  # of a step's observation and action, and the world after it


class RewardModelEnv(TrainingEnv):
    """A world for training that takes rewards from a reward function and never terminates.

    When an episode terminates, the next one begins without a sign to the learner, as Christiano and others did with
    Atari games. The reason is that comparisons do not determine a constant reward per step. If episodes terminated, a
    policy would postpone the goal if the constant is positive, and hurry to an end if it is negative. Without
    termination, the constant has no effect. Nor has it if an episode that takes too long is truncated.
    """

    def __init__(self, dataset: Dataset, reward_function: RewardFunction, *, seed: int) -> None:
        super().__init__(
            dataset.world,
            dataset.options,
            seed=seed,
            eyesight=dataset.eyesight,
            actions=len(dataset.action_names),
        )
        self._reward_function = reward_function
        self._most_steps = dataset.most_steps
        self._before: Observation = {}

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin the next episode; both arguments are ignored."""
        self._before, info = super().reset()
        return self._before, info

    def step(self, action: int) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Step the world; begin the next episode, without a sign to the learner, if this one terminated.

        Returns:
            The observation, the reward function's reward, False, whether the episode is truncated, and no facts.
        """
        before = self._before
        observation, _, terminated, truncated, _ = super().step(action)
        reward = self._reward_function(before, action, self.world)
        if terminated:
            observation, _ = super().reset()
        self._before = observation
        is_too_long = not terminated and (truncated or self._steps >= self._most_steps)
        return observation, reward, False, is_too_long, {}


@dataclass(frozen=True, slots=True)
class PreferenceSettings:
    """The settings of learning from preferences."""

    reward_updates: int = 600
    steps: int = 4096  # of PPO
    n_steps: int = 512
    n_epochs: int = 10
    learning_rate: float = 1e-3  # at the start of a round; it falls linearly to 0 at the end of the round
    gamma: float = 0.95  # discount
    entropy: float = 0.01  # weight of the policy's entropy, as in Christiano and others for Atari games


class PreferenceLearner(Learner):
    """Deep reinforcement learning from human preferences.

    Source: Christiano, Leike, Brown, Martic, Legg and Amodei (2017), NeurIPS 30; see ``fit_reward`` and
    ``RewardModelEnv``. The authors train with A2C or TRPO while comparisons come in. Here, PPO (Schulman and others,
    2017) continues from the previous policy after each round of comparisons, with rollouts of 512 steps, ten passes and
    a learning rate of 0.001, which learn small grids fastest.
    """

    name: ClassVar[str] = "preferences"
    settings_type = PreferenceSettings

    def learn(self, request: LearningRequest) -> LearningResult:
        """Fit a reward model, then train the previous policy, or a fresh one, on its rewards.

        The time limit applies to the reward model alone.

        Raises:
            LearnError: if there is no comparison whose answer is not "cannot tell".
        """
        settings: PreferenceSettings = self.settings
        model, updates = fit_reward(
            request.dataset,
            RewardFitting(updates=settings.reward_updates),
            request.rng,
            budget_s=request.budget_s,
            checkpoint=request.checkpoint,
        )
        trained = optimise_policy(
            request.dataset,
            lambda observation, action, _: model.reward(observation, action),
            settings,
            start=request.policy,
            seed=int(request.rng.integers(2**31)),
        )
        notes = {"comparisons": len(request.dataset.comparisons)}
        return LearningResult(trained, asdict(settings) | {"reward_updates": updates}, notes)


def optimise_policy(
    dataset: Dataset,
    reward_function: RewardFunction,
    settings: PreferenceSettings,
    *,
    seed: int,
    start: Policy | None = None,
) -> Policy:
    """Return a policy trained with PPO on a function's rewards in the dataset's world.

    The global generators of NumPy and torch are left in their present state.

    Args:
        dataset: the dataset, which has the world, its options and the settings of observations.
        reward_function: returns the reward of a step.
        settings: the settings of PPO.
        seed: the seed of the training.
        start: the policy to start from; None for fresh weights.
    """
    world = RewardModelEnv(dataset, reward_function, seed=seed)
    ppo = PpoSettings(n_steps=settings.n_steps, n_epochs=settings.n_epochs, learning_rate=settings.learning_rate)
    numpy_state = np.random.get_state()
    torch_state = torch.get_rng_state()
    try:
        agent = make_ppo(world, settings=ppo, eyes=choose_encoder(dataset), seed=seed, device="cpu")
        agent.gamma = settings.gamma
        agent.ent_coef = settings.entropy
        agent.lr_schedule = lambda remaining: settings.learning_rate * remaining
        if start is not None:
            agent.policy.load_state_dict(copy_policy(start, dataset).state_dict())
        agent.learn(settings.steps, log_interval=None)  # type: ignore[arg-type]
    finally:
        np.random.set_state(numpy_state)  # since Stable-Baselines3 seeds the global generators
        torch.set_rng_state(torch_state)
    assert isinstance(agent.policy, Policy)
    agent.policy.set_training_mode(False)
    return agent.policy
