"""A reward model: what a step is worth to a person who says which of two stretches is better."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from minihuman.errors import LearnError
from minihuman.learn.agent.observe import Observation
from minihuman.learn.teach.dataset import Dataset, Stretch
from minihuman.learn.teach.fitting import fit
from minihuman.learn.teach.labelled import Steps, steps_of
from minihuman.learn.teach.port import new_policy
from minihuman.learn.teach.tamer import ActionValues

SHARES = {"left": 0.0, "right": 1.0, "equal": 0.5}  # how much of "right" an answer says
LAPSES = 0.1  # of answers that are taken to be pressed without looking: Christiano and others' share
SPREAD = 0.1  # standard deviation of a step's reward
MOST_KEPT = 4096  # rewards of single steps that are kept, for small worlds show the same again and again


@dataclass(frozen=True, slots=True)
class RewardFitting:
    """How a reward model is fitted."""

    members: int = 3  # networks that disagree where they know little: Christiano and others' number
    updates: int = 600  # of each
    batch_size: int = 32  # comparisons
    learning_rate: float = 1e-3
    weight_decay: float = 1e-3


class RewardModel:
    """Networks that give a step's reward from what was seen and done; their mean, brought to a scale.

    Comparisons of stretches of one length say nothing of what is added to every step. As published, each network's
    rewards have mean 0 and one spread over the steps looked at, and so has their mean.
    """

    def __init__(self, members: Sequence[nn.Module], steps: Steps) -> None:
        self._members = members
        raw = self._raw(steps.observations, steps.actions)
        self._shifts, self._scales = raw.mean(axis=1, keepdims=True), np.maximum(raw.std(axis=1, keepdims=True), 1e-6)
        self._scale = SPREAD / max(1e-6, float(((raw - self._shifts) / self._scales).mean(axis=0).std()))
        self._kept: dict[tuple[bytes, ...], float] = {}

    def rewards(self, seen: dict[str, torch.Tensor], actions: torch.Tensor) -> NDArray[np.float64]:
        """Rewards of many steps, (n,)."""
        each = (self._raw(seen, actions) - self._shifts) / self._scales
        rewards: NDArray[np.float64] = self._scale * each.mean(axis=0)
        return rewards

    def reward(self, seen: Observation, action: int) -> float:
        """The reward of one step."""
        key = (bytes([action]), *(part.tobytes() for part in seen.values()))
        if key not in self._kept:
            if len(self._kept) >= MOST_KEPT:
                self._kept.clear()
            one = {name: torch.as_tensor(part)[None] for name, part in seen.items()}
            self._kept[key] = float(self.rewards(one, torch.tensor([action]))[0])
        return self._kept[key]

    def chances(self, dataset: Dataset, pairs: Sequence[tuple[Stretch, Stretch]]) -> NDArray[np.float64]:
        """What each member says of each pair: the chance that its right side is called better, (members, pairs)."""
        steps, first = steps_of(dataset.lessons), _first_rows(dataset)
        raw = torch.as_tensor(self._raw(steps.observations, steps.actions))
        longest = _longest([side for pair in pairs for side in pair])
        left, right = (_rows([pair[place] for pair in pairs], first, longest) for place in (0, 1))
        gains = [_average(one[right[0]], right[1]) - _average(one[left[0]], left[1]) for one in raw]
        chances: NDArray[np.float64] = torch.sigmoid(longest * torch.stack(gains)).numpy()
        return chances

    def _raw(self, seen: dict[str, torch.Tensor], actions: torch.Tensor) -> NDArray[np.float64]:
        """What each member says of each step, (members, n)."""
        with torch.no_grad():
            said = [member(seen).gather(1, actions[:, None])[:, 0] for member in self._members]
        raw: NDArray[np.float64] = torch.stack(said).double().numpy()
        return raw


def fit_reward(
    dataset: Dataset,
    settings: RewardFitting,
    rng: np.random.Generator,
    *,
    budget_s: float = float("inf"),
    checkpoint: Path | None = None,
) -> tuple[RewardModel, int]:
    """Fit a reward model to a data set's comparisons; "cannot tell" says nothing and is left out.

    After Christiano, Leike, Brown, Martic, Legg and Amodei (2017), NeurIPS: the chance of an answer is a softmax of the
    stretches' summed rewards (Bradley and Terry, 1952), one answer in ten is taken to be pressed without looking, and
    equal counts half for either. Two things differ. Each member of the ensemble learns from all comparisons and has
    first weights and an order of its own, as in Lakshminarayanan, Pritzel and Blundell (2017), NeurIPS; theirs learns
    from as many drawn with replacement, which leaves a third of few answers out. And their weight decay is chosen by
    comparisons held out; here it is given. Stretches of unequal length are compared by their mean, so that what is
    added to every step says nothing there either.

    The first member has its share of the time; the others make as many updates as it did, so that one number says how
    to make the very same model again.

    Returns:
        The model, and the updates of each member.

    Raises:
        LearnError: if there is no comparison that says something.
    """
    comparisons = [each for each in dataset.comparisons if each.answer in SHARES]
    if not comparisons:
        raise LearnError(f"none of {len(dataset.comparisons)} comparisons says which stretch is better")
    steps, first = steps_of(dataset.lessons), _first_rows(dataset)
    alike = _alike(steps)
    longest = _longest([side for each in comparisons for side in (each.left, each.right)])
    sides = [_rows([getattr(each, side) for each in comparisons], first, longest) for side in ("left", "right")]
    rows, inside = (torch.stack(parts) for parts in zip(*sides, strict=True))  # (2, comparisons, longest)
    shares = torch.tensor([SHARES[each.answer] for each in comparisons])
    members = [ActionValues(new_policy(dataset, rng)) for _ in range(settings.members)]
    done = settings.updates
    for number, member in enumerate(members):

        def loss_of(generator: torch.Generator, member: nn.Module = member) -> torch.Tensor:
            drawn = torch.randint(len(shares), (settings.batch_size,), generator=generator)
            both = _worth(member, steps, alike, rows[:, drawn].flatten(0, 1), inside[:, drawn].flatten(0, 1))
            left, right = both.chunk(2)
            right_better = (1 - LAPSES) * torch.sigmoid(longest * (right - left)) + LAPSES / 2
            share = shares[drawn]
            return -(share * right_better.log() + (1 - share) * (1 - right_better).log()).mean()

        done, _ = fit(
            member,
            loss_of,
            rng,
            updates=done,
            learning_rate=settings.learning_rate,
            weight_decay=settings.weight_decay,
            budget_s=float("inf") if number else budget_s / settings.members,
            checkpoint=None if checkpoint is None else checkpoint.with_name(f"{checkpoint.name}-{number}"),
        )
    return RewardModel(members, steps), done


def agreement(
    model: RewardModel, dataset: Dataset, pairs: Sequence[tuple[Stretch, Stretch]], truth: Sequence[float]
) -> float:
    """The share of pairs that the model puts in the order of the truth (right minus left; ties are left out)."""
    steps, first = steps_of(dataset.lessons), _first_rows(dataset)
    rewards = model.rewards(steps.observations, steps.actions)
    said = [_sum(rewards, first, right) - _sum(rewards, first, left) for left, right in pairs]
    right = [(one > 0) == (true > 0) for one, true in zip(said, truth, strict=True) if true != 0]
    return float(np.mean(right))


def _sum(rewards: NDArray[np.float64], first: dict[str, int], side: Stretch) -> float:
    start = first[side.lesson]
    return float(rewards[start + side.first : start + side.last + 1].sum())


def _longest(sides: Sequence[Stretch]) -> int:
    return max(side.last - side.first + 1 for side in sides)


def _first_rows(dataset: Dataset) -> dict[str, int]:
    """Each lesson's first row among all steps."""
    starts = np.cumsum([0, *(len(lesson.actions) for lesson in dataset.lessons)])
    return {lesson.name: int(start) for lesson, start in zip(dataset.lessons, starts[:-1], strict=True)}


