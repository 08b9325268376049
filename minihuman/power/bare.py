"""A player at a plan's episodes with no session round it and no log: as they would be played, some ten times sooner."""

from collections.abc import Sequence
from contextlib import closing

import numpy as np

from minihuman.players.port import Player
from minihuman.power.traces import Trace
from minihuman.study.plan import EpisodePlan, SessionPlan
from minihuman.study.protocol import Protocol
from minihuman.worlds.adapt.world import World

_PRESSES = 20  # a step of the limit: more of them mean that somebody will never find the keys


def all_playable(protocol: Protocol) -> bool:
    """Whether all that is played in a study can be played so: one session, at people's own pace, nobody else acting."""
    return len(protocol.sessions) <= 1 and all(
        block.kind == "play"
        and block.pace == "on_key"
        and not (block.until or block.auto_repeat or block.max_s or block.block_max_s)
        for block in protocol.blocks
    )


def playable(plan: SessionPlan) -> tuple[EpisodePlan, ...]:
    """The episodes that a press moves on, without a clock."""
    return tuple(episode for episode in plan.episodes if episode.pace == "on_key")


def play_bare(plan: SessionPlan, player: Player, worlds: dict[int, World]) -> tuple[Trace, ...]:
    """Play a plan's episodes; ``worlds`` are kept from call to call, one a block."""
    traces = []
    for episode in playable(plan):
        if episode.block not in worlds:
            worlds[episode.block] = World(episode.world, episode.options)
        traces.append(_play(episode, plan.key_pool, player, worlds[episode.block]))
    return tuple(traces)


def best_ways(episodes: Sequence[EpisodePlan]) -> list[int | None]:
    """How many steps the best way takes that is known, of each episode."""
    found = list[int | None]()
    for episode in episodes:
        with closing(World(episode.world, episode.options)) as world:
            world.reset(episode.seed)
            found.append(world.bounds().feasible)
    return found


def _play(plan: EpisodePlan, pool: tuple[str, ...], player: Player, world: World) -> Trace:
    seen = world.reset(plan.seed).observation_hash
    best = world.bounds().feasible
    player.begin(plan, pool, world)
    actions, shown, t_s = list[str](), list[bool](), list[float]()
    poses = list[tuple[float, float, float]]()
    at_s, steps, reward, outcome = 0.0, 0, 0.0, "timeout"
    while steps < plan.max_steps and len(actions) < _PRESSES * plan.max_steps:
        press = player.press(world)
        at_s += press.delay_ms / 1000
        action = plan.key_map.keys.get(press.key, "")
        ended, changed = False, False
        if action:
            made = world.step(world.action_names.index(action))
            steps, reward = steps + 1, reward + made.reward
            changed, seen = made.observation_hash != seen, made.observation_hash
            ended = made.terminated
            if ended:
                outcome = "goal" if made.reward > 0 else "failure"
        pose = world.pose()
        actions.append(action)
        shown.append(changed)
        poses.append((np.nan, np.nan, np.nan) if pose is None else (pose.x, pose.z, pose.yaw_rad))
        t_s.append(at_s)
        if ended:
            break
    where = np.array(poses, float).reshape(-1, 3)
    how = (tuple(actions), np.array(shown, bool), where, np.array(t_s))
    return Trace(plan.block, *how, outcome, reward, steps, best, plan.max_steps)
