"""Simulated participants: the very session that people sit in, with a player at the keys and no time to lose."""

import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from minihuman.lab.next_session import next_session
from minihuman.lab.register import free, require_free_slots
from minihuman.lab.seal import note_end
from minihuman.log.record.gathered import GatheringRecorder
from minihuman.log.record.held import HeldRecorder
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.players.choose import make_player
from minihuman.players.port import Player
from minihuman.seats.agent_seat import agent_seat
from minihuman.seats.machine import machine_facts, world_facts, worlds_of
from minihuman.seats.run import run_session
from minihuman.seats.simulated import SimulatedWindow
from minihuman.study.plan import SessionPlan
from minihuman.study.protocol import Protocol
from minihuman.study.undrawn import session_of
from minihuman.windows.scripted import VirtualClock
from minihuman.worlds.adapt.world import World


def simulate(protocol: Protocol, data: Path, *, participants: int, seed: int, player: str) -> Iterator[Path]:
    """Run simulated participants one after the other, in the next free slots; yield the log of each of their sessions.

    A study of several sessions is played to its end, without the days between; who is screened out does not come back.
    Each has a stream of chance of its own, from ``seed``, its place in the allocation list and who left that before.

    Raises:
        AllocationError: if there are not so many free slots, before anybody plays; or another program took them since.
        LogError: if a log cannot be written.
        PlayerError: if there is no such player, or it cannot play a block's world.
    """
    facts = {"player": player, "player_seed": str(seed), **machine_facts()}
    make_player(player, np.random.default_rng(seed))  # an unknown name must not cost a slot
    require_free_slots(protocol, data / protocol.study.name, participants)
    left = Counter[int]()  # by place: who left no data
    for _ in range(participants):
        plan = next_session(protocol, data)
        place = plan.participant.index
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(place, *filter(None, (left[place],)))))
        somebody = make_player(player, rng)
        log, reason = _play(protocol, plan, somebody, data, facts, before=left[place])
        if log is None:
            free(data / plan.study, plan.participant.id, reason)
            left[place] += 1
        else:
            yield log
        for session in range(2, len(protocol.sessions) + 1):
            if reason != "complete":
                break
            plan = next_session(protocol, data, participant=plan.participant.id, session=session, any_day=True)
            log, reason = _play(protocol, plan, somebody, data, facts)
            if log is not None:
                yield log


def _play(
    protocol: Protocol, plan: SessionPlan, player: Player, data: Path, facts: dict[str, str], *, before: int = 0
) -> tuple[Path | None, str]:
    """The log, None of somebody who was screened out before the group was drawn, and why the session ended."""
    clock = VirtualClock()
    facts = facts | world_facts(worlds_of(plan)) | {"window": "simulated"}
    session = session_of(plan, World, facts, picture_px=None)
    log = HeldRecorder(plan, lambda: McapRecorder(data, session.plan, started_ns=time.time_ns()))
    recorder = GatheringRecorder(log)
    window = SimulatedWindow(player, session, clock, before=before, at_rest=recorder.hand_on)
    path = run_session(session, window, recorder, clock, agent=agent_seat(protocol, plan, data, patient=True))
    if path is not None:
        note_end(path)
    if session.failure is not None:
        raise session.failure
    return path, session.end_reason
