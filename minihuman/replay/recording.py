"""Writes sessions to a `.rrd` recording with its viewer layout, and opens it in rerun.

No world runs unless the participant's view is requested.
"""

import errno
import os
import shutil
import socket
import subprocess
import sys
import uuid
from collections.abc import Sequence
from pathlib import Path
from typing import Any
from urllib.parse import quote

import rerun as rr
import rerun.blueprint as rrb

from minihuman.errors import LogError
from minihuman.log.model.session_log import SessionLog, list_partner_seats
from minihuman.replay.rerun_scene import (
    ALIGNED,
    PLAY_TIME,
    ReplayTimeline,
    align_episode_starts,
    send_session,
    send_views,
    session_root,
)

_MARGIN = 0.04  # around a map, as a share of its longer side
Bounds = tuple[float, float, float, float]  # left, top, right, bottom


def build_layout(logs: Sequence[SessionLog], *, with_view: bool) -> rrb.Blueprint:
    """Return the viewer's layout: all panels of one session, or a column for each of several sessions.

    With ``with_view``, the layout has a panel for what the participant saw.
    """
    if len(logs) == 1:
        content = _lay_out_session(logs[0], with_view=with_view)
        timeline = PLAY_TIME
    else:
        content = rrb.Horizontal(*(_lay_out_column(log, with_view=with_view) for log in logs))
        timeline = ALIGNED
    return rrb.Blueprint(
        content,
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TimePanel(state="collapsed", timeline=timeline, play_state="paused"),
        auto_views=False,
    )


def _lay_out_session(log: SessionLog, *, with_view: bool) -> rrb.Horizontal:
    """Return a single session's panels: maps and views in one column, timelines, numbers and texts in another."""
    root = session_root(log)
    steering = []
    row_shares = [3, 2, 2, 3]  # of keys, rewards, reaction times and texts
    if any(episode.taught is not None for episode in log.episodes):
        steering = [rrb.StateTimelineView(origin=f"{root}/steering", name="Policy and person")]
        row_shares = [2, *row_shares]
    partner_seats = sorted({seat for episode in log.episodes for seat in list_partner_seats(episode)})
    names = {"view": "View", **{f"view-seat-{seat}": f"View of seat {seat}" for seat in partner_seats}}
    views = [rrb.Spatial2DView(origin=f"{root}/{view}", name=name) for view, name in names.items()]
    pictures: list[Any] = [_build_maps(log)]
    if with_view and len(views) > 1:
        pictures.append(rrb.Horizontal(*views))
    elif with_view:
        pictures.append(views[0])
    return rrb.Horizontal(
        rrb.Vertical(*pictures, row_shares=[3, 2][: len(pictures)]),
        rrb.Vertical(
            *steering,
            rrb.StateTimelineView(origin=f"{root}/keys", name="Keys"),
            rrb.TimeSeriesView(origin=root, contents=["$origin/reward", "$origin/return"], name="Reward"),
            rrb.TimeSeriesView(origin=root, contents=["$origin/reaction_ms"], name="Reaction time (ms)"),
            rrb.Tabs(
                rrb.TextLogView(origin=f"{root}/events", name="Events"),
                rrb.TextDocumentView(origin=f"{root}/facts", name="Session"),
            ),
            row_shares=row_shares,
        ),
        column_shares=[1, 1],
    )


def _lay_out_column(log: SessionLog, *, with_view: bool) -> rrb.Vertical:
    """Return the column of one session among several: its map, its view if asked for, its return and its events."""
    root = session_root(log)
    pictures: list[Any] = [_build_maps(log, f"{root} ({log.plan.participant.group}): ")]
    if with_view:
        pictures.append(rrb.Spatial2DView(origin=f"{root}/view", name="View"))
    return rrb.Vertical(
        *pictures,
        rrb.TimeSeriesView(origin=root, contents=["$origin/return"], name="Return"),
        rrb.TextLogView(origin=f"{root}/events", name="Events"),
    )


def _build_maps(log: SessionLog, prefix: str = "") -> rrb.Spatial2DView | rrb.Tabs:
    """Return a view of the map; if two or more blocks have maps, a tab for each, as maps differ in size between blocks.

    ``prefix`` is put before the views' names.
    """
    bounds_by_block: dict[str, list[Bounds]] = {}
    for episode in log.episodes:
        if episode.start.map is not None:
            bounds_by_block.setdefault(episode.plan.block_name, []).append(episode.start.map.bounds)
    if len(bounds_by_block) < 2:
        return _build_map_view(log, f"{prefix}map", next(iter(bounds_by_block.values()), []))
    return rrb.Tabs(
        *(_build_map_view(log, f"{prefix}map of {block}", bounds) for block, bounds in bounds_by_block.items())
    )


def _build_map_view(log: SessionLog, name: str, bounds: Sequence[Bounds]) -> rrb.Spatial2DView:
    """Return a view of the map that shows all given bounds with a margin; without bounds, rerun chooses the view."""
    visual_bounds = None
    if bounds:
        lefts, tops, rights, bottoms = zip(*bounds, strict=True)
        left = min(lefts)
        top = min(tops)
        right = max(rights)
        bottom = max(bottoms)
        margin = _MARGIN * max(right - left, bottom - top)
        visual_bounds = rrb.VisualBounds2D(
            x_range=(left - margin, right + margin), y_range=(top - margin, bottom + margin)
        )
    return rrb.Spatial2DView(origin=f"{session_root(log)}/map", name=name, visual_bounds=visual_bounds)


