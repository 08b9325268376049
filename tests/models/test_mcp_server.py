"""A model that plays by calling tools: the MCP client library takes a session to its end over the standard streams."""

import asyncio
import base64
import io
import json
import os
import sys
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest
from PIL import Image

from minihuman import verify
from minihuman.admin.protocol_file import read_protocol
from minihuman.log.read.session_reader import read_log
from minihuman.web import agent_server
from minihuman.web.agent_server import ProgramSessions, make_mcp_server
from tests.counts import PATIENCE_S
from tests.models.studies import study
from tests.models.test_agent_server import answer_of, stays_away as stays_away

if TYPE_CHECKING:
    from mcp import Client
    from mcp.types import CallToolResult


def read(result: "CallToolResult") -> tuple[dict[str, Any], bytes | None]:
    """A screen and its picture."""
    from mcp.types import ImageContent, TextContent

    assert not result.is_error, result
    text, *pictures = result.content
    assert isinstance(text, TextContent)
    found = [base64.b64decode(one.data) for one in pictures if isinstance(one, ImageContent)]
    return json.loads(text.text), (found or [None])[0]


async def play(client: "Client") -> list[tuple[dict[str, Any], bytes | None]]:
    """Play a session; every screen with its picture."""
    shown = [read(await client.call_tool("begin", {"name": "tool-user"}))]
    session = shown[0][0]["session"]
    while (screen := shown[-1][0])["over"] is None:
        answer = {"session": session, "number": screen["number"], "answer": answer_of(screen)}
        shown.append(read(await client.call_tool("answer", answer)))
    return shown


@pytest.mark.program
def test_a_client_of_the_protocol_plays_a_session_that_verifies(tmp_path: Path) -> None:
    from mcp import Client, StdioServerParameters

    (tmp_path / "study.toml").write_text(study())
    command = ["-m", "minihuman", "serve", "study.toml", "--agents", "--mcp", "--data", "data"]
    server = StdioServerParameters(command=sys.executable, args=command, cwd=tmp_path, env=dict(os.environ))

    async def talk() -> list[tuple[dict[str, Any], bytes | None]]:
        async with Client(server) as client:
            names = [tool.name for tool in (await client.list_tools()).tools]
            assert names == ["begin", "answer", "read_screen"]
            return await play(client)

    shown = asyncio.run(talk())
    assert shown[-1][0]["over"] == "complete"
    screen, picture = shown[1]
    assert (screen["screen"], screen["keys"]) == ("play", ["1", "2", "3"])
    assert screen["observation"]["image"]
    assert picture is not None
    assert Image.open(io.BytesIO(picture)).size == (640, 480)
    (log,) = map(read_log, (tmp_path / "data").rglob("*.mcap"))
    assert (log.player, log.end_reason, len(log.episodes)) == ("http:tool-user", "complete", 2)
    assert all(line.ok for line in verify(tmp_path / "data"))


async def read_error(client: "Client", tool: str, **arguments: Any) -> str:
    """The words that a client reads of a call that was refused."""
    from mcp.types import TextContent

    answer = await client.call_tool(tool, arguments)
    assert answer.is_error
    (text,) = answer.content
    assert isinstance(text, TextContent)
    return text.text.removeprefix(f"Error executing tool {tool}: ")  # by which the SDK introduces it


def test_a_client_reads_why_its_call_was_refused_and_the_mistake_costs_nothing(
    tmp_path: Path, stays_away: threading.Event, monkeypatch: pytest.MonkeyPatch
) -> None:
    from mcp import Client

    monkeypatch.setattr(agent_server, "MAX_SESSIONS", 1)
    (tmp_path / "study.toml").write_text(study(model="timeout_s = 1.0"))
    programs = ProgramSessions(read_protocol(tmp_path / "study.toml"), tmp_path / "data")
    no_session = "this session does not exist; begin a session first"

    async def talk() -> None:
        async with Client(make_mcp_server(programs)) as client:
            for name in ("a\nb", "", "n" * (agent_server.MAX_NAME + 1)):
                error = f"name is not a text of 1 to {agent_server.MAX_NAME} printable characters; send such a name"
                assert await read_error(client, "begin", name=name) == error
            assert await read_error(client, "read_screen", session="guessed") == no_session
            assert await read_error(client, "answer", session="guessed", number=1, answer="1") == no_session
            assert not (tmp_path / "data").exists()
            first, _ = read(await client.call_tool("begin", {"name": "tool-user"}))
            again, _ = read(await client.call_tool("read_screen", {"session": first["session"]}))
            assert again == {name: value for name, value in first.items() if name != "session"}
            late = await read_error(client, "answer", session=first["session"], number=7, answer="go_on")
            assert late == "screen 7 does not wait for an answer; call read_screen"
            busy = await read_error(client, "begin", name="another")
            assert busy == "1 sessions run already; try again later"

    asyncio.run(talk())
    stays_away.set()
    for thread in programs.threads:
        thread.join(PATIENCE_S)
