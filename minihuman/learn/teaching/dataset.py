"""A teaching dataset: the observations and actions of agents and people, with people's ratings and comparisons.

A dataset is plain arrays, independent of logs: `log_dataset` reads it from a study, or a simulation makes it.
"""

import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, get_args

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from minihuman.errors import LearnError
from minihuman.learn.policy.observation import Observation, ObservationEncoder

Answer = Literal["left", "right", "equal", "cannot tell"]
NO_QUERY = -1  # in place of a policy's action, at a step for which no policy was asked


@dataclass(frozen=True, slots=True, eq=False)
class Lesson:
    """One episode, or a person's correction of an episode; every array has ``n`` rows, one per step."""

    name: str  # "sub-01_ses-01:3" for its third episode
    participant: str
    seed: int  # of the world's reset
    observations: Observation  # image uint8[n, C, H, W], and mission float32[n, 9] where there is one
    actions: NDArray[np.int64]  # (n,) what was done
    by_person: NDArray[np.bool_]  # (n,) whether a person steered, not the agent
    policy_actions: NDArray[np.int64]  # (n,) what the policy would have done, or NO_QUERY
    shown_ns: NDArray[np.int64]  # (n,) session time at which the picture before the step was displayed
    rewards: NDArray[np.float64]  # (n,) the world's own
    policy_probabilities: NDArray[np.float32] | None = None  # (n, actions); None where no policy was asked
    policy: str = ""  # SHA-256 of the policy's file; "" where there was none
    corrects: tuple[str, int] | None = None  # the corrected lesson, and the step from which this one replaces it

    def __post_init__(self) -> None:
        """Check that all arrays have one row per step.

        Raises:
            LearnError: if an array has another number of rows.
        """
        n = len(self.actions)
        rows = {name: len(part) for name, part in self.observations.items()}
        rows |= {name: len(getattr(self, name)) for name in ("by_person", "policy_actions", "shown_ns", "rewards")}
        if self.policy_probabilities is not None:
            rows["policy_probabilities"] = len(self.policy_probabilities)
        for name, count in rows.items():
            if count != n:
                raise LearnError(
                    f"lesson {self.name}: {name} has {count} rows for {n} actions; give one row per action"
                )

    @property
    def is_demonstration(self) -> bool:
        """Whether a person steered the whole episode from its start."""
        return self.corrects is None and bool(self.by_person.all())

    def part(self, first: int, last: int) -> "Lesson":
        """Return a lesson with only the steps from ``first`` to ``last``, inclusive, counted from 0."""
        chosen = slice(first, last + 1)
        probabilities = self.policy_probabilities
        if probabilities is not None:
            probabilities = probabilities[chosen]
        return replace(
            self,
            observations={name: values[chosen] for name, values in self.observations.items()},
            actions=self.actions[chosen],
            by_person=self.by_person[chosen],
            policy_actions=self.policy_actions[chosen],
            shown_ns=self.shown_ns[chosen],
            rewards=self.rewards[chosen],
            policy_probabilities=probabilities,
        )


@dataclass(frozen=True, slots=True)
class LessonRating:
    """A key press that rates the agent as good or bad; learners decide which step it refers to."""

    t_ns: int  # session time of the press
    value: float  # 1 for good, -1 for bad
    lesson: str  # the name of the lesson in progress at the press


@dataclass(frozen=True, slots=True)
class LessonFragment:
    """Consecutive steps of a lesson, from ``first`` to ``last``, inclusive."""

    lesson: str
    first: int
    last: int


@dataclass(frozen=True, slots=True)
class Comparison:
    """Two fragments that were shown side by side, and the person's answer."""

    left: LessonFragment
    right: LessonFragment
    answer: Answer

    def __post_init__(self) -> None:
        """Check the answer.

        Raises:
            LearnError: if the answer is unknown.
        """
        if self.answer not in get_args(Answer):
            raise LearnError(
                f"unknown answer {self.answer!r} to a comparison; use one of {', '.join(get_args(Answer))}"
            )


@dataclass(frozen=True, slots=True)
class Source:
    """A log from which lessons were read."""

    name: str  # "sub-01_ses-01"
    sha256: str  # of the finished file; "" while it is still being written, or where there is none
    lessons: int  # the number of its episodes in the dataset


