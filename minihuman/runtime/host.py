"""Hosts a participant's session on this machine, with its plan, window, devices and log."""

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
from minihuman.runtime.devices.sound import open_sound
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
    on_begin: Callable[[SessionMachine], None] = lambda session: None,
    make_world: WorldFactory = World,
) -> Path | None:
    """Run a session in an open window and return its log.

    It returns None if no consent was given, or the session ended before the group was drawn. Nothing was then written,
    and the slot is free again.

    Args:
        plan: the session's plan.
        window: the window in which the session is shown.
        clock: the clock of the session and of the devices.
        data: the data folder.
        markers: whether to send the session's events as LSL markers, too.
        agent: answers the session's requests to agents; see ``agent_host``.
        on_begin: called with the session before its first input.
        make_world: makes the session's worlds.

    Raises:
        DeviceError: if a required device is missing, LSL for the markers, or a sound device for sounds.
        LogError: if the log exists already or cannot be written, as ``OSError`` if the data folder cannot.
        WindowError: if the protocol needs a gamepad and none is connected.
        WorldError: if the world failed; the log has the reason and everything before it.
    """
    facts_of_worlds = collect_world_facts(list_world_ids(plan))
    device_specs = decode_logged_protocol(plan.protocol_toml).devices if plan.protocol_toml else ()
    if markers:
        pylsl()  # fails without LSL, before anything is written
    with open_devices(device_specs, clock) as (devices, device_facts), ExitStack() as opened:
        facts = {"player": "human", **collect_machine_facts(), **facts_of_worlds, **clock.facts()}
        sound, sound_facts = opened.enter_context(open_sound(plan, clock))
        facts |= _open_window_devices(plan, window) | device_facts | sound_facts
        picture_px = _fit_four_to_three(window.picture_px)
        require_unclaimed(SegmentPath.of_plan(data, plan))
        session = build_session(plan, make_world, facts, picture_px=picture_px)
        on_begin(session)

        def open_log() -> Recorder:
            log = McapRecorder(data, session.plan, started_ns=clock.started_unix_ns)
            return DeviceRecorder(log, devices, from_ns=clock()) if devices else log

        recorder: Recorder = DeferredRecorder(plan, open_log)
        if markers:  # recorders can find the stream from now on, but its markers wait for the consent
            marking = LslMarkerRecorder(recorder, plan, clock)
            opened.callback(marking.close)
            recorder = DeferredRecorder(plan, lambda: marking)
        inbox = CommandInbox(inbox_path(SegmentPath.of_plan(data, plan).log))
        path = run_session(
            session, window, recorder, clock, inbox=inbox, agent=agent, sound=sound, finished=record_log_end
        )
    if path is None and plan.session == 1:
        free_slot(data / plan.study, plan.participant.id, session.end_reason)
    if session.failure is not None:
        raise describe_world_failure(session, path) from session.failure
    return path


def _open_window_devices(plan: SessionPlan, window: Window) -> dict[str, str]:
    """Open the gamepad if the plan needs one; return the facts about the window, its pictures and the gamepad."""
    facts = window.facts()
    if needs_gamepad(plan):
        facts |= window.open_gamepad()
    picture_px = _fit_four_to_three(window.picture_px)
    if picture_px is not None:
        facts["picture_px"] = f"{picture_px[0]} x {picture_px[1]}"
    return facts


def describe_ending(log: Path, protocol: Path) -> str:
    """Seal a log, and return one line on how its session ended, how far it came, and how to resume it.

    ``protocol`` is the study's file, which the command to resume names.
    """
    summary = summarize_session([log])
    digest = record_log_end(log)
    progress = f"{summary.episodes_completed} of {summary.episodes_planned} episodes"
    if summary.complete or summary.end_reason in FINAL_END_REASONS:
        return f"{summary.end_reason}: {progress}; sealed {digest}"
    command = f"minihuman run {protocol} --participant {summary.participant}"
    if summary.session > 1:
        command += f" --session {summary.session}"
    return f"ended by {summary.end_reason} after {progress}; sealed {digest}; goes on with: {command}"


def _fit_four_to_three(room_px: tuple[int, int] | None) -> tuple[int, int] | None:
    """Return the width and height in pixels of the largest 4:3 picture that fits into a size; None without a size.

    With 4:3 everywhere, every display shows the same angle of a first-person world.
    """
    if room_px is None:
        return None
    room_width, room_height = room_px
    width = min(room_width, room_height * 4 // 3)
    return width, width * 3 // 4
