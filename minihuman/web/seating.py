"""A seat made: a new segment, or one that a killed server left, gone on with at the very step. Blocks for the disk."""

import hashlib
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from minihuman.errors import LogError
from minihuman.log.paths import SegmentPath
from minihuman.log.record.claim import refuse_taken
from minihuman.log.record.held import HeldRecorder
from minihuman.log.record.left import take_up
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.log.record.recorder import Recorder
from minihuman.log.record.rounds import Rounds
from minihuman.seats.agent_seat import agent_seat
from minihuman.study.again import taken_up
from minihuman.study.events import Event, SessionStarted
from minihuman.study.plan import SessionPlan
from minihuman.study.protocol import Protocol
from minihuman.study.undrawn import session_of
from minihuman.web.seat import Seat
from minihuman.web.telling import Settings
from minihuman.worlds.adapt.world import World

_RULES = ("version_minihuman", "rules", "pictures", "clauses")  # facts that say by what a session was played
_OF_A_WORLD = "world_sha256_"


@dataclass(frozen=True, slots=True)
class Disk:
    """How seats record.

    Args:
        protocol: the study; the policies of its agents lie beside it.
        data: the data folder.
        rounds: writes for all seats of a process.
    """

    protocol: Protocol
    data: Path
    rounds: Rounds


@dataclass(slots=True)
class Made:
    """A seat, and what it records to."""

    seat: Seat
    recorder: Recorder
    started_ns: int  # the wall clock at the segment's time 0, ns since 1970
    segment: str  # what the page calls the segment: it says nothing of whose it is
    files: list[McapRecorder] = field(default_factory=list)  # its log, once there is one

    @property
    def agreed(self) -> bool:
        """Whether there was a consent, or none was asked for: whether anything is recorded."""
        return bool(self.files)


def begin(
    plan: SessionPlan, disk: Disk, facts: Mapping[str, str], settings: Settings, *, at_sync: Callable[[], None]
) -> Made:
    """A seat for a new segment; nothing is on the disk before the consent.

    Raises:
        LogError: if the log exists already or cannot be written.
    """
    started_ns = time.time_ns()
    files: list[McapRecorder] = []

    def opened() -> Recorder:
        files.append(McapRecorder(disk.data, session.plan, started_ns=started_ns, rounds=disk.rounds, at_sync=at_sync))
        return files[0]

    refuse_taken(SegmentPath.of_plan(disk.data, plan))
    session = session_of(plan, World, facts, picture_px=settings.picture_px, draws_steps=False)
    recorder = HeldRecorder(plan, opened)
    seat = Seat(session, recorder, World, settings, agent=agent_seat(disk.protocol, plan, disk.data))
    return Made(seat, recorder, started_ns, _name(disk.data, plan), files)


def go_on(part: Path, disk: Disk, facts: Mapping[str, str], settings: Settings, *, at_sync: Callable[[], None]) -> Made:
    """A seat for the segment of a live file: the session is fed its own log.

    Raises:
        LogError: if that cannot be, or if the segment began by other rules than are here, which its facts say of all of
            it; then the file is to be recovered, and the session goes on in another segment.
        WorldError: if its world cannot be made here.
    """
    left = take_up(part)
    try:
        _refuse_other_rules(part, left.events, facts)
        session, unwritten = taken_up(left.events, World, picture_px=settings.picture_px, draws_steps=False)
    except BaseException:
        left.close()
        raise
    plan = session.plan
    recorder = McapRecorder(disk.data, plan, started_ns=left.started_ns, rounds=disk.rounds, at_sync=at_sync, left=left)
    agent = agent_seat(disk.protocol, plan, disk.data, logged=left.events)
    seat = Seat(session, recorder, World, settings, agent=agent, logged=left.events, unwritten=unwritten)
    return Made(seat, recorder, left.started_ns, _name(disk.data, plan), [recorder])


def _refuse_other_rules(part: Path, events: Sequence[Event], facts: Mapping[str, str]) -> None:
    """Refuse what another release began, or another state of the worlds."""
    began = events[0].facts if events and isinstance(events[0], SessionStarted) else {}
    for name in {*began, *facts}:
        if (name in _RULES or name.startswith(_OF_A_WORLD)) and began.get(name) != facts.get(name):
            raise LogError(f"{part} began with {name} {began.get(name)!r}; here it is {facts.get(name)!r}")


def _name(data: Path, plan: SessionPlan) -> str:
    return hashlib.sha256(str(SegmentPath.of_plan(data, plan).part).encode()).hexdigest()[:16]
