"""Curricula: rules that choose the level, a world and a seed, of each episode of a training run.

`uniform` draws all worlds and seeds with the same probability; `staged` goes on to the next world when the present one
is solved; `plr` replays the levels from which there is most to learn (Jiang, Grefenstette and Rocktäschel, "Prioritized
Level Replay", 2021).
"""

import abc
from collections import deque
from typing import Any, ClassVar

import numpy as np

from minihuman.errors import LearnError
from minihuman.learn.training_settings import TrainingSettings
from minihuman.learn.training_worlds import TrainingLevel
from minihuman.worlds.hashing import hash64

_LEVELS_STREAM = 0x1EEE15  # makes this generator independent of others with the same seed


class Curriculum(abc.ABC):
    """A rule that chooses the levels of a training run, with a separate random generator.

    Args:
        n_worlds: the number of worlds to train in.
        settings: the settings of the training run.
        seed: the seed of the training run.
    """

    needs_scores: ClassVar[bool] = False  # whether `score` must be called

    def __init__(self, n_worlds: int, settings: TrainingSettings, seed: int) -> None:
        self._n_worlds = n_worlds
        self._settings = settings
        self._seed = seed
        self._rng = np.random.default_rng(np.random.SeedSequence([seed, _LEVELS_STREAM]))

    @abc.abstractmethod
    def draw(self) -> TrainingLevel:
        """Return the level of the next episode."""

    def finish(self, level: TrainingLevel, has_succeeded: bool) -> None:  # noqa: B027  # most have nothing to do
        """Record that an episode of a level ended, and whether it succeeded."""

    def score(self, level: TrainingLevel, score: float) -> None:  # noqa: B027
        """Record a level's score, the mean absolute advantage over an episode, or over its part in one rollout."""

    def save(self) -> dict[str, Any]:
        """Return the curriculum's state in plain values, for ``restore``."""
        return {"rng": self._rng.bit_generator.state}

    def restore(self, saved: dict[str, Any]) -> None:
        """Restore the state that ``save`` returned."""
        self._rng.bit_generator.state = saved["rng"]

    def describe(self) -> str:
        """Describe the curriculum's progress in a few words; "" if it has none."""
        return ""

    def _draw_new(self, world: int) -> TrainingLevel:
        """Return a level of the world with a number, with a drawn seed.

        If the setting ``levels`` is not 0, the seed is one of that many seeds, and otherwise any below 2**31.
        """
        if not self._settings.levels:
            return TrainingLevel(world, int(self._rng.integers(2**31)))
        number = int(self._rng.integers(self._settings.levels))
        return TrainingLevel(world, hash64((self._seed, "level", number)) % 2**31)  # a reset seed has 31 bits


class UniformCurriculum(Curriculum):
    """Draw each world and each seed with the same chance."""

    def draw(self) -> TrainingLevel:
        """Return the level of the next episode."""
        return self._draw_new(int(self._rng.integers(self._n_worlds)))


class StagedCurriculum(Curriculum):
    """Train in one world after the other, in the order in which they are named."""

    def __init__(self, n_worlds: int, settings: TrainingSettings, seed: int) -> None:
        super().__init__(n_worlds, settings, seed)
        self._stage = 0
        self._latest: deque[bool] = deque(maxlen=settings.stage_episodes)

    def draw(self) -> TrainingLevel:
        """Return the level of the next episode."""
        return self._draw_new(self._stage)

    def finish(self, level: TrainingLevel, has_succeeded: bool) -> None:
        """Go on to the next world if enough of the latest episodes in the present one succeeded."""
        if level.world != self._stage:
            return
        self._latest.append(has_succeeded)
        is_full = len(self._latest) == self._settings.stage_episodes
        if is_full and np.mean(self._latest) >= self._settings.stage_success and self._stage + 1 < self._n_worlds:
            self._stage += 1
            self._latest.clear()

    def save(self) -> dict[str, Any]:
        """Return the curriculum's state in plain values, for ``restore``."""
        return {**super().save(), "stage": self._stage, "latest": list(self._latest)}

    def restore(self, saved: dict[str, Any]) -> None:
        """Restore the state that ``save`` returned."""
        super().restore(saved)
        self._stage = saved["stage"]
        self._latest.clear()
        self._latest.extend(saved["latest"])

    def describe(self) -> str:
        """Return the number of the present world, such as "stage 1 of 3"."""
        return f"stage {self._stage + 1} of {self._n_worlds}"


