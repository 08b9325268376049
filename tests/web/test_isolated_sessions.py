"""Sessions in one server whose worlds fail, and others beside them: a world's failure is its session's alone."""

import asyncio
import os
from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest

from minihuman.admin.recruitment import Recruitment
from minihuman.admin.verify.log import find_log_differences, verify_session
from minihuman.admin.verify.picture_verification import PictureVerification, verify_pictures
from minihuman.experiment.machine.events import FrameShown, Stepped
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.log.model.event_columns import EventColumns
from minihuman.log.read.session_reader import read_events, read_log
from minihuman.runtime.machine import collect_machine_facts
from minihuman.web.arrivals import Arrivals
from minihuman.web.computed import PageWorld
from minihuman.web.connection import Connection
from minihuman.web.connection_factory import ConnectionFactory
from minihuman.web.messages import MESSAGE_VERSION, Hello
from minihuman.worlds.adapters.world import World
from minihuman.worlds.isolation.isolated_world import IsolatedWorlds
from minihuman.worlds.isolation.process_pool import WorldLimits
from tests.counts import count
from tests.web.page_model import PageModel
from tests.web.served import served
from tests.web.test_hostile import Neighbour
from tests.worlds import faulty, hidden

FAILING = count(len(faulty.FAULTS), int(os.environ.get("MINIHUMAN_FAULTY_SESSIONS", "1000")))  # an hour if busy
OTHERS = count(2, 10)
AT_ONCE = 8  # failing sessions
EPISODES = count(2, 20)
MS = 1_000_000
FAULTY = f"{faulty.__name__}:tests/Faulty-v0"
HIDDEN = f"{hidden.__name__}:tests/Hidden-v0"

_STUDY = """
[study]
name = "faults"
version = "1"
seed = 5
participants = 2000
[keys]
keyboard_check = false
[web]
image_size_px = [96, 96]
max_unconsented_per_address = 2000
max_concurrent_sessions = 2000
"""
_GROUP = """
[[groups]]
name = "{name}"
blocks = ["{name}"]
[[blocks]]
name = "{name}"
world = "{world}"
episodes = {episodes}
max_steps = 4
final_frame_ms = 0
actions = ["0", "1"]
success = "none"
"""


class _GuardedHost:
    """A session host whose messages are taken as a socket's are."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection

    def receive(self, number: int, at_ns: int, message: Any) -> None:
        """Take a message; a world's error ends the session."""
        self._connection._call_or_end(self._connection.host.receive, number, at_ns, message)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._connection.host, name)


@dataclass
class _Server:
    """A server with a study in which every participant's world fails in one way."""

    tokens: list[str]  # links of people who have not come
    factory: ConnectionFactory

    async def arrive(self) -> Connection:
        """Let a page come."""
        facts = {"browser": "Chromium", "window_px": "1600 x 900"}
        hello = Hello(MESSAGE_VERSION, self.tokens.pop(), facts=facts)
        connection = await self.factory.connect(hello, "127.0.0.1")
        assert isinstance(connection, Connection)
        return connection


def _serve(
    folder: Path,
    fault: str,
    worlds: IsolatedWorlds | None,
    *,
    episodes: int = 1,
    world: str = FAULTY,
    facts: Mapping[str, str] = MappingProxyType({}),
) -> _Server:
    """Start a server; several of them in one loop stand for one whose participants' worlds fail in different ways."""
    text = _STUDY + _GROUP.format(name="all", world=world, episodes=episodes)
    if fault:
        text += f'options = {{ fault = "{fault}" }}\n'
    protocol = decode_protocol(text.encode())
    data = folder / (fault or "well")
    factory = ConnectionFactory(Arrivals(protocol, data), data, {}, worlds=worlds)
    factory.facts = {"player": "human", **collect_machine_facts(), **facts}
    return _Server(Recruitment(data / "faults").issue(count(8, 1_000)), factory)


async def _play(server: _Server, *, episodes: int = 1) -> Path:
    """Play a session to its end, in its thread; return its log."""
    connection = await server.arrive()
    keys = ["enter", *connection.host.session.plan.key_pool] * (8 + 4 * episodes)  # one that means nothing is let pass
    presses = [((1 + number) * 400 * MS, key, True) for number, key in enumerate(keys)]
    page = PageModel(_GuardedHost(connection), presses, frame_ns=16 * MS)
    await connection.run(page.run)
    assert connection.host.over, connection.host.session.screen
    await asyncio.to_thread(connection.finish)
    await connection.run(connection.host.close)
    assert connection.recording.log is not None
    return connection.recording.log


def _require_whole(log: Path, episodes: int) -> None:
    session = read_log(log)
    assert session.end_reason == "complete"
    assert [len(episode.actions) for episode in session.episodes] == [4] * episodes
    assert sum(isinstance(event, FrameShown) for event in read_events(log)) == 4 * episodes  # all but the last
    assert list(find_log_differences(log, World)) == []


