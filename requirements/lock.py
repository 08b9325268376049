"""Write station.txt and server.txt, the locked requirements of a station and of a server, from the .in files.

python requirements/lock.py

It needs uv. Each .in file names what pyproject.toml names, with the same bounds; a test compares them.
"""

import subprocess
from pathlib import Path

FOLDER = Path(__file__).parent


def lock(name: str) -> None:
    """Resolve one file for every Python and platform that minihuman runs on."""
    command = ["uv", "pip", "compile", "--quiet", "--universal", "--python-version", "3.11", "--no-emit-index-url"]
    subprocess.run([*command, "--no-header", f"{name}.in", "-o", f"{name}.txt"], check=True, cwd=FOLDER)


if __name__ == "__main__":
    for name in ("station", "server"):
        lock(name)