class PrioritizedLevelReplay(Curriculum):
    """Play levels again by the rank of their scores and by how long ago they were played.

    A score is the mean size of the generalised advantage estimates of the level's latest episode, the paper's L1 value
    loss. A level is played again with the probability ``replay``; else one is drawn as in the uniform curriculum.
    """

    needs_scores = True

    def __init__(self, n_worlds: int, settings: TrainingSettings, seed: int) -> None:
        super().__init__(n_worlds, settings, seed)
        self._scores: dict[TrainingLevel, float] = {}
        self._played_at: dict[TrainingLevel, int] = {}  # the count of episodes when a level was drawn last
        self._episodes = 0

    def draw(self) -> TrainingLevel:
        """Return the level of the next episode."""
        self._episodes += 1
        is_replay = bool(self._scores) and self._rng.random() < self._settings.replay
        if is_replay:
            level = self._draw_scored()
        else:
            level = self._draw_new(int(self._rng.integers(self._n_worlds)))
        if level in self._scores:
            self._played_at[level] = self._episodes
        return level

    def score(self, level: TrainingLevel, score: float) -> None:
        """Remember a level's latest score; if too many levels are remembered, forget the one with the lowest score."""
        self._scores[level] = score
        self._played_at.setdefault(level, self._episodes)
        if len(self._scores) > self._settings.replay_levels:
            easiest = min(self._scores, key=self._scores.__getitem__)
            del self._scores[easiest]
            del self._played_at[easiest]

    def save(self) -> dict[str, Any]:
        """Return the curriculum's state in plain values, for ``restore``."""
        remembered = [(*level, score, self._played_at[level]) for level, score in self._scores.items()]
        return {**super().save(), "remembered": remembered, "episodes": self._episodes}

    def restore(self, saved: dict[str, Any]) -> None:
        """Restore the state that ``save`` returned."""
        super().restore(saved)
        self._scores = {TrainingLevel(world, seed): score for world, seed, score, _ in saved["remembered"]}
        self._played_at = {TrainingLevel(world, seed): episode for world, seed, _, episode in saved["remembered"]}
        self._episodes = saved["episodes"]

    def describe(self) -> str:
        """Return the number of levels that can be played again, such as "40 levels to replay"."""
        return f"{len(self._scores)} levels to replay"

    def _draw_scored(self) -> TrainingLevel:
        """Draw a remembered level by the rank of its score and, with the weight ``staleness``, by its age."""
        levels = list(self._scores)
        order = np.argsort([-self._scores[level] for level in levels], kind="stable")
        ranks = np.argsort(order, kind="stable") + 1  # 1 for the highest score
        score_weights = (1.0 / ranks) ** (1 / self._settings.temperature)
        ages = np.array([self._episodes - self._played_at[level] for level in levels], np.float64)
        probabilities = score_weights / score_weights.sum()
        if ages.sum() > 0:
            staleness = self._settings.staleness
            probabilities = (1 - staleness) * probabilities + staleness * ages / ages.sum()
        return levels[int(self._rng.choice(len(levels), p=probabilities / probabilities.sum()))]


_CURRICULA: dict[str, type[Curriculum]] = {
    "uniform": UniformCurriculum,
    "staged": StagedCurriculum,
    "plr": PrioritizedLevelReplay,
}


def make_curriculum(n_worlds: int, settings: TrainingSettings, seed: int) -> Curriculum:
    """Make the curriculum that the settings name, for a number of worlds and the training run's seed.

    Raises:
        LearnError: if the curriculum is "staged" and there is only one world.
    """
    if settings.curriculum == "staged" and n_worlds < 2:
        raise LearnError("a staged curriculum goes from world to world; name two or more worlds, the easiest first")
    return _CURRICULA[settings.curriculum](n_worlds, settings, seed)
