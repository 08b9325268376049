"""Simulated sessions: the same sessions as a participant's, with a simulated player in a virtual window.

The clock is virtual and no picture is drawn, so that a session takes only as long as its computation.
"""

import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from minihuman.admin.enrolment_entries import ParticipantReplaced
from minihuman.admin.enrolment_log import free_slot, record_departure, require_free_slots
from minihuman.admin.manifest import record_log_end
from minihuman.admin.next_session import plan_next_session
from minihuman.display.windows.window import VirtualClock
from minihuman.errors import MinihumanError, PlayerFailedError
from minihuman.experiment.machine.activity import WorldFactory, find_kind
from minihuman.experiment.pending_session import build_session
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.plan.session_plan import EpisodePlan, SessionPlan
from minihuman.experiment.protocol.protocol import Protocol
from minihuman.log.paths import SegmentPath
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.log.record.recorder import BufferedRecorder, DeferredRecorder
from minihuman.moved import forward_names
from minihuman.plugins import limit_answer_time
from minihuman.runtime.agent_host import make_agent_host
from minihuman.runtime.machine import collect_machine_facts, collect_world_facts, list_world_ids
from minihuman.runtime.session_loop import describe_world_failure, run_session
from minihuman.runtime.simulated_window import SimulatedWindow
from minihuman.runtime.team_host import TeamTable
from minihuman.runtime.team_seating import list_teams
from minihuman.simulation.participant import (
    SimulatedParticipant,
    make_participant,
)
from minihuman.storage.system import now_text
from minihuman.worlds.adapters.world import World


def simulate(
    protocol: Protocol,
    data: Path,
    *,
    participants: int,
    seed: int,
    player: str,
    make_world: WorldFactory = World,
) -> Iterator[Path]:
    """Run simulated participants one after the other, in the next free slots; yield the log of each of their sessions.

    A study of several sessions is played to its end, without the days in between; a participant who is screened out
    does not come back. Each participant has a random stream of its own, derived from ``seed``, the slot, and the number
    of earlier participants who left that slot. A player that crashes or gives no answer ends its session as
    ``player_failed``, its slot is free again, and no further session begins. ``make_world`` makes the sessions' worlds.

    Raises:
        AllocationError: if there are too few free slots before any session, or another program took them since.
        LogError: if a log cannot be written.
        SimulationError: if there is no such player; ``PlayerFailedError`` if it fails, or cannot play a block's world.
    """
    facts = {"player": player, "player_seed": str(seed), **collect_machine_facts()}
    require_free_slots(protocol, data / protocol.study.name, participants)
    _require_player(protocol, player, seed)  # a player that cannot play must not take up a slot
    without_data = Counter[int]()  # number of participants who left no data, by slot index

    def take_slot() -> tuple[SessionPlan, SimulatedParticipant]:
        plan = plan_next_session(protocol, data)
        slot_index = plan.participant.index
        n_replaced = int(plan.participant.id.partition("-")[2]) - 1 - slot_index  # 0 for the slot's first participant
        stream_key = (slot_index, *filter(None, (without_data[slot_index], n_replaced)))
        rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=stream_key))
        return plan, make_participant(player, rng)

    if any(len(team.persons) > 1 for _, team in list_teams(protocol, None)):
        yield from _simulate_teams(protocol, data, [take_slot() for _ in range(participants)], facts)
        return
    for _ in range(participants):
        plan, person = take_slot()
        yield from _play_sessions(protocol, data, plan, person, facts, without_data, make_world=make_world)


def _simulate_teams(
    protocol: Protocol, data: Path, people: list[tuple[SessionPlan, SimulatedParticipant]], facts: dict[str, str]
) -> Iterator[Path]:
    """Simulate all people at once, each in a thread; yield their logs. Thread timing does not affect the results."""
    teams = TeamTable(protocol, data, lambda: 0.0, gather=len(people))

    def play(person: tuple[SessionPlan, SimulatedParticipant]) -> list[Path]:
        try:
            return list(_play_sessions(protocol, data, *person, facts, Counter(), teams))
        finally:
            teams.depart()

    with ThreadPoolExecutor(len(people), "minihuman-team") as pool:
        for logs in pool.map(play, people):
            yield from logs


