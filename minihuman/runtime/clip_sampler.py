"""Draws clips to compare and to correct, uniformly from a session's episodes; no clip is compared with itself."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import msgspec

from minihuman.activities.clip_requests import ClipRequest, EpisodeRequest
from minihuman.activities.episode_clips import EpisodeClip
from minihuman.experiment.plan.random_streams import draw_words
from minihuman.log.model.session_log import EpisodeLog
from minihuman.log.read.session_reader import read_log

_ClipStart = tuple[EpisodeLog, int]  # the episode, and the step whose picture is the first


class ClipSampler:
    """Draws clips from the episodes of a block, as the session's log has them.

    Args:
        logs: returns the session's logs so far.
        seed: the study's seed.
        index: the participant's index.
    """

    def __init__(self, logs: Callable[[], list[Path]], *, seed: int, index: int) -> None:
        self._logs = logs
        self._seed = seed
        self._index = index
        self._part: int | None = None
        self._starts: list[_ClipStart] = []  # of the clips to draw from in that part, during which no episode is added

    def draw_pairs(self, want: ClipRequest, count: int) -> list[tuple[EpisodeClip, EpisodeClip]]:
        """Draw ``count`` pairs of different clips; the list is empty if no two clips differ."""
        pairs = []
        for number in range(count):
            first = self.draw(replace(want, place=0, again=None), candidate=number)
            if first is None:
                continue
            second = self.draw(replace(want, place=1, again=first), candidate=number)
            if second is not None:
                pairs.append((first, second))
        return pairs

    def draw(self, want: ClipRequest, *, candidate: int = 0) -> EpisodeClip | None:
        """Draw a clip other than ``want.again``; return None if no two clips differ.

        Each ``candidate``, the number of a pair among those from which a learner chooses, has a separate random stream.
        """
        if self._part != want.part:
            self._part = want.part
            self._starts = self._list_starts(want)
        purpose = f"stretch-{want.source}-part-{want.part}-pair-{want.pair}-{want.place}"
        if candidate:
            purpose += f"-candidate-{candidate}"
        other_starts = [start for start in self._starts if _make_clip(start, want.steps) != want.again]
        if len(self._starts) < 2 or not other_starts:
            return None
        word = int(draw_words(1, seed=self._seed, purpose=purpose, index=self._index)[0])
        return _make_clip(other_starts[word % len(other_starts)], want.steps)

    def episode(self, want: EpisodeRequest) -> EpisodeClip | None:
        """Return number ``want.number``, from 0, of the block's latest ``want.count`` episodes as a clip, else None."""
        if self._part != want.part:
            self._part = want.part
            self._starts = [(episode, 0) for episode in self._list_episodes(want.source)]
        latest = self._starts[-want.count :]
        if want.number >= len(latest):
            return None
        episode, _ = latest[want.number]
        return _make_clip((episode, 0), len(episode.actions))

    def _list_episodes(self, block: str) -> list[EpisodeLog]:
        """Return the session's episodes of a block that have a step."""
        logs = self._logs()
        if not logs:
            return []
        played = read_log(logs[0].parent).episodes
        return [episode for episode in played if episode.plan.block_name == block and len(episode.actions)]

    def _list_starts(self, want: ClipRequest) -> list[_ClipStart]:
        """Return the start of every clip of the requested length; a shorter episode has one, at its first step."""
        return [
            (episode, first)
            for episode in self._list_episodes(want.source)
            for first in range(max(1, len(episode.actions) - want.steps + 1))
        ]


def _make_clip(start: _ClipStart, steps: int) -> EpisodeClip:
    """Return the clip of ``steps`` steps from a start, with the episode's actions up to the clip's end."""
    episode, first = start
    plan = episode.plan
    return EpisodeClip(
        episode=plan.episode,
        attempt=episode.attempt,
        first=first,
        world=plan.world,
        options=msgspec.json.encode(plan.options).decode(),
        seed=plan.seed,
        actions=tuple(int(action) for action in episode.actions[: first + steps]),
    )