@pytest.mark.nightly(sample=True)
def test_no_session_notices_the_faults_of_others_worlds(tmp_path: Path) -> None:
    drawn = np.random.default_rng(47).permutation(np.resize(faulty.FAULTS, FAILING))
    limits = WorldLimits(step_s=5.0)

    async def play_all(worlds: IsolatedWorlds) -> tuple[list[Path], list[Path]]:
        servers = {fault: _serve(tmp_path, fault, worlds) for fault in faulty.FAULTS}
        well = _serve(tmp_path, "", worlds, episodes=EPISODES)
        turns = asyncio.Semaphore(AT_ONCE)

        async def play_in_turn(fault: str) -> Path:
            async with turns:
                return await _play(servers[fault])

        failing = asyncio.gather(*(play_in_turn(str(fault)) for fault in drawn))
        others = [asyncio.create_task(_play(well, episodes=EPISODES)) for _ in range(OTHERS)]
        return await failing, await asyncio.gather(*others)

    with closing(IsolatedWorlds(PageWorld, limits)) as worlds:
        failing, others = asyncio.run(play_all(worlds))
        print(worlds.pool.use)
    assert len(set(failing)) == FAILING
    for log in others:
        _require_whole(log, EPISODES)
    for fault, log in zip(drawn, failing, strict=True):
        if fault == "nan":
            _require_whole(log, 1)
        else:
            _require_failed(log, str(fault))


def _require_failed(log: Path, fault: str) -> None:
    session = read_log(log)
    assert session.end_reason == "world_error", fault
    [episode] = session.episodes
    shown_before_it_fails = faulty.FAULT_STEP if fault == "shape" else faulty.FAULT_STEP - 1
    assert len(episode.actions) == shown_before_it_fails, fault


@pytest.mark.parametrize("fault", ["raise", "os_exit", "none"])
def test_a_log_whose_world_failed_verifies(fault: str, tmp_path: Path) -> None:
    with closing(IsolatedWorlds(PageWorld)) as worlds:
        log = asyncio.run(_play(_serve(tmp_path, fault, worlds)))
    _require_failed(log, fault)
    assert list(find_log_differences(log, World)) == []


def test_others_play_to_their_end_while_a_world_hangs(tmp_path: Path) -> None:
    async def play() -> tuple[bool, Sequence[Path]]:
        hung = asyncio.create_task(_play(_serve(tmp_path, "hang", worlds)))
        await asyncio.sleep(0)
        well = _serve(tmp_path, "", worlds)
        logs = await asyncio.gather(_play(well), _play(well))
        was_hanging = not hung.done()
        worlds.close()  # its process is ended, as it will not answer
        return was_hanging, [*logs, await hung]

    with closing(IsolatedWorlds(PageWorld, WorldLimits(step_s=600.0))) as worlds:
        was_hanging, (first, second, failed) = asyncio.run(play())
    assert was_hanging
    _require_whole(first, 1)
    _require_whole(second, 1)
    _require_failed(failed, "hang")


@pytest.mark.program
def test_a_served_session_in_a_process_of_its_own_is_proven_and_its_use_is_printed(tmp_path: Path) -> None:
    with served(tmp_path, episodes=50, world=("CartPole-v1", ("left", "right"))) as server:
        neighbour = Neighbour(server, server.links[0])
        counts = neighbour.leaves()
        server.process.terminate()
        assert server.process.stdout is not None
        printed = server.process.stdout.read()
    assert counts.presses >= 12
    assert "worlds in processes of their own: 1, each with" in printed
    assert "Traceback" not in server.complaints()
    assert "leaked" not in server.complaints()
    [part] = (tmp_path / "data").rglob("*.mcap*")
    steps = sum(isinstance(event, Stepped) for event in read_events(part))
    assert steps > 0


@pytest.mark.parametrize("isolated", [False, True], ids=["in process", "isolated"])
def test_pictures_that_were_shown_are_drawn_again_and_equal(isolated: bool, tmp_path: Path) -> None:
    with closing(IsolatedWorlds(PageWorld)) as worlds:
        log = asyncio.run(_play(_serve(tmp_path, "", worlds if isolated else None, episodes=2), episodes=2))
    assert verify_pictures(read_log(log)) == PictureVerification("equal", 8)
    assert ("pictures equal: 8 that were shown, drawn again", True) in list(verify_session(log))


def test_pictures_that_the_seed_does_not_govern_are_different(tmp_path: Path) -> None:
    log = asyncio.run(_play(_serve(tmp_path, "", None, world=HIDDEN)))
    verification = verify_pictures(read_log(log))
    assert verification is not None
    assert verification.verdict == "different"
    lines = dict(verify_session(log))
    assert lines[str(verification)] is False
    assert lines["1 episodes, 4 steps, all as logged"] is True, "numbers have a verdict of their own"


def test_pictures_of_another_version_are_not_comparable(tmp_path: Path) -> None:
    log = asyncio.run(_play(_serve(tmp_path, "", None, world=HIDDEN, facts={"version_numpy": "0.1"})))
    verification = verify_pictures(read_log(log))
    assert verification is not None
    assert verification.verdict == "not comparable"
    assert "numpy 0.1, here" in verification.detail


def test_a_log_without_hashes_says_that_pictures_are_not_recorded(tmp_path: Path) -> None:
    log = read_log(asyncio.run(_play(_serve(tmp_path, "", None))))
    frames = [replace(frame, picture_hash=0) for frame in log.episodes[0].frames]
    old = replace(log.episodes[0], frames=EventColumns.of(FrameShown, frames))
    verification = verify_pictures(replace(log, episodes=(old,)))
    assert verification == PictureVerification("not recorded")


def test_a_picture_that_was_changed_in_the_log_is_different(tmp_path: Path) -> None:
    log = read_log(asyncio.run(_play(_serve(tmp_path, "", None))))
    frames = [replace(frame, picture_hash=frame.picture_hash ^ (frame.step == 2)) for frame in log.episodes[0].frames]
    changed = replace(log.episodes[0], frames=EventColumns.of(FrameShown, frames))
    verification = verify_pictures(replace(log, episodes=(changed,)))
    assert verification is not None
    assert verification.verdict == "different"
    assert "step 2: " in verification.detail
