"""Opening a recording: rerun's own viewer in a window, or its web viewer for this machine only."""

import subprocess
import sys
from pathlib import Path

ADDRESS = "127.0.0.1"


def viewer_command(recording: Path, *, web: bool) -> list[str]:
    """The command that shows a recording; the web viewer and its server listen on 127.0.0.1 and nowhere else."""
    command = [sys.executable, "-m", "rerun", str(recording), "--bind", ADDRESS]
    return [*command, "--web-viewer"] if web else command


def show(recording: Path, *, web: bool) -> int:
    """Show a recording until the viewer is closed, and give its exit status."""
    return subprocess.call(viewer_command(recording, web=web))
