"""A program's seat as tools of the Model Context Protocol, for a language model that plays by calling tools (extra
``mcp``).

The sessions, screens, numbers and bounds are those of the HTTP face in `agent_server`.
"""

import base64
import json
from typing import Any

from mcp.server.mcpserver import Image, MCPServer

from minihuman.simulation.model_seat import RULES
from minihuman.web.agent_server import MAX_NAME, MAX_SESSIONS, ProgramClient, ProgramSeats, is_valid_name

_INSTRUCTIONS = (
    f"{RULES.partition('. ')[0]}. Call begin once, with a name of your own, then answer with each screen's number "
    "until over says how the session ended. A screen's text ends with what can be answered."
)


def make_mcp_server(seats: ProgramSeats) -> MCPServer:
    """Make the server; ``run()`` serves one client on the standard input and output."""
    server = MCPServer("minihuman", instructions=_INSTRUCTIONS)

    def find(session: str) -> ProgramClient:
        if session not in seats.clients:
            raise ValueError("there is no such session; begin one")
        return seats.clients[session]

    @server.tool(structured_output=False)
    def begin(name: str) -> list[Any]:
        """Begin a session, or resume one of that name that was left; return its secret and the first screen."""
        if not is_valid_name(name):
            raise ValueError(f"name is a text of 1 to {MAX_NAME} characters")
        begun = seats.begin(name)
        if begun is None:
            raise ValueError(f"{MAX_SESSIONS} sessions run already; try again later")
        secret, client = begun
        return _show(client, session=secret)

    @server.tool(structured_output=False)
    def answer(session: str, number: int, answer: str) -> list[Any]:
        """Answer the screen of that number; return the next one."""
        client = find(session)
        if not client.answer(number, answer):
            raise ValueError(f"screen {number} does not wait for an answer; call read_screen")
        return _show(client)

    @server.tool(structured_output=False)
    def read_screen(session: str) -> list[Any]:
        """Read the screen again."""
        return _show(find(session))

    return server


def _show(client: ProgramClient, **more: str) -> list[Any]:
    """A screen as JSON, and its picture."""
    screen = client.read_screen()
    png = screen.pop("picture_png", None)
    picture = [] if png is None else [Image(data=base64.b64decode(png), format="png")]
    return [json.dumps(more | screen), *picture]
