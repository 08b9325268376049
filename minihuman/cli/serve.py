"""The command that lets people take part in a browser: serve."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from minihuman.cli.declared import Option
from minihuman.cli.session import DataFolder, ProtocolFile
from minihuman.cli.waiting import waiting

if TYPE_CHECKING:
    from typer import Typer


def add_to(app: "Typer") -> None:
    """Add this command."""
    from minihuman.cli.typed import add

    add(app, serve)


def serve(
    protocol: ProtocolFile,
    port: Annotated[int, Option(min=0, max=65535, help="Where on this machine; 0 takes a free one.")] = 8000,
    data: DataFolder = Path("sessions"),
    links: Annotated[int, Option(min=0, help="So many new links, one a participant.")] = 1,
    address: Annotated[str, Option(help="Of the proxy in front, for the links: https://study.example.org")] = "",
    workers: Annotated[int, Option(min=1, max=64, help="Processes, on this port and those after it.")] = 1,
    watch: Annotated[bool, Option("--watch", help="Open the experimenter's page, too.")] = False,
) -> None:
    """Let people take part in a browser: print links, and serve the study on this machine until Ctrl-C.

    Example: minihuman serve protocols/fourrooms-transfer.toml --links 20 --watch
    """
    from minihuman.lab.legible import refuse_unreadable
    from minihuman.lab.protocol_file import read_protocol
    from minihuman.seats.warm_up import warm_up
    from minihuman.web.running import listen, refuse_unserved, run
    from minihuman.web.workers import beside, other_processes

    study = read_protocol(protocol)
    refuse_unserved(study)
    with waiting(f"getting the worlds of {study.study.name} ready"):
        warm_up(study, str(protocol))
        refuse_unreadable(study, str(protocol))
    socket = listen(port)
    others = other_processes(protocol, data / study.study.name, port=port, workers=workers, watch=watch)
    with beside(others):
        run(study, data, socket, links=links, address=address, say=lambda line: print(line, flush=True))
    print("ended; whoever was not done goes on at the very step when the study is served again", flush=True)
