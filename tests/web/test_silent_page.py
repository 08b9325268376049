"""A log that cannot be written ends its session at once, also while its page has nothing to say."""

import asyncio
import errno
import random
import time
from pathlib import Path

from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.storage.system import FileSystem, System, use_system
from minihuman.web.arrivals import Arrivals
from minihuman.web.server.app import WebServer
from tests.web.memory_page import MemoryPage, S, SharedClock
from tests.web.protocols import study

SILENT_S = 20.0  # of a machine that is busy; it takes a fifth of a second


class FillingDisk(FileSystem):
    """A disk that is full from some moment on."""

    is_full = False

    def write(self, fd: int, data: bytes | memoryview) -> int:
        if self.is_full:
            raise OSError(errno.ENOSPC, "No space left on device")
        return super().write(fd, data)


async def fall_silent(folder: Path, disk: FillingDisk, clock: SharedClock) -> MemoryPage:
    """Play until a press is made on a full disk, then say nothing; return the page, which had time to be told."""
    path = study(folder, episodes=20, max_steps=50, block='computed = "page"', web="image_size_px = [96, 96]")
    server = WebServer(Arrivals(decode_protocol(path.read_bytes()), folder), folder)
    [token] = server._arrivals.recruits.issue(1)
    page = MemoryPage(clock, token, random.Random(1))
    async with server._lifespan(None):  # type: ignore[arg-type] # it does not look at its application
        talking = asyncio.create_task(server._converse(page, "192.0.2.1"))
        while page.presses < 5:
            disk.is_full = page.presses == 4
            clock.now_ns += S
            page.act()
            await asyncio.sleep(0.05)
        until_s = time.monotonic() + SILENT_S
        while not page.over and time.monotonic() < until_s:
            await asyncio.sleep(0.05)
        talking.cancel()
        await asyncio.gather(talking, return_exceptions=True)
    return page


def test_a_page_that_waits_in_silence_is_told_that_its_log_cannot_be_written(tmp_path: Path) -> None:
    clock = SharedClock()
    disk = FillingDisk()
    with use_system(System(disk=disk, clock=clock)):
        page = asyncio.run(fall_silent(tmp_path, disk, clock))
    assert page.over == "over"
    assert page.ending["end"] == "broken"
    assert page.acknowledged_presses < page.presses
