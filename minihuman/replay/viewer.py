"""Opening a recording: rerun's own viewer in a window, or its web viewer for this machine only."""

import os
import socket
import subprocess
import sys
from pathlib import Path
from urllib.parse import quote

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
    command, environment = viewer_command(recording, web=web), viewer_environment()
    if not web:
        return subprocess.call(command, env=environment)
    page, source = _free_port(), _free_port()
    address = quote(f"rerun+http://{ADDRESS}:{source}/proxy", safe="")
    print(f"open http://{ADDRESS}:{page}?url={address}   (Ctrl-C ends it)", flush=True)
    ports = ["--web-viewer-port", str(page), "--port", str(source)]
    return subprocess.call([*command, *ports], env=environment | {"RUST_LOG": "error"}, stdout=subprocess.DEVNULL)


def _free_port() -> int:
    with socket.socket() as taken:
        taken.bind((ADDRESS, 0))
        return int(taken.getsockname()[1])
