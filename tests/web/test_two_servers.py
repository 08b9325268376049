"""Two servers with one database and one object store: people who are loaded from either play their session once.

Servers are killed and cut off from the database meanwhile. MINIHUMAN_NIGHTLY=1 takes 200 people, and
MINIHUMAN_SERVER_KILLS=300 so many kills, with more people, in half an hour.
"""

import asyncio
import hashlib
import json
import os
import random
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from minihuman.admin.enrolment_entries import read_enrolled
from minihuman.admin.recruitment import Recruitment
from minihuman.admin.remote_logs import sync_logs
from minihuman.admin.status import list_problems
from minihuman.admin.verify.log import find_log_differences
from minihuman.admin.verify.study import verify_enrolment
from minihuman.experiment.machine.events import KeyPressed
from minihuman.log.read.session_reader import read_events, read_log
from minihuman.storage.remote_store import STORE_URL_FILE_NAME
from minihuman.storage.study_journals import URL_FILE_NAME
from minihuman.worlds.adapters.world import World
from tests.counts import PATIENCE_S, count
from tests.lab.database import database, fresh
from tests.lab.object_store import object_store
from tests.machine import needs
from tests.web.protocols import study
from tests.web.serving import Line, Serving, free_port, line
from tests.web.wandering_page import WanderingPage

