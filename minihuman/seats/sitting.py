"""A participant sits down: their plan, a window and a log on disk around one session."""

from contextlib import ExitStack
from pathlib import Path

from minihuman.errors import WorldError
from minihuman.lab.register import free
from minihuman.lab.seal import note_end
from minihuman.lab.summarise import summarise
from minihuman.log.paths import SegmentPath
from minihuman.log.record.claim import refuse_taken
from minihuman.log.record.held import HeldRecorder
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.log.record.recorder import Recorder
from minihuman.seats.desk import Desk, requests_path
from minihuman.seats.devices.lsl import pylsl
from minihuman.seats.devices.markers import MarkingRecorder
from minihuman.seats.devices.sampling import SamplingRecorder, open_devices
from minihuman.seats.machine import SessionClock, machine_facts, world_facts, worlds_of
from minihuman.seats.run import run_session
from minihuman.study.activities.port import Outside
from minihuman.study.events import SETTLED
from minihuman.study.plan import SessionPlan
from minihuman.study.protocol import decode_logged
from minihuman.study.undrawn import session_of
from minihuman.windows.port import Window
from minihuman.worlds.adapt.world import World


def sit(
    plan: SessionPlan,
    window: Window,
    clock: SessionClock,
    data: Path,
    *,
    markers: bool = False,
    agent: Outside | None = None,
) -> Path | None:
    """Run a session in an open window and return its log; with ``markers`` it is told by LSL as well.

    None where no consent was given, or it ended before the group was drawn: then nothing was written, and the slot is
    free again. ``agent`` answers what the session wants from outside; see ``agent_seat``.

    Raises:
        DeviceError: if a device that the protocol asks for is not there, or there is no LSL to send markers by.
        LogError: if the log exists already or cannot be written.
        WorldError: if the world failed; the log says so too, and everything before is in it.
        OSError: if the data folder cannot be written.
    """
    worlds = world_facts(worlds_of(plan))
    wanted = decode_logged(plan.protocol_toml).devices if plan.protocol_toml else ()
    if markers:
        pylsl()  # before there is a log: without it nothing is to begin
    with open_devices(wanted, clock) as (devices, of_devices), ExitStack() as opened:
        facts = {"player": "human", **machine_facts(), **worlds, **clock.facts(), **window.facts(), **of_devices}
        refuse_taken(SegmentPath.of_plan(data, plan))
        session = session_of(plan, World, facts, picture_px=_four_to_three(window.picture_px))

        def open_log() -> Recorder:
            log = McapRecorder(data, session.plan, started_ns=clock.started_unix_ns)
            return SamplingRecorder(log, devices, from_ns=clock()) if devices else log

        recorder: Recorder = HeldRecorder(plan, open_log)
        if markers:  # the stream is there from now on, for those who want to listen; what it says waits, too
            marking = MarkingRecorder(recorder, plan, clock)
            opened.callback(marking.close)
            recorder = HeldRecorder(plan, lambda: marking)
        desk = Desk(requests_path(SegmentPath.of_plan(data, plan).log))
        path = run_session(session, window, recorder, clock, desk=desk, agent=agent, finished=note_end)
    if path is None and plan.session == 1:
        free(data / plan.study, plan.participant.id, session.end_reason)
    if session.failure is not None:
        failure = f"{type(session.failure).__name__}: {session.failure}"
        raise WorldError(f"the world failed ({failure}); everything before that is in {path}") from session.failure
    return path


def ending(log: Path, protocol: Path) -> str:
    """How the session of a log ended, how far it came, and how it goes on where it can, in one line."""
    found = summarise([log])
    done = f"{found.episodes_completed} of {found.episodes_planned} episodes"
    if found.complete or found.end_reason in SETTLED:
        return f"{found.end_reason}: {done}; sealed {note_end(log)}"
    session = f" --session {found.session}" if found.session > 1 else ""
    return (
        f"ended by {found.end_reason} after {done}; sealed {note_end(log)}; goes on with: "
        f"minihuman run {protocol} --participant {found.participant}{session}"
    )


def _four_to_three(room_px: tuple[int, int] | None) -> tuple[int, int] | None:
    """The largest 4:3 picture in a room: everyone sees the same angle of a first-person world, on any display."""
    if room_px is None:
        return None
    width = min(room_px[0], room_px[1] * 4 // 3)
    return width, width * 3 // 4
