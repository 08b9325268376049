"""Ctrl-C at a server's terminal while people play: it goes to the server and all that it has begun, at once."""

import asyncio
import os
import random
import signal
from pathlib import Path

import pytest

from minihuman.admin.verify.log import find_log_differences
from minihuman.experiment.machine.events import KeyPressed
from minihuman.log.read.session_reader import read_events
from minihuman.worlds.adapters.world import World
from tests.counts import PATIENCE_S
from tests.web.processes import below, runs, until
from tests.web.served import Served, served
from tests.web.serving import free_port
from tests.web.typed_page import Counts, TypedPage

ACKED = 12  # presses of each of them at least, when it comes


async def interrupted(server: Served, pages: list[TypedPage]) -> None:
    """Let them play, and press Ctrl-C meanwhile. Each comes when the one before plays, so slots go in their order."""
    playing: list[asyncio.Task[Counts]] = []

    async def all_have(acked: int) -> None:
        while any(len(page.counts.acked_s) < acked for page in pages[: len(playing)]):
            assert not any(task.done() for task in playing), "somebody's page broke"
            await asyncio.sleep(0.01)

    for page in pages:
        playing.append(asyncio.create_task(page.take_part()))
        await all_have(1)
    await all_have(ACKED)
    os.killpg(server.process.pid, signal.SIGINT)
    await asyncio.to_thread(server.process.wait, PATIENCE_S)
    for task in playing:
        task.cancel()
    await asyncio.gather(*playing, return_exceptions=True)


@pytest.mark.nightly(by_day=["1"])
@pytest.mark.program
@pytest.mark.parametrize("workers", [1, 2])
def test_ctrl_c_while_people_play_loses_nothing_that_was_acknowledged(tmp_path: Path, workers: int) -> None:
    options = () if workers == 1 else ("--port", str(free_port()), "--workers", str(workers), "--watch")
    with served(tmp_path, links=3, episodes=1000, options=options, before=("setsid",)) as server:
        others = below(server.process.pid)
        pages = [
            TypedPage(server.host, token, keys_per_s=8, rng=random.Random(number))
            for number, token in enumerate(server.links)
        ]
        asyncio.run(asyncio.wait_for(interrupted(server, pages), PATIENCE_S))
        assert server.process.returncode == 0
        assert "Traceback" not in server.complaints()
        until(lambda: not any(map(runs, others)))
    parts = sorted(tmp_path.rglob("*.mcap.part"))
    assert len(parts) == len(pages), "every session is left to be gone on with"
    for part, page in zip(parts, pages, strict=True):
        keys = [event for event in read_events(part) if isinstance(event, KeyPressed) and event.down]
        logged = sum(key.action is not None and key.phase == "playing" for key in keys)
        assert ACKED <= len(page.counts.acked_s) <= logged <= page.counts.presses
        assert list(find_log_differences(part, World)) == []