@dataclass(frozen=True, slots=True, eq=False)
class Dataset:
    """All lessons, ratings and comparisons in one world with the same options."""

    world: str
    options: dict[str, Any]
    action_names: tuple[str, ...]  # by the policy's action number
    most_steps: int  # the largest step limit of an episode
    eyesight: ObservationEncoder
    space: spaces.Dict  # of one step's observation
    lessons: tuple[Lesson, ...] = ()
    ratings: tuple[LessonRating, ...] = ()
    comparisons: tuple[Comparison, ...] = ()
    sources: tuple[Source, ...] = ()
    selection: tuple[str, ...] = field(default=())  # lines that say which episodes are included, and which are not

    def __post_init__(self) -> None:
        """Check that ratings and comparisons refer to existing lessons and steps, and that every action has a name.

        Raises:
            LearnError: if a reference or an action is invalid.
        """
        n_steps = {lesson.name: len(lesson.actions) for lesson in self.lessons}
        for rating in self.ratings:
            _require_lesson(rating, n_steps)
        for comparison in self.comparisons:
            _require_steps(comparison.left, n_steps)
            _require_steps(comparison.right, n_steps)
        self._require_named_actions()

    def _require_named_actions(self) -> None:
        for lesson in self.lessons:
            if len(lesson.actions) and lesson.actions.max() >= len(self.action_names):
                raise LearnError(
                    f"lesson {lesson.name} has action {lesson.actions.max()}; actions must be 0 to "
                    f"{len(self.action_names) - 1}"
                )

    @property
    def steps(self) -> int:
        """The number of steps in all lessons."""
        return sum(len(lesson.actions) for lesson in self.lessons)

    @property
    def labelled_steps(self) -> int:
        """The number of steps in which a person steered."""
        return int(sum(lesson.by_person.sum() for lesson in self.lessons))

    def lesson(self, name: str) -> Lesson:
        """Return the lesson with a name, which must be in the dataset."""
        return next(lesson for lesson in self.lessons if lesson.name == name)

    def with_more(
        self,
        lessons: Sequence[Lesson] = (),
        ratings: Sequence[LessonRating] = (),
        comparisons: Sequence[Comparison] = (),
    ) -> "Dataset":
        """Return the dataset with additional lessons, ratings and comparisons."""
        return replace(
            self,
            lessons=(*self.lessons, *lessons),
            ratings=(*self.ratings, *ratings),
            comparisons=(*self.comparisons, *comparisons),
        )

    def sha256(self) -> str:
        """Return a SHA-256 digest of all data that a learner can use; equal data have equal digests."""
        digest = hashlib.sha256()
        # These texts are the digest's format, which policy files rely on; they have the classes' earlier names.
        settings = self.eyesight
        eyesight = f"Eyesight(missions={settings.missions!r}, scaling={settings.scaling!r}, sight={settings.sight!r})"
        head = (self.world, self.options, self.action_names, self.most_steps, eyesight, repr(self.space))
        digest.update(json.dumps(head, sort_keys=True).encode())
        for lesson in self.lessons:
            facts = (lesson.name, lesson.participant, lesson.seed, lesson.policy, lesson.corrects)
            digest.update(json.dumps(facts).encode())
            parts: dict[str, NDArray[Any]] = {
                **lesson.observations,
                "actions": lesson.actions,
                "by_person": lesson.by_person,
                "policy_actions": lesson.policy_actions,
                "shown_ns": lesson.shown_ns,
                "rewards": lesson.rewards,
            }
            if lesson.policy_probabilities is not None:
                parts["policy_probabilities"] = lesson.policy_probabilities
            for name, values in sorted(parts.items()):
                digest.update(f"{name} {values.dtype} {values.shape}".encode())
                digest.update(np.ascontiguousarray(values).tobytes())
        ratings = (
            f"Rating(t_ns={rating.t_ns!r}, value={rating.value!r}, lesson={rating.lesson!r})" for rating in self.ratings
        )
        comparisons = map(_format_comparison, self.comparisons)
        digest.update(f"({_format_tuple(ratings)}, {_format_tuple(comparisons)})".encode())
        return digest.hexdigest()


def _require_lesson(rating: LessonRating, n_steps: Mapping[str, int]) -> None:
    """Raise LearnError if a rating refers to a lesson that does not exist.

    Args:
        rating: the rating.
        n_steps: the number of steps of each lesson, by name.
    """
    if rating.lesson not in n_steps:
        raise LearnError(f"a rating refers to lesson {rating.lesson!r}, which is not in the dataset; add that lesson")


def _require_steps(fragment: LessonFragment, n_steps: Mapping[str, int]) -> None:
    """Raise LearnError if a fragment has steps that its lesson lacks.

    Args:
        fragment: the fragment.
        n_steps: the number of steps of each lesson, by name.
    """
    n_lesson_steps = n_steps.get(fragment.lesson, 0)
    if not 0 <= fragment.first <= fragment.last < n_lesson_steps:
        raise LearnError(
            f"a comparison refers to {fragment}, but lesson {fragment.lesson!r} has {n_lesson_steps} steps; give steps "
            "that it has"
        )


def _format_comparison(comparison: Comparison) -> str:
    """Return a comparison as text for the dataset's digest."""
    left, right = (
        f"Stretch(lesson={side.lesson!r}, first={side.first!r}, last={side.last!r})"
        for side in (comparison.left, comparison.right)
    )
    return f"Comparison(left={left}, right={right}, answer={comparison.answer!r})"


def _format_tuple(elements: Iterable[str]) -> str:
    """Return texts in the notation of a Python tuple, in which a comma follows a single element."""
    texts = list(elements)
    if len(texts) == 1:
        return f"({texts[0]},)"
    return f"({', '.join(texts)})"
