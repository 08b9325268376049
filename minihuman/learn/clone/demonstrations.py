"""Demonstrations: what people saw and did, replayed from their logs and checked, split by participant."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from minihuman.data.chosen import Chosen, ChosenEpisodes
from minihuman.data.counted import Account
from minihuman.data.selection import Selection
from minihuman.data.study import Sessions
from minihuman.errors import LearnError
from minihuman.learn.agent.observe import Eyesight, Observation
from minihuman.worlds.adapt.world import World


@dataclass(frozen=True, slots=True, eq=False)
class Demonstration:
    """One episode: who played it, ``n`` observations and the ``n`` actions taken on them."""

    participant: str
    player: str
    actions: NDArray[np.int64]  # (n,)
    observations: tuple[Observation, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Demonstrations:
    """All demonstrations of one world, made under one set of options."""

    world: str
    options: dict[str, Any]
    action_names: tuple[str, ...]  # the world's, up to the last that had a key or was a tick's no-op
    most_steps: int  # that anybody was given for an episode
    eyesight: Eyesight
    space: spaces.Dict  # of the observations
    episodes: tuple[Demonstration, ...]
    account: Account  # of the study they were taken from: what counts, what was left out and why

    @property
    def participants(self) -> tuple[str, ...]:
        """Who took part, in the order of the logs."""
        return tuple(dict.fromkeys(episode.participant for episode in self.episodes))

    def by(self, participants: Sequence[str]) -> "Demonstrations":
        """Those of some participants only."""
        return replace(self, episodes=tuple(e for e in self.episodes if e.participant in participants))

    def first(self, count: int) -> "Demonstrations":
        """The first so many, taking turns between participants."""
        queues = [[e for e in self.episodes if e.participant == who] for who in self.participants]
        turns = [queue[turn] for turn in range(max(map(len, queues))) for queue in queues if turn < len(queue)]
        return replace(self, episodes=tuple(turns[:count]))


def read_demonstrations(source: Path, world: str, eyesight: Eyesight, selection: Selection) -> Demonstrations:
    """Replay every episode of a world in a study's logs, checking each observation against the log.

    Raises:
        LearnError: if there is none, they were made under different options, or one does not replay.
    """
    sessions = Sessions(source, selection)
    found = [item for item in ChosenEpisodes(sessions) if item.episode.plan.world == world]
    found = [item for item in found if len(item.episode.actions)]
    if not found:
        told = "; ".join(sessions.account.lines())
        raise LearnError(
            f"{source} has no episode of {world} that counts: {told}; see `minihuman info` for what it has"
        )
    plan = found[0].episode.plan
    if odd := next((item for item in found if item.episode.plan.options != plan.options), None):
        raise LearnError(
            f"{source} has episodes of {world} with options {plan.options} and {odd.episode.plan.options}; "
            "choose one kind with --block"
        )
    names = found[0].episode.start.action_names
    plans = [item.episode.plan for item in found]
    used = {name for its in plans for name in (*its.key_map.keys.values(), *([its.noop] if its.noop else []))}
    kept = names[: 1 + max(names.index(name) for name in used)]
    player = World(plan.world, plan.options)
    player.reset(plan.seed)
    space = eyesight.space(player.unwrapped)
    most_steps = max(its.max_steps for its in plans)
    replayed = tuple(_replay(found, player, eyesight))
    return Demonstrations(world, plan.options, kept, most_steps, eyesight, space, replayed, sessions.account)


def _replay(found: Sequence[Chosen], world: World, eyesight: Eyesight) -> Iterator[Demonstration]:
    looker = eyesight.looker()
    for item in found:
        episode = item.episode
        hashes = [world.reset(episode.plan.seed).observation_hash]
        seen = []
        for action in episode.actions:
            seen.append(looker.see(world.unwrapped, world.observation))
            hashes.append(world.step(int(action)).observation_hash)
        if not np.array_equal(np.array(hashes, dtype=np.uint64), episode.observation_hashes):
            raise LearnError(f"{item.log.path}: {episode.name} does not replay; see `minihuman verify` for where")
        yield Demonstration(item.log.plan.participant.id, item.log.player, episode.actions, tuple(seen))
