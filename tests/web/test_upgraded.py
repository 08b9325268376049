"""The package is replaced while a server runs: it goes on as it was, and what it recorded is proven by the new one."""

import asyncio
import json
import shutil
import subprocess
import sys
from contextlib import closing
from http.client import HTTPConnection
from pathlib import Path

import pytest
from websockets.sync.client import connect

import minihuman
from minihuman.admin.next_session import plan_next_session
from minihuman.admin.verify.log import find_log_differences
from minihuman.errors import LogError
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.log.read.session_reader import read_log
from minihuman.log.record.disk import GroupCommit
from minihuman.web.hosted_session import HostedSession, HostStorage, resume_host, start_host
from minihuman.web.messages import MESSAGE_VERSION
from minihuman.web.outbox import PageSettings
from minihuman.worlds.adapters.world import World
from tests.counts import PATIENCE_S
from tests.web.page_model import PageModel
from tests.web.protocols import study
from tests.web.served import served
from tests.web.typed_page import TypedPage

MS = 1_000_000
RULES = {"rules": "ours", "pictures": "2", "version_minihuman": "1"}
SETTINGS = PageSettings(picture_px=(96, 96))


def installed_in(folder: Path) -> Path:
    """A copy of the package, as an environment has it."""
    skipped = shutil.ignore_patterns("__pycache__", "protocols")
    return Path(shutil.copytree(Path(minihuman.__file__).parent, folder / "minihuman", ignore=skipped))


def replace(package: Path) -> None:
    """Put a package there that has nothing in common with it: whatever is still taken from there is noticed."""
    for path in package.rglob("*"):
        if path.suffix == ".py":
            path.write_text("raise ImportError('this is of another release')\n")
        elif path.suffix in (".js", ".css", ".html", ".toml"):
            path.write_text("of another release")


def asked(host: str, address: str) -> str:
    with closing(HTTPConnection(host)) as line:
        line.request("GET", address)
        return line.getresponse().read().decode()


@pytest.mark.program
def test_a_server_goes_on_as_it_began_while_its_package_is_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    package = installed_in(tmp_path / "site")
    monkeypatch.setenv("PYTHONPATH", str(package.parent))
    monkeypatch.setenv("PYTHONSAFEPATH", "1")  # not what lies in the present folder
    where = subprocess.run([sys.executable, "-c", "import minihuman; print(minihuman.__file__)"], **_CAPTURED)
    assert where.stdout.strip() == str(package / "__init__.py")
    with served(tmp_path / "study", links=2, web='codes = { complete = "C1" }') as server:
        page = asked(server.host, "/static/page.js")
        first, second = (TypedPage(server.host, token, keys_per_s=15) for token in server.links)
        asyncio.run(asyncio.wait_for(_plays_across(first, package), PATIENCE_S))
        assert first.told["code"] == "C1"
        assert asked(server.host, "/static/page.js") == page, "the page of another release"
        asyncio.run(asyncio.wait_for(second.take_part(), PATIENCE_S))
        assert second.told["code"] == "C1", "somebody who came after it was replaced"
        assert "Traceback" not in server.complaints()
        logs = sorted(server.said.parent.rglob("*.mcap"))
    assert len(logs) == 2
    for path in logs:
        assert read_log(path).end_reason == "complete"
        assert list(find_log_differences(path, World)) == []


async def _plays_across(page: TypedPage, package: Path) -> None:
    playing = asyncio.create_task(page.take_part())
    while page.counts.presses < 3:
        assert not playing.done(), page.counts
        await asyncio.sleep(0.02)
    replace(package)
    await playing


_CAPTURED = {"capture_output": True, "text": True, "check": True}


@pytest.mark.program
def test_a_page_of_another_release_is_told_to_load_itself_again(tmp_path: Path) -> None:
    with served(tmp_path) as server, connect(f"ws://{server.host}/socket", origin=f"http://{server.host}") as socket:
        socket.send(json.dumps({"t": "hello", "version": MESSAGE_VERSION + 1, "token": server.links[0], "stream": "a"}))
        assert json.loads(socket.recv())["reason"] == "old"
        with pytest.raises(Exception, match="4002"):
            socket.recv()


@pytest.mark.parametrize("changed", [*RULES, "world_sha256_lab"])
def test_a_log_is_gone_on_with_by_the_rules_that_it_began_with_or_in_a_segment_of_its_own(
    tmp_path: Path, changed: str
) -> None:
    protocol = decode_protocol(study(tmp_path).read_bytes())
    disk = HostStorage(protocol, tmp_path, GroupCommit())
    made = start_host(plan_next_session(protocol, tmp_path), disk, RULES, SETTINGS, at_sync=lambda: None)
    keys = ["enter", "1", "2", "3", "1"]
    presses = [(number * 400 * MS, key, True) for number, key in enumerate(keys, 1)]
    PageModel(made.host, presses, frame_ns=16 * MS).run()
    leave(made)
    [part] = tmp_path.rglob("*.part")
    again = resume_host(part, disk, RULES, SETTINGS, at_sync=lambda: None)
    assert again.host.session.play is not None
    assert again.host.session.play.steps > 0
    leave(again)
    with pytest.raises(LogError, match=f"was recorded with {changed}"):
        resume_host(part, disk, {**RULES, changed: "theirs"}, SETTINGS, at_sync=lambda: None)
    later = plan_next_session(protocol, tmp_path, participant="sub-01")
    assert (later.segment, later.first_episode) == (2, 0), "the episode is begun again, in a segment of its own"


def leave(made: HostedSession) -> None:
    made.host.close()
    for file in made.files:
        file.leave()
