"""What was observed in an episode: played again from seed and actions, or as the log holds it; each hash is checked."""

import copy
import logging
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

from minihuman import __version__
from minihuman.data.chosen import Chosen
from minihuman.errors import ExportError, LogError, WorldError
from minihuman.log.observations import checked
from minihuman.recorded.episode import Episode
from minihuman.study.again import same_pictures
from minihuman.worlds.adapt.world import Observed, Transition, World
from minihuman.worlds.trust import trusting

LOG = logging.getLogger("minihuman")


@dataclass(frozen=True, slots=True, eq=False)
class Demonstration:
    """An episode with what was observed: ``n + 1`` observations for ``n`` actions, each equal to the one played.

    Of a first-person episode that an earlier version drew, each state is equal, and the pictures are this version's.
    """

    episode: Episode
    observations: tuple[Any, ...]
    observation_space: gymnasium.Space[Any]
    action_space: gymnasium.spaces.Discrete

    @property
    def actions(self) -> NDArray[np.int64]:
        """The ``n`` actions as the environment's ``step`` takes them: counted from where its action space starts."""
        return self.episode.actions + int(self.action_space.start)


class Resimulator:
    """Gives episodes their observations, keeping the world of the last one for the next."""

    def __init__(self) -> None:
        self._world: World | None = None
        self._made_from: tuple[str, dict[str, Any]] | None = None

    def __call__(self, chosen: Chosen) -> Demonstration:
        """Play an episode again, or take what its log holds if that was chosen. Spaces are the world's as it is here.

        Raises:
            ExportError: if the world cannot be made here or answers differently than when it was played; or if the
                log holds no observations, or others than were made.
        """
        world = self._world_of(chosen.episode, chosen)
        observations = _stored(chosen) if chosen.stored_frames else _played(chosen, world)
        return Demonstration(chosen.episode, observations, world.observation_space, world.action_space)

    def _world_of(self, episode: Episode, chosen: Chosen) -> World:
        made_from = (episode.plan.world, episode.plan.options)
        if self._world is None or self._made_from != made_from:
            try:
                self._world, self._made_from = trusting()(*made_from), made_from
            except WorldError as error:
                raise ExportError(f"{chosen.log.path}: {episode.name}: {error}") from error
        return self._world


def _played(chosen: Chosen, world: World) -> tuple[Any, ...]:
    episode = chosen.episode
    drawn_anew = world.drawn and not all(same_pictures(segment.facts) for segment in chosen.log.segments)
    if drawn_anew:
        LOG.warning(
            "%s: %s: its pictures are drawn by this version; the participant saw those of an earlier one",
            chosen.log.path,
            episode.name,
        )
    _check(world, world.reset(episode.plan.seed), 0, chosen, drawn_anew=drawn_anew)
    observations = [copy.deepcopy(world.observation)]  # as a world may use its arrays again
    for step, action in enumerate(episode.actions, 1):
        _check(world, world.step(int(action)), step, chosen, drawn_anew=drawn_anew)
        observations.append(copy.deepcopy(world.observation))
    return tuple(observations)


def _check(world: World, now: Observed | Transition, step: int, chosen: Chosen, *, drawn_anew: bool) -> None:
    episode = chosen.episode
    if drawn_anew:
        same = world.state_hash() == int(episode.state_hashes[step])
    else:
        same = now.observation_hash == int(episode.observation_hashes[step])
    if not same:
        played = chosen.log.facts.get("minihuman", "an unknown version")
        instead = "" if episode.observations is None else ", or take those in the log: --stored-frames"
        raise ExportError(
            f"{chosen.log.path}: {episode.name} step {step}: the observation differs from "
            f"the one played under minihuman {played} (this is {__version__}); export with that version{instead}"
        )


def _stored(chosen: Chosen) -> tuple[Any, ...]:
    episode = chosen.episode
    if episode.observations is None:
        raise ExportError(
            f"{chosen.log.path}: {episode.name} has no stored observations (its block did not say "
            "record_observations = true); export without --stored-frames"
        )
    try:
        return tuple(checked(episode.observations, episode.observation_hashes, episode.plan.episode))
    except LogError as error:
        raise ExportError(f"{chosen.log.path}: {error}") from error
