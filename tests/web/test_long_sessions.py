"""People who play for an hour: a server's memory is after an hour what it was after five minutes.

The server is the real one, with its tasks, its disk and its threads; its clock is the pages', which goes on as fast as
all of them can act. MINIHUMAN_NIGHTLY=1 takes the whole hour, and prints the memory of each five minutes;
MINIHUMAN_PEOPLE=200 takes all of them, in ten minutes of CPU time.
"""

import asyncio
import gc
import os
import random
from pathlib import Path

import pytest

from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.storage.system import System, use_system
from minihuman.web.arrivals import Arrivals
from minihuman.web.server.app import WebServer
from tests.counts import count
from tests.web.memory_page import MemoryPage, S, SharedClock, wait_for_disk
from tests.web.protocols import study

pytestmark = [pytest.mark.program, pytest.mark.nightly]
PEOPLE = int(os.environ.get("MINIHUMAN_PEOPLE", count(10, 20)))
MINUTES = count(15, 60)
SETTLED_MINUTES = 5
KEYS_PER_S = 2
GROWTH = 1.25


def measure_memory_mb() -> float:
    """Return the resident memory of this process, MB."""
    gc.collect()
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


async def play(folder: Path, minutes: int) -> tuple[list[float], list[MemoryPage]]:
    """Let everyone play; return the memory after each five minutes, and the pages."""
    clock = SharedClock()
    with use_system(System(clock=clock)):
        web = "image_size_px = [96, 96]\nmax_concurrent_sessions = 1000"
        path = study(folder, episodes=500, max_steps=100, block='computed = "page"', web=web)
        server = WebServer(Arrivals(decode_protocol(path.read_bytes()), folder), folder)
        tokens = server._arrivals.recruits.issue(PEOPLE)
        pages = [MemoryPage(clock, token, random.Random(number)) for number, token in enumerate(tokens)]
        memory_mb = []
        async with server._lifespan(None):  # type: ignore[arg-type] # it does not look at its application
            talking = [asyncio.create_task(server._converse(page, "192.0.2.1")) for page in pages]
            while not all(page.kind or page.over for page in pages):
                await asyncio.sleep(0.01)
            for moment in range(minutes * 60 * KEYS_PER_S):
                clock.now_ns += S // KEYS_PER_S
                for page in pages:
                    page.act()
                    await asyncio.sleep(0)
                await wait_for_disk(pages, clock)
                if (moment + 1) % (SETTLED_MINUTES * 60 * KEYS_PER_S) == 0:
                    memory_mb.append(measure_memory_mb())
                    print(f"{(moment + 1) // (60 * KEYS_PER_S)} min: {memory_mb[-1]:.0f} MB", flush=True)
            for task in talking:
                task.cancel()
            await asyncio.gather(*talking, return_exceptions=True)
    return memory_mb, pages


def test_the_memory_of_a_server_does_not_grow_with_the_length_of_its_sessions(tmp_path: Path) -> None:
    memory_mb, pages = asyncio.run(play(tmp_path, MINUTES))
    presses = sum(page.presses for page in pages)
    print(
        f"{PEOPLE} people, {MINUTES} min, {presses} steps: {memory_mb[0]:.0f} MB after {SETTLED_MINUTES} min, "
        f"{memory_mb[-1]:.0f} MB at the end, at most {max(memory_mb):.0f} MB"
    )
    assert [page.over for page in pages if page.over] == []
    assert presses > PEOPLE * MINUTES * 60 * KEYS_PER_S / 2
    assert max(memory_mb) <= GROWTH * memory_mb[0]
