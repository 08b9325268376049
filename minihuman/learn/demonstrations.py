"""Demonstrations: the observations and actions of people, replayed from logs and compared with them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import chain, zip_longest
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium import spaces
from msgspec import structs
from numpy.typing import NDArray

from minihuman.dataset.included_episodes import IncludedEpisodes
from minihuman.dataset.selection import Selection, SelectionSummary
from minihuman.dataset.sessions import StudySessions
from minihuman.errors import LearnError
from minihuman.experiment.plan.session_plan import EpisodePlan
from minihuman.learn.policy.observation import EpisodeEncoder, Observation, ObservationEncoder
from minihuman.log.model.session_log import EpisodeLog, SessionLog
from minihuman.worlds.adapters.world import World


@dataclass(frozen=True, slots=True, eq=False)
class Demonstration:
    """One episode of a participant: ``n`` observations and the ``n`` actions that followed them.

    In a team, a demonstration has only the steps whose action the participant chose: not those of a program that took
    the seat, nor those of ticks at which the participant's action came too late.
    """

    participant: str
    player: str
    actions: NDArray[np.int64]  # (n,)
    observations: tuple[Observation, ...]
    team: str = ""  # the team whose episode it was; "" if one participant played alone


@dataclass(frozen=True, slots=True, eq=False)
class Demonstrations:
    """All demonstrations in one world with the same options."""

    world: str
    options: dict[str, Any]
    action_names: tuple[str, ...]  # the world's, up to the last one that had a key or was the no-op of a tick
    most_steps: int  # the largest step limit of an episode
    eyesight: ObservationEncoder
    space: spaces.Dict  # of the observations
    episodes: tuple[Demonstration, ...]
    account: SelectionSummary  # of the study's included and excluded episodes

    @property
    def participants(self) -> tuple[str, ...]:
        """The participants who gave demonstrations, in the order of their logs."""
        return tuple(dict.fromkeys(episode.participant for episode in self.episodes))

    def by(self, participants: Sequence[str]) -> "Demonstrations":
        """Return a copy with only the demonstrations of the given participants."""
        return replace(
            self, episodes=tuple(episode for episode in self.episodes if episode.participant in participants)
        )

    def first(self, count: int) -> "Demonstrations":
        """Return a copy with ``count`` demonstrations: the first of each participant, then each second, and so on."""
        queues: dict[str, list[Demonstration]] = {participant: [] for participant in self.participants}
        for episode in self.episodes:
            queues[episode.participant].append(episode)
        in_turn = chain.from_iterable(zip_longest(*queues.values()))
        episodes = [episode for episode in in_turn if episode is not None]
        return replace(self, episodes=tuple(episodes[:count]))


LoggedEpisode = tuple[SessionLog, EpisodeLog]


def replay_demonstration(log: SessionLog, episode: EpisodeLog, world: World, encoder: EpisodeEncoder) -> Demonstration:
    """Replay an episode and return it as a demonstration.

    Args:
        log: the log of the session.
        episode: the episode.
        world: a world of the episode's id and options.
        encoder: encodes the world's observations.

    Raises:
        LearnError: if the world's observations differ from those in the log.
    """
    observations = tuple(replay_observations(log, episode, world, encoder))
    team = episode.team
    steps = list(range(len(observations)))
    if team is not None:
        steps = [step for step in steps if team.sources[step][team.seat] == "person"]
    return Demonstration(
        participant=log.plan.participant.id,
        player=log.player,
        actions=episode.actions[np.array(steps, np.int64)],
        observations=tuple(observations[step] for step in steps),
        team="" if team is None else team.team,
    )


def read_demonstrations(source: Path, world: str, eyesight: ObservationEncoder, selection: Selection) -> Demonstrations:
    """Replay every included episode of a world in a study's logs, checking each observation against the log.

    Args:
        source: a study's folder, or a log.
        world: the world's Gymnasium id.
        eyesight: the settings by which observations are encoded.
        selection: the rule for which sessions and episodes are included.

    Raises:
        LearnError: if there is no such episode, episodes have different options, or an episode does not replay.
    """
    episodes, account = select_episodes(source, world, selection)
    plan = get_shared_plan(episodes)
    replay_world = World(plan.world, plan.options)
    replay_world.reset(plan.seed)
    encoder = eyesight.episode_encoder()
    replayed = [replay_demonstration(log, episode, replay_world, encoder) for log, episode in episodes]
    return Demonstrations(
        world=world,
        options=plan.options,
        action_names=list_used_actions(episodes),
        most_steps=max(episode.plan.max_steps for _, episode in episodes),
        eyesight=eyesight,
        space=eyesight.space(replay_world.unwrapped),
        episodes=tuple(demonstration for demonstration in replayed if len(demonstration.actions)),
        account=account,
    )


def select_episodes(source: Path, world: str, selection: Selection) -> tuple[list[LoggedEpisode], SelectionSummary]:
    """Return the included episodes of a world that have at least one step, with a summary of the selection.

    Args:
        source: a study's folder, or a log.
        world: the world's Gymnasium id.
        selection: the rule for which sessions and episodes are included.

    Raises:
        LearnError: if there is no such episode.
    """
    sessions = StudySessions(source, selection)
    episodes = [
        (included.log, included.episode)
        for included in IncludedEpisodes(sessions)
        if included.episode.plan.world == world and len(included.episode.actions)
    ]
    if not episodes:
        summary = "; ".join(sessions.account.lines())
        raise LearnError(
            f"{source} has no included episode of {world} ({summary}); see its episodes with `minihuman info`"
        )
    return episodes, sessions.account


def get_shared_plan(episodes: Sequence[LoggedEpisode]) -> EpisodePlan:
    """Return the plan of the first episode, with the world's options that all the episodes share.

    For a team, the options of the plan do not include the seat.

    Raises:
        LearnError: if the options of two episodes differ.
    """
    log, first = episodes[0]
    for _, episode in episodes:
        if episode.shared_options != first.shared_options:
            raise LearnError(
                f"{log.path}: {first.plan.world} has options {first.shared_options} in some episodes and "
                f"{episode.shared_options} in others; select episodes with the same options by --block"
            )
    return structs.replace(first.plan, options=first.shared_options)


def list_used_actions(episodes: Sequence[LoggedEpisode], least: int = 0) -> tuple[str, ...]:
    """Return the names of the world's actions up to the last one that is used.

    An action is used if a key is assigned to it, or if it is the no-op of a tick.

    Args:
        episodes: the episodes, all in worlds with the same actions.
        least: the number of an action, from 0, up to which all names are returned in any case.
    """
    names = episodes[0][1].start.action_names
    used: set[str] = set()
    for _, episode in episodes:
        used.update(episode.plan.key_map.keys.values())
        if episode.plan.noop:
            used.add(episode.plan.noop)
    return names[: 1 + max(least, *map(names.index, used))]


def replay_observations(
    log: SessionLog, episode: EpisodeLog, world: World, encoder: EpisodeEncoder
) -> Iterator[Observation]:
    """Replay an episode and yield the encoded observation before each step.

    Raises:
        LearnError: if the world's observations differ from those in the log.
    """
    if episode.team is not None:
        world.unwrapped.seat = episode.team.seat
        world.unwrapped.script = episode.team.actions.tolist()
    hashes = [world.reset(episode.plan.seed).observation_hash]
    for action in episode.actions:
        yield encoder.encode(world.unwrapped, world.observation)
        hashes.append(world.step(int(action)).observation_hash)
    if not np.array_equal(np.array(hashes, dtype=np.uint64), episode.observation_hashes):
        raise LearnError(
            f"{log.path}: {episode.name} does not replay as recorded; run `minihuman verify` to see where it differs"
        )
