"""Observations from a log that holds none: play it again from seed and actions, checking every hash."""

from dataclasses import dataclass
from typing import Any

import gymnasium

from minihuman import __version__
from minihuman.errors import ExportError, WorldError
from minihuman.export.port import Chosen
from minihuman.log.episode import Episode
from minihuman.worlds.adapt import World


@dataclass(frozen=True, slots=True, eq=False)
class Demonstration:
    """An episode with what was observed: ``n + 1`` observations for ``n`` actions, each equal to the one played."""

    episode: Episode
    observations: tuple[Any, ...]
    observation_space: gymnasium.Space[Any]
    action_space: gymnasium.spaces.Discrete


class Resimulator:
    """Replays episodes, keeping the world of the last one for the next."""

    def __init__(self) -> None:
        self._world: World | None = None
        self._made_from: tuple[str, dict[str, Any]] | None = None

    def __call__(self, chosen: Chosen) -> Demonstration:
        """Play an episode again.

        Raises:
            ExportError: if the world cannot be made here or answers differently than when it was played.
        """
        episode = chosen.episode
        world = self._world_of(episode, chosen)
        observed = world.reset(episode.plan.seed)
        self._check(observed.observation_hash, 0, chosen)
        observations = [world.observation]
        for step, action in enumerate(episode.actions, 1):
            self._check(world.step(int(action)).observation_hash, step, chosen)
            observations.append(world.observation)
        return Demonstration(episode, tuple(observations), world.observation_space, world.action_space)

    def _world_of(self, episode: Episode, chosen: Chosen) -> World:
        made_from = (episode.plan.world, episode.plan.options)
        if self._world is None or self._made_from != made_from:
            try:
                self._world, self._made_from = World(*made_from), made_from
            except WorldError as error:
                raise ExportError(f"{chosen.log.path}: episode {episode.plan.episode}: {error}") from error
        return self._world

    def _check(self, observation_hash: int, step: int, chosen: Chosen) -> None:
        if observation_hash != int(chosen.episode.observation_hashes[step]):
            played = chosen.log.facts.get("minihuman", "an unknown version")
            raise ExportError(
                f"{chosen.log.path}: episode {chosen.episode.plan.episode} step {step}: the observation differs from "
                f"the one played under minihuman {played} (this is {__version__}); export with that version"
            )
