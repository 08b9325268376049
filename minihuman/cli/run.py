"""Commands that run sessions: run, serve, simulate, watch."""

import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

from minihuman.cli.options import (
    DataFolder,
    ExperimenterOption,
    Option,
    ProtocolFile,
    ReasonOption,
    StudyFolder,
    TrustOption,
    ask_reason,
    ask_trust,
    show_progress,
)
from minihuman.trust import Permission


def run(
    protocol: ProtocolFile,
    participant: Annotated[
        str | None, Option(help="The participant's code, such as sub-07; by default the next free slot.")
    ] = None,
    group: Annotated[str | None, Option(help="Use this group instead of the allocated one.")] = None,
    session: Annotated[int, Option(min=1, help="The number of the session.")] = 1,
    any_day: Annotated[bool, Option(help="Ignore the days required between sessions.")] = False,
    next_slot: Annotated[
        bool, Option("--next-slot", help="Take the next slot, even if an interrupted session could be resumed.")
    ] = False,
    reason: ReasonOption = "",
    experimenter: ExperimenterOption = "",
    data: DataFolder = Path("sessions"),
    window: Annotated[str, Option(help="The kind of window: auto, pygame, pyglet or a plug-in's name.")] = "auto",
    fullscreen: Annotated[bool, Option("--fullscreen/--windowed", help="Use the whole screen or a window.")] = True,
    lsl: Annotated[bool, Option("--lsl", help="Send markers through the Lab Streaming Layer.")] = False,
    trust: TrustOption = False,
) -> None:
    """Run a participant's session, or resume one.

    If a session was interrupted, ask on a terminal whether to resume it; elsewhere, stop and name the command that
    does.

    Example: minihuman run protocols/fourrooms-transfer.toml --participant sub-07
    """
    from minihuman.runtime.host import describe_ending
    from minihuman.workflow import run as run_session

    if participant is None and not next_slot and (found := _ask_interrupted(protocol, data, ask_trust(trust))):
        participant, session = found
    next_slot = next_slot or sys.stdin.isatty()  # who was asked has answered
    if group is not None or any_day:
        reason = ask_reason(reason)
    with ExitStack() as stack:
        show = stack.enter_context(show_progress(""))
        log = run_session(
            protocol,
            participant=participant,
            group=group,
            session=session,
            any_day=any_day,
            next_slot=next_slot,
            reason=reason,
            experimenter=experimenter,
            data=data,
            window=window,
            fullscreen=fullscreen,
            lsl=lsl,
            trust=ask_trust(trust),
            on_progress=lambda line: show(line) if line else stack.close(),
            on_start=lambda line: print(line, flush=True),
        )
    if log is None:
        print("the session ended before anything was recorded; the slot is free again")
        return
    print(describe_ending(log, protocol))
    print(log)


def _ask_interrupted(protocol: Path, data: Path, trust: Permission) -> tuple[str, int] | None:
    """Ask on a terminal whether to resume a session that was cut off: the participant and the session, or None."""
    if not sys.stdin.isatty():
        return None
    import click

    from minihuman.admin.next_session import find_interrupted_session
    from minihuman.admin.protocol_file import read_protocol

    found = find_interrupted_session(data / read_protocol(protocol, trust=trust).study.name)
    done = found and f"{found.episodes_completed} of {found.episodes_planned} episodes"
    if found is None or not click.confirm(
        f"Session {found.session} of {found.participant} was cut off after {done}. Resume it?", default=True
    ):
        return None
    return found.participant, found.session


