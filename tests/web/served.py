"""A study served by the program itself, for tests of it from outside."""

import re
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from tests.counts import PATIENCE_S
from tests.programs import ended_with_block, running
from tests.warm_start import WarmProgram, start_program

GRID = """
[study]
name = "walk"
version = "1"
seed = 3
participants = {participants}
consent = "May we?"
[keys]
keyboard_check = false
[web]
image_size_px = [96, 96]
recruitment_platforms = ["prolific"]
{web}
[[groups]]
name = "all"
{parts}
[[blocks]]
name = "walk"
world = "{world[0]}"
episodes = {episodes}
max_steps = 20
final_frame_ms = 0
actions = {actions}
{more}
"""


@dataclass
class Served:
    """A server that runs, and whom it offers a place."""

    host: str
    process: subprocess.Popen[str] | WarmProgram
    links: list[str]  # tokens
    said: Path  # what it said on its standard error

    def complaints(self) -> str:
        """Its standard error so far."""
        return self.said.read_text()


@contextmanager
def served(
    folder: Path,
    *,
    links: int = 1,
    web: str = "",
    more: str = "",
    parts: str = 'blocks = ["walk"]',
    episodes: int = 2,
    world: tuple[str, tuple[str, ...]] = ("minihuman/MiniGrid-Empty-5x5-v0", ("left", "right", "forward")),
    options: tuple[str, ...] = (),
    before: tuple[str, ...] = (),
) -> Iterator[Served]:
    """Serve a walk in an empty room from a folder; the data are in ``folder / "data"``.

    ``before`` goes before the command: a shell that sets limits, say.
    """
    folder.mkdir(parents=True, exist_ok=True)
    path, said = folder / "walk.toml", folder / "said.txt"
    path.write_text(
        GRID.format(
            participants=max(100, links),
            web=web,
            more=more,
            parts=parts,
            episodes=episodes,
            world=world,
            actions=list(world[1]),
        )
    )
    words = ("serve", str(path), "--data", str(folder / "data"), "--port", "0", "--links", str(links), *options)
    with said.open("w") as errors, ExitStack() as stack:
        process: subprocess.Popen[str] | WarmProgram
        if before:
            command = [*before, sys.executable, "-m", "minihuman", *words]
            process = stack.enter_context(running(command, stdout=subprocess.PIPE, stderr=errors, text=True))
        else:
            process = stack.enter_context(ended_with_block(start_program(*words, stderr=errors)))
        assert process.stdout is not None
        lines: list[str] = []
        while len(lines) < max(1, links):
            line = process.stdout.readline()
            assert line, f"it did not start: {said.read_text()}"
            if re.search(r"http://\S+", line) and "watch" not in line:
                lines.append(re.search(r"http://(\S+)", line)[1])  # type: ignore[index]
        try:
            host = lines[0].partition("/")[0]
            yield Served(host, process, [line.partition("#t=")[2] for line in lines if "#t=" in line], said)
        finally:
            process.terminate()
            try:
                process.wait(timeout=PATIENCE_S)
            except subprocess.TimeoutExpired:
                process.kill()
