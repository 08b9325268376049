"""Simulated participants: the very session that people sit in, with a player at the keys and no time to lose."""

import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from minihuman.lab.next_session import next_session
from minihuman.lab.seal import note_end
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.players.choose import make_player
from minihuman.players.port import Player
from minihuman.seats.machine import machine_facts, world_facts
from minihuman.seats.run import run_session
from minihuman.seats.simulated import SimulatedWindow
from minihuman.study.plan import SessionPlan
from minihuman.study.protocol import Protocol
from minihuman.study.session import Session
from minihuman.windows.scripted import VirtualClock
from minihuman.worlds.adapt.world import World


def simulate(protocol: Protocol, data: Path, *, participants: int, seed: int, player: str) -> Iterator[Path]:
    """Run simulated participants one after the other, in the next free slots; yield the log of each of their sessions.

    A study of several sessions is played to its end, without the days between; who is screened out does not come back.
    Each has a stream of chance of its own, from ``seed`` and its place in the allocation list.

    Raises:
        AllocationError: if there are not so many free slots.
        LogError: if a log cannot be written.
        PlayerError: if there is no such player, or it cannot play a block's world.
    """
    facts = {"player": player, "player_seed": str(seed), **machine_facts()}
    make_player(player, np.random.default_rng(seed))  # an unknown name must not cost a slot
    for _ in range(participants):
        plan = next_session(protocol, data)
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(plan.participant.index,)))
        somebody = make_player(player, rng)
        log, reason = _play(plan, somebody, data, facts)
        yield log
        for session in range(2, len(protocol.sessions) + 1):
            if reason != "complete":
                break
            plan = next_session(protocol, data, participant=plan.participant.id, session=session, any_day=True)
            log, reason = _play(plan, somebody, data, facts)
            yield log


def _play(plan: SessionPlan, player: Player, data: Path, facts: dict[str, str]) -> tuple[Path, str]:
    """The log, and why the session ended."""
    clock = VirtualClock()
    facts = facts | world_facts(episode.world for episode in plan.episodes) | {"window": "simulated"}
    session = Session(plan, World, facts, picture_px=None)
    recorder = McapRecorder(data, plan, started_ns=time.time_ns())
    window = SimulatedWindow(player, session, clock, at_rest=recorder.drain)
    path = run_session(session, window, recorder, clock)
    assert path is not None
    note_end(path)
    if session.failure is not None:
        raise session.failure
    return path, session.end_reason