def _play_sessions(
    protocol: Protocol,
    data: Path,
    plan: SessionPlan,
    person: SimulatedParticipant,
    facts: dict[str, str],
    without_data: Counter[int],
    teams: TeamTable | None = None,
    *,
    make_world: WorldFactory = World,
) -> Iterator[Path]:
    """Play all sessions of one person and yield their logs.

    If the first session leaves no data, free the person's slot and count the person in ``without_data``.
    """
    slot_index = plan.participant.index
    log, reason = _play_session(
        protocol, plan, person, data, facts, before=without_data[slot_index], teams=teams, make_world=make_world
    )
    if log is None:
        free_slot(data / plan.study, plan.participant.id, reason)
        without_data[slot_index] += 1
    else:
        yield log
    for session in range(2, len(protocol.sessions) + 1):
        if reason != "complete":
            break
        plan = plan_next_session(protocol, data, participant=plan.participant.id, session=session, any_day=True)
        log, reason = _play_session(protocol, plan, person, data, facts, teams=teams, make_world=make_world)
        if log is not None:
            yield log


def _require_player(protocol: Protocol, player: str, seed: int) -> None:
    """Let a player press its first key in each of the study's worlds that simulated players play.

    Raises:
        SimulationError: if there is no such player, or it cannot play one of the worlds.
    """
    person = make_participant(player, np.random.default_rng(seed))
    for episode, key_pool in _list_first_episodes(protocol):
        with closing(World(episode.world, episode.options)) as world:
            world.reset(episode.seed)
            try:
                with limit_answer_time():
                    person.begin(episode, key_pool, world)
                    person.press(world)
            except MinihumanError:  # the player reports that it cannot play here
                raise
            except Exception:  # any other error of the player is recorded in its session
                return


def _list_first_episodes(protocol: Protocol) -> Iterator[tuple[EpisodePlan, tuple[str, ...]]]:
    """Yield the first episode in each world that simulated players play, with the keys that may have an action."""
    yielded: list[tuple[str, dict[str, Any]]] = []
    for group, session in product(protocol.groups, range(1, max(1, len(protocol.sessions)) + 1)):
        plan = expand_protocol(protocol, enrol_participant(protocol, 0, group.name), session=session, overridden=True)
        for episode in plan.episodes:
            world_and_options = episode.world, episode.options
            kind = find_kind(protocol.block(episode.block_name).kind)
            if kind.is_for_players and world_and_options not in yielded:
                yielded.append(world_and_options)
                yield episode, plan.key_pool


def _play_session(
    protocol: Protocol,
    plan: SessionPlan,
    player: SimulatedParticipant,
    data: Path,
    facts: dict[str, str],
    *,
    before: int = 0,
    teams: TeamTable | None = None,
    make_world: WorldFactory = World,
) -> tuple[Path | None, str]:
    """Play one session; return its log, None if nothing was recorded, and the reason why it ended.

    ``before`` is the number of earlier participants of the slot who left no data.
    """
    clock = VirtualClock()
    facts = facts | collect_world_facts(list_world_ids(plan)) | {"window": "simulated"}
    session = build_session(plan, make_world, facts, picture_px=None)
    log = DeferredRecorder(plan, lambda: McapRecorder(data, session.plan, started_ns=time.time_ns()))
    recorder = BufferedRecorder(log)
    window = SimulatedWindow(player, session, clock, before=before, at_rest=recorder.flush)
    agent = make_agent_host(protocol, plan, data, patient=True, teams=teams)
    try:
        path = run_session(session, window, recorder, clock, agent=agent, finished=record_log_end)
    except PlayerFailedError as error:
        log_place = _free_slot(data, plan, error)
        raise PlayerFailedError(f"{facts['player']}: {error}; {log_place}", error.reason) from error
    if session.failure is not None:
        raise describe_world_failure(session, path) from session.failure
    return path, session.end_reason


def _free_slot(data: Path, plan: SessionPlan, error: PlayerFailedError) -> str:
    """Free the slot of a player that failed; return a sentence that says where its log is."""
    study_dir = data / plan.study
    code = plan.participant.id
    departure_reason = f"player_failed: {error.reason}"
    log = SegmentPath.of_plan(data, plan).log
    if not log.exists():
        if plan.session > 1:
            return f"nothing was recorded of session {plan.session}, and {code} can be simulated again"
        free_slot(study_dir, code, "player_failed")
        return "nothing was recorded, and the slot is free again"
    record_log_end(log)
    record_departure(study_dir, ParticipantReplaced(code, now_text(), reason=departure_reason))
    return f"{log} has the session up to there, and the slot is free again"


if not TYPE_CHECKING:
    __getattr__ = forward_names(__name__)
