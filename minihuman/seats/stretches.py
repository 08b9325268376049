"""Which stretches of a session's episodes are compared: any as likely as another, never one with itself."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import msgspec

from minihuman.log.read.open_log import open_log
from minihuman.recorded.episode import Episode
from minihuman.study.activities.correction_events import WantsEpisode
from minihuman.study.activities.pair_events import Stretch, WantsStretch
from minihuman.study.chance import words

_Place = tuple[Episode, int]  # the episode, and the step whose picture is the first


class Stretches:
    """Draws from the episodes of a block, as the session's log has them.

    Args:
        logs: the session's logs so far.
        seed: of the study.
        index: of the participant.
    """

    def __init__(self, logs: Callable[[], list[Path]], *, seed: int, index: int) -> None:
        self._logs = logs
        self._seed = seed
        self._index = index
        self._part: int | None = None
        self._places: list[_Place] = []  # of that part; nothing is played while it compares

    def candidates(self, want: WantsStretch, count: int) -> list[tuple[Stretch, Stretch]]:
        """So many pairs of two that differ, the first one drawn as ever; none where there are no two."""
        found = []
        for number in range(count):
            first = self.draw(replace(want, place=0, again=None), candidate=number)
            other = None if first is None else self.draw(replace(want, place=1, again=first), candidate=number)
            if first is not None and other is not None:
                found.append((first, other))
        return found

    def draw(self, want: WantsStretch, *, candidate: int = 0) -> Stretch | None:
        """A stretch; None where there are no two. Every candidate's draw is one of its own."""
        if self._part != want.part:
            self._part, self._places = want.part, self._found(want)
        purpose = f"stretch-{want.source}-part-{want.part}-pair-{want.pair}-{want.place}"
        purpose += f"-candidate-{candidate}" if candidate else ""
        left = [place for place in self._places if _stretch(place, want.steps) != want.again]
        if len(self._places) < 2 or not left:
            return None
        word = int(words(1, seed=self._seed, purpose=purpose, index=self._index)[0])
        return _stretch(left[word % len(left)], want.steps)

    def episode(self, want: WantsEpisode) -> Stretch | None:
        """One of the block's latest episodes, all of it; None where there is no further one."""
        if self._part != want.part:
            self._part, self._places = want.part, [(episode, 0) for episode in self._episodes(want.source)]
        latest = self._places[-want.count :]
        if want.number >= len(latest):
            return None
        episode, _ = latest[want.number]
        return _stretch((episode, 0), len(episode.actions))

    def _episodes(self, block: str) -> list[Episode]:
        logs = self._logs()
        if not logs:
            return []
        played = open_log(logs[0].parent).episodes
        return [episode for episode in played if episode.plan.block_name == block and len(episode.actions)]

    def _found(self, want: WantsStretch) -> list[_Place]:
        return [
            (episode, first)
            for episode in self._episodes(want.source)
            for first in range(max(1, len(episode.actions) - want.steps + 1))
        ]


def _stretch(place: _Place, steps: int) -> Stretch:
    episode, first = place
    plan = episode.plan
    return Stretch(
        episode=plan.episode,
        attempt=episode.attempt,
        first=first,
        world=plan.world,
        options=msgspec.json.encode(plan.options).decode(),
        seed=plan.seed,
        actions=tuple(int(action) for action in episode.actions[: first + steps]),
    )
