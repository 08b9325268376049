"""Which stretches are compared: any as likely as another, or those on which an ensemble of reward models disagrees."""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from minihuman.errors import LearnError
from minihuman.learn.teach.dataset import Dataset, Lesson, Stretch
from minihuman.learn.teach.from_logs import lesson_name, of_session, stretch_of
from minihuman.learn.teach.reward_model import SHARES, RewardFitting, RewardModel, fit_reward
from minihuman.study.activities import pair_events

Pairing = Literal["random", "disputed"]
Pair = tuple[Stretch, Stretch]
EVERY_EPISODE = 2**31
CANDIDATES = 10  # pairs that are looked at for one that is asked about


def draw_pairs(lessons: Sequence[Lesson], count: int, *, steps: int, rng: np.random.Generator) -> list[Pair]:
    """Pairs of stretches of one length; every lesson that is long enough is as likely as another.

    Raises:
        LearnError: if there are no two stretches of that length.
    """
    long = [lesson for lesson in lessons if len(lesson.actions) >= steps]
    if sum(len(lesson.actions) - steps + 1 for lesson in long) < 2:
        raise LearnError(
            f"there are no two stretches of {steps} steps in {len(lessons)} episodes; compare shorter ones"
        )
    pairs = list[Pair]()
    while len(pairs) < count:
        left, right = (_stretch(long, steps, rng) for _ in range(2))
        if left != right:
            pairs.append((left, right))
    return pairs


def disputed(
    model: RewardModel | None, dataset: Dataset, count: int, *, steps: int, among: int, rng: np.random.Generator
) -> list[Pair]:
    """The pairs of ten times as many whose order the model's members disagree on most; any, without a model.

    Christiano and others (2017): the variance of what an ensemble foretells.

    Args:
        model: What was learnt from the answers so far.
        dataset: The lessons.
        count: How many pairs.
        steps: The length of a stretch.
        among: Stretches are taken from so many of the last lessons.
        rng: Draws the candidates.

    Raises:
        LearnError: if there are no two stretches of that length.
    """
    lessons = dataset.lessons[-among:]
    if model is None:
        return draw_pairs(lessons, count, steps=steps, rng=rng)
    pairs = draw_pairs(lessons, CANDIDATES * count, steps=steps, rng=rng)
    order = np.argsort(-doubt(model, dataset, pairs), kind="stable")
    return [pairs[place] for place in order[:count]]


def doubt(model: RewardModel, dataset: Dataset, pairs: Sequence[Pair]) -> NDArray[np.float64]:
    """How much the members disagree on each pair: the variance of the chance that each gives to the right side."""
    variances: NDArray[np.float64] = model.chances(dataset, pairs).var(axis=0)
    return variances


def most_disputed(
    logs: Sequence[Path], block: str, pairs: Sequence[tuple[pair_events.Stretch, pair_events.Stretch]], *, seed: int
) -> int:
    """The place of the pair that is worth asking about most, by what a session said so far; 0 where it said nothing.

    Args:
        logs: The session's logs, finished or live, all in one folder.
        block: Whose episodes are compared.
        pairs: Stretches of its episodes.
        seed: Of the ensemble.

    Raises:
        LearnError: if the block has no episode, or one does not replay.
    """
    dataset = of_session(logs, block, EVERY_EPISODE)
    if not any(each.answer in SHARES for each in dataset.comparisons):
        return 0
    session = dataset.lessons[0].name.partition(":")[0]
    model, _ = fit_reward(dataset, RewardFitting(), np.random.default_rng(seed))
    sides = [[stretch_of(side, lesson_name(session, side.episode, side.attempt)) for side in pair] for pair in pairs]
    return int(doubt(model, dataset, [(left, right) for left, right in sides]).argmax())


def _stretch(lessons: Sequence[Lesson], steps: int, rng: np.random.Generator) -> Stretch:
    lesson = lessons[int(rng.integers(len(lessons)))]
    first = int(rng.integers(len(lesson.actions) - steps + 1))
    return Stretch(lesson.name, first, first + steps - 1)