pytestmark = [pytest.mark.program, needs("postgresql")]
KILLS = int(os.environ.get("MINIHUMAN_SERVER_KILLS", count(2, 20)))
PARTITIONS = count(2, 20)
PEOPLE = max(count(6, 200), 3 * KILLS // 2)  # as many as to play until the last kill
LOADS = count(2, 3)
AT_ONCE = count(6, 60 if KILLS <= 20 else 30)
PLAYING_S = PATIENCE_S * max(1.0, KILLS / 100)
PARTITION_S = 12.0  # longer than a lease
WEB = "image_size_px = [96, 96]\nmax_concurrent_sessions = 500"


class Machine:
    """A server with a data folder and a line to the database of its own."""

    def __init__(self, folder: Path, url: str, store: str, to_database: Line, *, links: int) -> None:
        folder.mkdir()
        self.data = folder
        self.to_database = to_database
        (folder / URL_FILE_NAME).write_text(f"{url}\n")
        (folder / STORE_URL_FILE_NAME).write_text(f"{store}\n")
        protocol = study(folder, episodes=2, max_steps=count(8, 12), web=WEB)
        protocol.write_text(protocol.read_text().replace('version = "1.0"', 'version = "1.0"\nconsent = "May we?"'))
        self.served = Serving(protocol, folder, links=links)
        self.host = f"127.0.0.1:{self.served.port}"


@contextmanager
def two_machines(tmp_path: Path) -> Iterator[list[Machine]]:
    port = free_port(in_a_row=1)
    with ExitStack() as stack:
        url = fresh(stack.enter_context(database(port=port)))
        name = url.partition("?")[0].rpartition("/")[2]
        store = f"{stack.enter_context(object_store())}/{tmp_path.name}"
        machines = []
        for number in range(2):
            wire = stack.enter_context(line(port))
            address = f"postgresql://tester@127.0.0.1:{wire.port}/{name}"
            made = Machine(tmp_path / f"machine-{number}", address, store, wire, links=PEOPLE if number == 0 else 0)
            stack.callback(made.served.kill)
            machines.append(made)
        yield machines


async def disturb(machines: list[Machine], rng: random.Random, happened: Counter[str], pause_s: float) -> None:
    """Kill servers, and cut them off from the database: each on its own, also both at once."""
    disturbances = ["kill"] * KILLS + ["partition"] * PARTITIONS
    rng.shuffle(disturbances)
    await asyncio.gather(*(_disturb_one(machine, disturbances, rng, happened, pause_s=pause_s) for machine in machines))


async def _disturb_one(
    machine: Machine, disturbances: list[str], rng: random.Random, happened: Counter[str], *, pause_s: float
) -> None:
    while disturbances:
        what = disturbances.pop()
        happened[what] += 1
        await asyncio.sleep(pause_s * (0.5 + rng.random()))
        if what == "kill":
            await asyncio.to_thread(machine.served.kill)
            await asyncio.sleep(rng.random() * 3)
            await asyncio.to_thread(machine.served.again)
        else:
            machine.to_database.stalled = True
            await asyncio.sleep(PARTITION_S)
            machine.to_database.stalled = False


async def everybody_plays(machines: list[Machine], pages: list[WanderingPage], seed: int) -> Counter[str]:
    rng, happened = random.Random(seed), Counter()
    seats = asyncio.Semaphore(AT_ONCE)

    async def takes_part(page: WanderingPage) -> None:
        async with seats:
            await page.take_part()

    disturbing = asyncio.create_task(disturb(machines, rng, happened, pause_s=count(2, 4 if KILLS <= 20 else 2)))
    playing = asyncio.gather(*map(takes_part, pages))
    try:
        await asyncio.wait_for(asyncio.gather(disturbing, playing), PLAYING_S)
    finally:
        disturbing.cancel()
    return happened


@pytest.mark.nightly
def test_people_who_are_loaded_from_either_server_play_once_and_nothing_acknowledged_is_lost(tmp_path: Path) -> None:
    rng = random.Random(5)
    with two_machines(tmp_path) as machines:
        hosts = [machine.host for machine in machines]
        pages = [
            WanderingPage(lambda: rng.choice(hosts), token, rng=random.Random(number), loads=LOADS)
            for number, token in enumerate(machines[0].served.tokens)
        ]
        happened = asyncio.run(everybody_plays(machines, pages, seed=3))
        assert happened == Counter(kill=KILLS, partition=PARTITIONS)
        ends = Counter(page.counts.over or f"refused: {page.counts.refused}" for page in pages)
        assert ends <= Counter({"complete": PEOPLE, "refused: complete": PEOPLE}), ends
        for machine in machines:
            machine.served.stop()
        moved = sum(len(set(page.visits)) > 1 for page in pages)
        elsewhere = tmp_path / "elsewhere"
        elsewhere.mkdir()
        for name in (URL_FILE_NAME, STORE_URL_FILE_NAME):
            (elsewhere / name).write_text((machines[0].data / name).read_text())
        ends: dict[str, set[str]] = {}  # of complete logs, wherever they are
        folders = (*(machine.data for machine in machines), elsewhere)
        for data in folders:  # what a server was killed before it uploaded, `minihuman gather` puts there
            sync_logs(data, "tried/")
        for data in folders:
            for log in data.rglob("*.mcap"):
                if read_log(log).end_reason == "complete":
                    ends.setdefault(log.name, set()).add(hashlib.sha256(log.read_bytes()).hexdigest())
            sync_logs(data, "tried/")
            assert list_problems(data / "tried") == ()
        complaints = [text for text, fine in verify_enrolment(elsewhere / "tried") if not fine]
        assert [text for text in complaints if "has a slot and no log" not in text] == []
        unused = {text.partition(" ")[0] for text in complaints}  # a server ended between a slot and its arrival
        assert not unused & {*Recruitment(elsewhere / "tried").standing().came.values()}
        assert len(unused) <= KILLS + PARTITIONS
        logs = {log.name.partition("_")[0]: log for log in sorted((elsewhere / "tried").rglob("*.mcap"))}
        assert len(list((elsewhere / "tried").rglob("*.mcap"))) == PEOPLE
        assert sorted(logs) == sorted({slot.participant for slot in read_enrolled(elsewhere / "tried")} - unused)
        pressed: dict[str, Counter[tuple[str, int]]] = {}
        for participant, log in logs.items():
            assert read_log(log).end_reason == "complete"
            assert list(find_log_differences(log, World)) == []
            events = (event for event in read_events(log) if isinstance(event, KeyPressed) and event.down)
            pressed[participant] = Counter((event.key, event.t_ns - event.waited_ns) for event in events)
        lost = sum(min((Counter(page.acknowledged) - found).total() for found in pressed.values()) for page in pages)
        found = {
            "people": PEOPLE,
            "moved between servers": moved,
            **happened,
            "sessions twice": sum(len(digests) > 1 for digests in ends.values()),
            "acknowledged presses": sum(len(page.acknowledged) for page in pages),
            "acknowledged lost": lost,
            "slots of nobody, named": len(unused),
        }
        print(json.dumps(found))
        assert found["sessions twice"] == lost == 0
        assert moved > 0
