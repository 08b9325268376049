"""Host a participant's session on this machine: plan, window, devices and log around one session."""

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

from minihuman.admin.enrolment_log import free_slot
from minihuman.admin.manifest import record_log_end
from minihuman.admin.session_index import summarize_session
from minihuman.display.windows.window import Window
from minihuman.experiment.machine.activity import RequestHandler, WorldFactory
from minihuman.experiment.machine.events import FINAL_END_REASONS
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.pending_session import build_session
from minihuman.experiment.plan.session_plan import SessionPlan, needs_gamepad
from minihuman.experiment.protocol.protocol import decode_logged_protocol
from minihuman.log.paths import SegmentPath
from minihuman.log.record.file_lock import require_unclaimed
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.log.record.recorder import DeferredRecorder, Recorder
from minihuman.runtime.devices.device import DeviceRecorder, open_devices
from minihuman.runtime.devices.lsl import LslMarkerRecorder, pylsl
from minihuman.runtime.machine import SessionClock, collect_machine_facts, collect_world_facts, list_world_ids
from minihuman.runtime.session_loop import CommandInbox, describe_world_failure, inbox_path, run_session
from minihuman.worlds.adapters.world import World


def host_session(
    plan: SessionPlan,
    window: Window,
    clock: SessionClock,
    data: Path,
    *,
    markers: bool = False,
    agent: RequestHandler | None = None,
    begun: Callable[[SessionMachine], None] = lambda session: None,
    make_world: WorldFactory = World,
) -> Path | None:
    """Run a session in an open window and return its log; with ``markers`` also send its events by LSL.

    None where no consent was given, or it ended before the group was drawn: then nothing was written, and the slot is
    free again. ``agent`` answers what the session requests from outside; see ``agent_host``. ``begun`` is given the
    session before its first input. ``make_world`` makes its worlds.

    Raises:
        DeviceError: if a device that the protocol asks for is not there, or there is no LSL to send markers by.
        LogError: if the log exists already or cannot be written.
        WindowError: if the protocol needs a gamepad and none is connected.
        WorldError: if the world failed; the log has the reason and everything before.
        OSError: if the data folder cannot be written.
    """
    worlds = collect_world_facts(list_world_ids(plan))
    if plan.protocol_toml:
        wanted = decode_logged_protocol(plan.protocol_toml).devices
    else:
        wanted = ()
    if markers:
        pylsl()  # before there is a log: without it nothing is to begin
    with open_devices(wanted, clock) as (devices, of_devices), ExitStack() as opened:
        facts = {
            "player": "human",
            **collect_machine_facts(),
            **worlds,
            **clock.facts(),
            **window.facts(),
            **(window.open_gamepad() if needs_gamepad(plan) else {}),
            **of_devices,
        }
        picture_px = _four_to_three(window.picture_px)
        if picture_px is not None:
            facts["picture_px"] = "{} x {}".format(*picture_px)
        require_unclaimed(SegmentPath.of_plan(data, plan))
        session = build_session(plan, make_world, facts, picture_px=picture_px)
        begun(session)

        def open_log() -> Recorder:
            log = McapRecorder(data, session.plan, started_ns=clock.started_unix_ns)
            if devices:
                return DeviceRecorder(log, devices, from_ns=clock())
            return log

        recorder: Recorder = DeferredRecorder(plan, open_log)
        if markers:  # the stream is there from now on, for those who want to listen; what it says waits, too
            marking = LslMarkerRecorder(recorder, plan, clock)
            opened.callback(marking.close)
            recorder = DeferredRecorder(plan, lambda: marking)
        inbox = CommandInbox(inbox_path(SegmentPath.of_plan(data, plan).log))
        path = run_session(session, window, recorder, clock, inbox=inbox, agent=agent, finished=record_log_end)
    if path is None and plan.session == 1:
        free_slot(data / plan.study, plan.participant.id, session.end_reason)
    if session.failure is not None:
        raise describe_world_failure(session, path) from session.failure
    return path


def describe_ending(log: Path, protocol: Path) -> str:
    """Describe in one line how a log's session ended, how far it came, and how to resume it."""
    found = summarize_session([log])
    done = f"{found.episodes_completed} of {found.episodes_planned} episodes"
    if found.complete or found.end_reason in FINAL_END_REASONS:
        return f"{found.end_reason}: {done}; sealed {record_log_end(log)}"
    session = f" --session {found.session}" if found.session > 1 else ""
    return (
        f"ended by {found.end_reason} after {done}; sealed {record_log_end(log)}; goes on with: "
        f"minihuman run {protocol} --participant {found.participant}{session}"
    )


def _four_to_three(room_px: tuple[int, int] | None) -> tuple[int, int] | None:
    """The largest 4:3 picture in a room: everyone sees the same angle of a first-person world, on any display."""
    if room_px is None:
        return None
    width = min(room_px[0], room_px[1] * 4 // 3)
    return width, width * 3 // 4