APPLICATION = "minihuman"
FIRST_BYTES = 2**20  # rerun waits forever if a disk has no room for a recording's beginning


def save_recording(logs: Sequence[SessionLog], path: Path, *, with_view: bool = False) -> Path:
    """Write sessions to one ``.rrd`` file, and return its path.

    The n-th episodes of several sessions begin together on a shared timeline. With ``with_view``, what the participant
    saw is added: redrawn by the worlds or as stored, and checked against the log.

    Raises:
        LogError: if there is no session, or one session twice, or if a world no longer shows what the participant saw
            and the log has no pictures.
        WorldError: if a world cannot be run here, and the log has no pictures.
        OSError: if the file cannot be written or the disk is full; a recording that cannot be completed is removed.
    """
    roots = [session_root(log) for log in logs]
    if not logs or len(set(roots)) < len(roots):
        names = ", ".join(roots) or "none"
        raise LogError(f"name one session or several different ones to replay, not {names}")
    aligned_ns = None
    if len(logs) > 1:
        aligned_ns = align_episode_starts(logs)
    path.parent.mkdir(parents=True, exist_ok=True)
    if shutil.disk_usage(path.parent).free < FIRST_BYTES:
        raise _make_write_error(path, is_full=True)
    path.open("ab").close()  # if this fails, the error names the file, unlike rerun's
    recording = rr.RecordingStream(APPLICATION, recording_id=_identify_recording(logs))
    with recording:
        try:
            recording.save(path, default_blueprint=build_layout(logs, with_view=with_view))
        except RuntimeError as error:
            raise _make_write_error(path, is_full=not path.is_file()) from error
        for log in logs:
            timeline = ReplayTimeline.of(log, aligned_ns=aligned_ns)
            send_session(recording, log, timeline)
            if with_view:
                send_views(recording, log, timeline)
        _finish_recording(recording, path)
    return path


def _finish_recording(recording: rr.RecordingStream, path: Path) -> None:
    """Write the remaining data of a recording and close its file; remove a file that cannot be completed.

    Raises:
        OSError: if the file cannot be written.
    """
    try:
        recording.flush()
    except RuntimeError as error:  # a write failed; rerun prints the reason on the terminal
        is_full = shutil.disk_usage(path.parent).free < FIRST_BYTES
        recording.disconnect()
        path.unlink(missing_ok=True)
        raise _make_write_error(path, is_full=is_full) from error
    recording.disconnect()


def _make_write_error(path: Path, *, is_full: bool) -> OSError:
    """Return the error for a file that could not be written; without ``is_full`` the reason is unknown."""
    error_number = errno.ENOSPC if is_full else errno.EIO
    return OSError(error_number, os.strerror(error_number), str(path))


def _identify_recording(logs: Sequence[SessionLog]) -> uuid.UUID:
    """Return a recording's id, which depends only on the sessions, so that a replay opened twice is shown once."""
    names = [f"{log.plan.study}/{session_root(log)}/{log.started_at}" for log in logs]
    return uuid.uuid5(uuid.NAMESPACE_URL, "minihuman:" + "|".join(names))


ADDRESS = "127.0.0.1"


def viewer_command(recording: Path, *, web: bool) -> list[str]:
    """Return the command that opens a recording in the viewer, on a page if ``web``; it listens on 127.0.0.1 only."""
    # -P: do not import a rerun.py in the current folder
    command = [sys.executable, "-P", "-m", "rerun", str(recording), "--bind", ADDRESS]
    if web:
        command.append("--web-viewer")
    return command


def viewer_environment() -> dict[str, str]:
    """Return the environment of rerun's viewer, in which usage statistics are switched off for this run.

    rerun collects none if it detects continuous integration; it has no other switch for a single run.
    """
    return os.environ | {"CI": "1", "PYTHONSAFEPATH": "1"}


def show_recording(recording: Path, *, web: bool) -> int:
    """Open a recording in the viewer, and return the viewer's exit status once it is closed.

    With ``web``, the viewer is a page, whose address is printed, and is closed by Ctrl-C.
    """
    command = viewer_command(recording, web=web)
    environment = viewer_environment()
    if not web:
        return subprocess.call(command, env=environment)
    page_port = _find_free_port()
    source_port = _find_free_port()
    source_url = quote(f"rerun+http://{ADDRESS}:{source_port}/proxy", safe="")
    print(f"open http://{ADDRESS}:{page_port}?url={source_url}   (Ctrl-C ends it)", flush=True)
    ports = ["--web-viewer-port", str(page_port), "--port", str(source_port)]
    return subprocess.call([*command, *ports], env=environment | {"RUST_LOG": "error"}, stdout=subprocess.DEVNULL)


def _find_free_port() -> int:
    with socket.socket() as probe:
        probe.bind((ADDRESS, 0))
        return int(probe.getsockname()[1])