def _rows(stretches: Sequence[Stretch], first: dict[str, int], longest: int) -> tuple[torch.Tensor, torch.Tensor]:
    """Rows of stretches' steps, int64[n, longest], and which of them there are, float32 of the same shape."""
    rows = torch.zeros(len(stretches), longest, dtype=torch.int64)
    inside = torch.zeros(len(stretches), longest)
    for place, side in enumerate(stretches):
        length = side.last - side.first + 1
        start = first[side.lesson] + side.first
        rows[place, :length] = torch.arange(start, start + length)
        inside[place, :length] = 1
    return rows, inside


def _worth(
    member: nn.Module, steps: Steps, alike: torch.Tensor, rows: torch.Tensor, inside: torch.Tensor
) -> torch.Tensor:
    """A member's mean reward of each stretch."""
    different, place = alike[rows.flatten()].unique(return_inverse=True)  # type: ignore[no-untyped-call]
    said = member(steps.pick(different))[place, steps.actions[rows.flatten()]]
    return _average(said.view(rows.shape), inside)


def _alike(steps: Steps) -> torch.Tensor:
    """For each step the first that shows the same, int64[n]: a small world shows little, so each is thought of once."""
    shown = [np.ascontiguousarray(part.numpy()).reshape(len(part), -1) for part in steps.observations.values()]
    first: dict[bytes, int] = {}
    return torch.tensor(
        [first.setdefault(b"".join(part[row].tobytes() for part in shown), row) for row in range(len(steps.actions))]
    )


def _average(said: torch.Tensor, inside: torch.Tensor) -> torch.Tensor:
    average: torch.Tensor = (said * inside).sum(dim=1) / inside.sum(dim=1)
    return average
