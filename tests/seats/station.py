"""A station: minihuman as a program at a display."""

import os
import subprocess
import sys
from pathlib import Path

DEMO = Path(__file__).parents[2] / "protocols" / "demo.toml"


def started(*words: str | Path, display: str) -> subprocess.Popen[str]:
    """The program as these words start it."""
    return subprocess.Popen(
        [sys.executable, "-m", "minihuman", *map(str, words)],
        env={**os.environ, "DISPLAY": display},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def demo_started(window: str, display: str, data: Path) -> subprocess.Popen[str]:
    """A session of the demonstration in a window."""
    return started("run", DEMO, "--data", data, "--window", window, "--windowed", display=display)