def serve(
    protocol: ProtocolFile,
    port: Annotated[int, Option(min=0, max=65535, help="The port; 0 chooses a free one.")] = 8000,
    data: DataFolder = Path("sessions"),
    links: Annotated[int, Option(min=0, help="The number of new links, one per participant.")] = 1,
    address: Annotated[
        str, Option(help="The public base URL for the participants' links, such as https://study.example.org.")
    ] = "",
    workers: Annotated[
        int, Option(min=1, max=64, help="The number of server processes; they use this port and the ones after it.")
    ] = 1,
    watch: Annotated[bool, Option("--watch", help="Also serve the experimenter's page.")] = False,
    trust: TrustOption = False,
) -> None:
    """Serve a study to participants in a browser.

    Print the links and serve until Ctrl-C is pressed.

    Example: minihuman serve protocols/fourrooms-transfer.toml --links 20 --watch
    """
    from minihuman.admin.legibility import require_legible
    from minihuman.admin.protocol_file import read_protocol
    from minihuman.runtime.warm_up import warm_up
    from minihuman.web.server.process import (
        keep_processes_running,
        list_process_commands,
        open_listening_socket,
        require_browser_support,
        run_server,
    )

    study = read_protocol(protocol, trust=ask_trust(trust))
    require_browser_support(study)
    with show_progress(f"getting the worlds of {study.study.name} ready"):
        warm_up(study, str(protocol))
        require_legible(study, str(protocol))
    socket = open_listening_socket(port)
    others = list_process_commands(protocol, data / study.study.name, port=port, workers=workers, watch=watch)
    with keep_processes_running(others):
        run_server(study, data, socket, links=links, address=address, say=lambda line: print(line, flush=True))
    print("ended; unfinished sessions resume at the same step when the study is served again", flush=True)


def deploy(
    protocol: ProtocolFile,
    address: Annotated[str, Option(help="The public base URL, such as https://study.example.org.")],
    out: Annotated[Path, Option(help="The folder to write.")] = Path("deployment"),
    workers: Annotated[int, Option(min=1, max=64, help="The number of server processes.")] = 1,
    postgres: Annotated[bool, Option("--postgres", help="Keep enrolment and arrivals in a database.")] = False,
    bucket: Annotated[str, Option(help="Copy finished logs to an object store, such as s3://logs/study.")] = "",
) -> None:
    """Write a folder from which a study is served.

    It holds a container file, a compose file with Caddy, a Caddyfile, a systemd unit and what to do with them. Nothing
    is started.

    Example: minihuman deploy protocols/online.toml --address https://study.example.org --out online
    """
    from minihuman.admin.protocol_file import read_protocol
    from minihuman.web.deployment import Deployment, write_deployment
    from minihuman.web.server.process import require_browser_support

    study = read_protocol(protocol)
    require_browser_support(study)
    for path in write_deployment(study, out, Deployment(address, workers, postgres, bucket)):
        print(path)


def simulate(
    protocol: ProtocolFile,
    participants: Annotated[int, Option(min=1, help="The number of participants; they take the next free slots.")] = 10,
    data: DataFolder = Path("sessions"),
    seed: Annotated[int, Option(min=0, help="The random seed of the simulated participants.")] = 0,
    player: Annotated[
        str,
        Option(
            help="The simulated participant: human-like, optimal, random, supervisor or a plug-in; "
            "settings as in human-like:lapse=0.1."
        ),
    ] = "human-like",
    trust: TrustOption = False,
) -> None:
    """Run a study with simulated participants.

    The sessions are the same as for participants, but without a window or waiting.

    Example: minihuman simulate protocols/fourrooms-transfer.toml --participants 10 --data /tmp/trial
    """
    from minihuman.workflow import simulate as simulate_sessions

    with show_progress("") as progress:
        played = simulate_sessions(
            protocol,
            participants=participants,
            data=data,
            seed=seed,
            player=player,
            trust=ask_trust(trust),
            on_progress=progress,
        )
        for path in played:
            print(path, flush=True)


def watch(
    study: StudyFolder,
    port: Annotated[int, Option(min=0, max=65535, help="The port of the page; 0 chooses a free one.")] = 0,
) -> None:
    """Watch running sessions on a local web page.

    The page shows pictures, keys and reaction times; you can take notes there, and pause or abort a session. It reads
    the live logs, so it can be stopped and started at any time.

    Example: minihuman watch sessions/fourrooms-transfer
    """
    from minihuman.operating_system import lower_process_priority
    from minihuman.runtime.watch.dashboard import DashboardServer

    server = DashboardServer(study, port)
    lower_process_priority()  # the sessions come first
    print(f"open {server.url}   (Ctrl-C ends it; the sessions go on)", flush=True)
    try:
        server.serve()
    except KeyboardInterrupt:
        print()
