"""A recording: sessions into a ``.rrd`` file with its layout inside. No world runs unless the view is asked for."""

import errno
import os
import shutil
import uuid
from collections.abc import Sequence
from pathlib import Path

import rerun as rr

from minihuman.errors import LogError
from minihuman.recorded.episode import SessionLog
from minihuman.replay.layout import layout
from minihuman.replay.moments import Moments, common_starts
from minihuman.replay.scene import send_session, send_views, session_root

APPLICATION = "minihuman"
FIRST_BYTES = 2**20  # rerun waits for ever where a disk has no room for what a recording begins with


def save_recording(logs: Sequence[SessionLog], path: Path, *, with_view: bool = False) -> Path:
    """Write sessions into one ``.rrd``; several share a timeline on which their n-th episodes begin together.

    ``with_view`` adds what the participant saw, drawn again by the worlds, or stored, and checked against the log.

    Raises:
        LogError: if there is no session, or one session twice; or if a world shows something else than was seen, and
            the log holds no pictures.
        WorldError: if a world cannot be run here, and the log holds no pictures.
        OSError: if the file cannot be written, or the disk is full; then there is no recording.
    """
    roots = [session_root(log) for log in logs]
    if not logs or len(set(roots)) < len(roots):
        raise LogError(f"a replay needs different sessions, one or more; these are {roots}")
    aligned_ns = common_starts(logs) if len(logs) > 1 else None
    path.parent.mkdir(parents=True, exist_ok=True)
    if shutil.disk_usage(path.parent).free < FIRST_BYTES:
        raise _unwritten(path, errno.ENOSPC)
    path.open("ab").close()  # what cannot be written is an error that names it; rerun has one of its own
    recording = rr.RecordingStream(APPLICATION, recording_id=_identity(logs))
    with recording:
        recording.save(path, default_blueprint=layout(logs, with_view=with_view))
        for log in logs:
            moments = Moments.of(log, aligned_ns=aligned_ns)
            send_session(recording, log, moments)
            if with_view:
                send_views(recording, log, moments)
        try:
            recording.flush()
        except RuntimeError as error:  # all that is said of a write that failed; the reason is on the terminal
            full = shutil.disk_usage(path.parent).free < FIRST_BYTES
            recording.disconnect()
            path.unlink(missing_ok=True)
            raise _unwritten(path, errno.ENOSPC if full else errno.EIO) from error
        recording.disconnect()
    return path


def _unwritten(path: Path, why: int) -> OSError:
    return OSError(why, os.strerror(why), str(path))


def _identity(logs: Sequence[SessionLog]) -> uuid.UUID:
    """The same sessions make the same recording, so opening a replay twice shows it once."""
    names = [f"{log.plan.study}/{session_root(log)}/{log.started_at}" for log in logs]
    return uuid.uuid5(uuid.NAMESPACE_URL, "minihuman:" + "|".join(names))
