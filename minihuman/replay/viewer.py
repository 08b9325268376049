"""Opening a recording: rerun's own viewer in a window, or its web viewer for this machine only."""

import os
import subprocess
import sys
from pathlib import Path

ADDRESS = "127.0.0.1"


def viewer_command(recording: Path, *, web: bool) -> list[str]:
    """The command that shows a recording; the web viewer and its server listen on 127.0.0.1 and nowhere else."""
    # -P: a rerun.py in the folder that somebody happens to be in is none of ours
    command = [sys.executable, "-P", "-m", "rerun", str(recording), "--bind", ADDRESS]
    return [*command, "--web-viewer"] if web else command


def viewer_environment() -> dict[str, str]:
    """The environment of rerun's viewer: its usage statistics are off, for this run only.

    rerun keeps none where it sees that it runs in continuous integration; it has no other switch for a single run.
    """
    return os.environ | {"CI": "1", "PYTHONSAFEPATH": "1"}


def show(recording: Path, *, web: bool) -> int:
    """Show a recording until the viewer is closed, and give its exit status."""
    return subprocess.call(viewer_command(recording, web=web), env=viewer_environment())
