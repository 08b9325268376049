"""Episodes really played in a world, as a log gives them back: the source of every export test."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import msgspec
import numpy as np

from minihuman.dataset.included_episodes import IncludedEpisode
from minihuman.log.model.session_log import EpisodeLog, SessionLog
from minihuman.worlds.adapters.world import World
from tests.builders import made, plan, session_of


def played(world_id: str, *, number: int = 0, seed: int = 0, steps: int = 12, rng_seed: int = 5) -> EpisodeLog:
    """An episode of random moves, its rewards, flags and hashes the world's own."""
    its_plan = msgspec.structs.replace(plan(number, kind="grid"), world=world_id, options={}, seed=seed)
    world = World(world_id)
    rng = np.random.default_rng([rng_seed, number])
    observed = world.reset(seed)
    seen, poses, actions, rewards, flags = [observed.observation_hash], [world.pose()], [], [], []
    for _ in range(steps):
        action = int(rng.integers(3))
        change = world.step(action)
        actions.append(action)
        rewards.append(change.reward)
        flags.append((change.terminated, change.truncated))
        seen.append(change.observation_hash)
        poses.append(world.pose())
        if change.terminated or change.truncated:
            break
    rows = [(p.x, p.y, p.z, p.yaw_rad) if p else (np.nan,) * 4 for p in poses]
    episode = made(its_plan, rows, actions, None, outcome="goal" if flags[-1][0] else "abandoned", seen=seen)
    return dataclasses.replace(
        episode,
        rewards=np.array(rewards),
        terminated=np.array([flag[0] for flag in flags]),
        truncated=np.array([flag[1] for flag in flags]),
    )


def chosen(episodes: Sequence[EpisodeLog], **session: str) -> list[IncludedEpisode]:
    """The episodes as one session's, chosen for export."""
    log: SessionLog = session_of(episodes, path=Path("sub-01_ses-01.mcap"), **session)
    return [IncludedEpisode(log, episode) for episode in log.episodes]
