"""Commands that run sessions: run, serve, simulate, watch, desk, deploy."""

import sys
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

from minihuman.cli.options import (
    Argument,
    DataFolder,
    ExperimenterOption,
    IsolationOption,
    Option,
    ProtocolFile,
    ReasonOption,
    StudyFolder,
    TrustOption,
    ask_reason,
    ask_trust,
    show_progress,
)
from minihuman.errors import SimulationError, name_output_when_full
from minihuman.trust import Permission


def run(
    protocol: ProtocolFile,
    participant: Annotated[
        str | None, Option(help="The participant's code, such as sub-07; by default, the code of the next free slot.")
    ] = None,
    group: Annotated[str | None, Option(help="Use this group instead of the allocated one.")] = None,
    session: Annotated[int, Option(min=1, help="The number of the participant's session to run, such as 2.")] = 1,
    any_day: Annotated[bool, Option(help="Ignore the days required between sessions.")] = False,
    next_slot: Annotated[
        bool, Option("--next-slot", help="Take the next slot, even if an interrupted session could be resumed.")
    ] = False,
    reason: ReasonOption = "",
    experimenter: ExperimenterOption = "",
    data: DataFolder = Path("sessions"),
    window: Annotated[str, Option(help="The kind of window: auto, pygame, pyglet or a plug-in's name.")] = "auto",
    fullscreen: Annotated[bool, Option("--fullscreen/--windowed", help="Run in full screen or in a window.")] = True,
    lsl: Annotated[bool, Option("--lsl", help="Send event markers through the Lab Streaming Layer.")] = False,
    isolate_worlds: IsolationOption = False,
    trust: TrustOption = False,
) -> None:
    """Run a participant's session, or resume one.

    If a session was interrupted, you are asked on a terminal whether to resume it; without a terminal, the command
    stops and names the command that resumes it.

    Example: minihuman run protocols/fourrooms-transfer.toml --participant sub-07
    """
    from minihuman.api import run as run_session
    from minihuman.runtime.host import describe_ending

    if participant is None and not next_slot and (interrupted := _ask_to_resume(protocol, data, ask_trust(trust))):
        participant, session = interrupted
    next_slot = next_slot or sys.stdin.isatty()  # on a terminal the question has been answered
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
            isolate_worlds=isolate_worlds,
            trust=ask_trust(trust),
            on_progress=lambda line: show(line) if line else stack.close(),  # no line: the session begins
            on_start=lambda line: print(line, flush=True),
        )
    if log is None:
        print("the session ended before anything was recorded; the slot is free again")
        return
    print(describe_ending(log, protocol))
    print(log)


def _ask_to_resume(protocol: Path, data: Path, trust: Permission) -> tuple[str, int] | None:
    """Ask on a terminal whether to resume an interrupted session of a study, if there is one.

    Args:
        protocol: the file of the study's protocol.
        data: the folder that contains the studies' folders.
        trust: the permission to run the protocol's Python code.

    Returns:
        The participant's code and the session's number; None without a terminal, an interrupted session or consent.
    """
    if not sys.stdin.isatty():
        return None
    import click

    from minihuman.admin.next_session import find_interrupted_session
    from minihuman.admin.protocol_file import read_protocol

    interrupted = find_interrupted_session(data / read_protocol(protocol, trust=trust).study.name)
    if interrupted is None:
        return None
    progress = f"{interrupted.episodes_completed} of {interrupted.episodes_planned} episodes"
    question = f"Session {interrupted.session} of {interrupted.participant} was cut off after {progress}. Resume it?"
    if not click.confirm(question, default=True):
        return None
    return interrupted.participant, interrupted.session


def serve(
    protocol: ProtocolFile,
    port: Annotated[int, Option(min=0, max=65535, help="The port to serve on; 0 chooses a free one.")] = 8000,
    data: DataFolder = Path("sessions"),
    links: Annotated[int, Option(min=0, help="The number of new links to create, one per participant.")] = 1,
    address: Annotated[
        str, Option(help="The public base URL for the participants' links, such as https://study.example.org.")
    ] = "",
    workers: Annotated[
        int,
        Option(min=1, max=64, help="The number of server processes; they use consecutive ports, starting at --port."),
    ] = 1,
    host: Annotated[
        str, Option(help="The address to listen on; 0.0.0.0 is every address of this machine, as in a container.")
    ] = "127.0.0.1",
    watch: Annotated[
        bool, Option("--watch", help="Also serve the page on which the experimenter watches sessions.")
    ] = False,
    agents: Annotated[
        bool, Option("--agents", help="Serve the study as JSON over HTTP, to programs on this machine only.")
    ] = False,
    mcp: Annotated[
        bool, Option("--mcp", help="With --agents, serve one program on the standard input and output, as MCP tools.")
    ] = False,
    worlds_in_process: Annotated[
        bool,
        Option(
            "--worlds-in-process",
            help="Run worlds that are not minihuman's own in the server's process, where one can end all sessions.",
        ),
    ] = False,
    world_step_timeout: Annotated[
        float, Option(min=0.1, help="The seconds that a step of a world in its own process may take.")
    ] = 5.0,
    world_start_timeout: Annotated[
        float, Option(min=0.1, help="The seconds that its construction, and each reset, may take.")
    ] = 60.0,
    world_memory: Annotated[int, Option(min=64, help="The memory that it may use, in MiB.")] = 4096,
    trust: TrustOption = False,
) -> None:
    """Serve a study to participants in a browser.

    Print the links and serve until Ctrl-C is pressed.

    Example: minihuman serve protocols/fourrooms-transfer.toml --links 20 --watch
    """
    if agents or mcp:
        _serve_agents(protocol, port, data, trust=trust, mcp=mcp)
        return
    from minihuman.admin.legibility import require_legible
    from minihuman.admin.protocol_file import read_protocol
    from minihuman.experiment.plan.dry_run import check_worlds
    from minihuman.web.computed import PageWorld
    from minihuman.web.server.process import (
        keep_processes_running,
        list_limit_options,
        list_process_commands,
        open_listening_socket,
        require_browser_support,
        run_server,
    )
    from minihuman.worlds.isolation.isolated_world import IsolatedWorlds
    from minihuman.worlds.isolation.process_pool import WorldLimits

    study = read_protocol(protocol, trust=ask_trust(trust))
    require_browser_support(study)
    with show_progress(f"getting the worlds of {study.study.name} ready"):
        check_worlds(study, str(protocol))
        require_legible(study, str(protocol))
    socket = open_listening_socket(port, host)
    if workers > 1:
        from minihuman.runtime.team_seating import require_one_process

        require_one_process(study, "in several server processes; leave out --workers")
    limits = WorldLimits(world_step_timeout, world_start_timeout, world_memory)
    options: Sequence[str] = ("--worlds-in-process",)
    if not worlds_in_process:
        options = list_limit_options(limits)
    commands = list_process_commands(
        protocol,
        data / study.study.name,
        port=port,
        workers=workers,
        watch=watch,
        host=host,
        options=options,
    )
    worlds: IsolatedWorlds | None = None
    if not worlds_in_process:
        worlds = IsolatedWorlds(PageWorld, limits)
    try:
        with keep_processes_running(commands):
            run_server(study, data, socket, links=links, address=address, say=_print_line, worlds=worlds)
    finally:  # also after SIGTERM
        if worlds is not None:
            worlds.close()
            _print_line(str(worlds.pool.use))
    print("ended; unfinished sessions resume at the same step when the study is served again", flush=True)


def _print_line(line: str) -> None:
    """Print a line at once, unless it is empty."""
    if line:
        print(line, flush=True)


def _serve_agents(protocol: Path, port: int, data: Path, *, trust: bool, mcp: bool) -> None:
    """Serve a study to programs over HTTP or, if ``mcp``, to one program on the standard input and output.

    Args:
        protocol: the file of the study's protocol.
        port: the port for HTTP; 0 chooses a free one.
        data: the folder that contains the studies' folders.
        trust: whether to trust the protocol's Python code; without MCP, the user is otherwise asked on a terminal.
        mcp: whether to serve by the Model Context Protocol instead of HTTP.

    Raises:
        SimulationError: if the package for MCP is not installed.
    """
    from minihuman.admin.protocol_file import read_protocol
    from minihuman.web.agent_server import ProgramSessions, make_agent_server, make_mcp_server

    permission: Permission = trust
    if not mcp:
        permission = ask_trust(trust)  # with MCP, the standard input is not for questions to a user
    programs = ProgramSessions(read_protocol(protocol, trust=permission), data)
    if mcp:
        try:
            tools = make_mcp_server(programs)
        except ImportError:
            raise SimulationError("--mcp needs the package mcp; run: pip install 'mcp>=2'") from None
        tools.run()
        return
    server = make_agent_server(programs, port=port)
    print(f"programs begin at http://127.0.0.1:{server.server_port}/sessions   (Ctrl-C ends it)", flush=True)
    try:
        server.serve_forever()
    except KeyboardInterrupt:
        print("ended; unfinished sessions resume when their programs come again")


def deploy(
    protocol: ProtocolFile,
    address: Annotated[str, Option(help="The public base URL, such as https://study.example.org.")],
    out: Annotated[Path, Option(help="The folder to write the files to.")] = Path("deployment"),
    workers: Annotated[int, Option(min=1, max=64, help="The number of server processes.")] = 1,
    postgres: Annotated[
        bool, Option("--postgres", help="Keep enrolment and arrivals in a PostgreSQL database.")
    ] = False,
    bucket: Annotated[str, Option(help="Copy finished logs to this object store, such as s3://logs/study.")] = "",
    check: Annotated[
        Path | None,
        Option(help="Then restart servers under load, with the database and store that this data folder names."),
    ] = None,
    participants: Annotated[int, Option(min=1, max=10_000, help="The simulated participants of --check.")] = 300,
) -> None:
    """Write the files needed to deploy a study on a server.

    The files are a Containerfile, a Compose file that includes Caddy, a Caddyfile, a systemd unit and a README with
    instructions. Nothing is started unless --check is given. --check runs the number of servers set by --workers (at
    least two) on this machine and, while simulated participants play, restarts each server in turn and kills one. The
    exit status is 1 if an acknowledged key press is lost or a session is recorded twice.

    Example: minihuman deploy protocols/online.toml --address https://study.example.org --out online
    """
    from minihuman.admin.protocol_file import read_protocol
    from minihuman.web.deployment import Deployment, write_deployment
    from minihuman.web.server.process import require_browser_support

    study = read_protocol(protocol)
    require_browser_support(study)
    with name_output_when_full(out):
        paths = write_deployment(study, out, Deployment(address, workers, postgres, bucket))
    print(*paths, sep="\n")
    if check is None:
        return
    from minihuman.web.deployment.check import check_deployment

    result = check_deployment(check, participants, servers=workers, on_progress=lambda line: print(line, flush=True))
    print(result)
    if not result.passed:
        raise SystemExit(1)


def simulate(
    protocol: ProtocolFile,
    participants: Annotated[
        int, Option(min=1, help="The number of simulated participants; they take the next free slots.")
    ] = 10,
    data: DataFolder = Path("sessions"),
    seed: Annotated[int, Option(min=0, help="The random seed of the simulated participants.")] = 0,
    player: Annotated[
        str,
        Option(
            help="The kind of simulated participant: human-like, optimal, random, supervisor, a plug-in's name, or "
            "model:NAME for a language model. Settings follow a colon, as in human-like:lapse=0.1."
        ),
    ] = "human-like",
    parallel: Annotated[
        int, Option(min=1, max=256, help="The number of language-model sessions to run in parallel.")
    ] = 1,
    max_price: Annotated[
        float,
        Option(
            min=0,
            help="Stop when the language models have cost this much in total, in the currency of the protocol's "
            "prices; run the command again to resume. 0 means no limit.",
        ),
    ] = 0.0,
    isolate_worlds: IsolationOption = False,
    trust: TrustOption = False,
) -> None:
    """Run a study with simulated participants.

    The sessions are the same as with people, but without a window or waiting times.

    Example: minihuman simulate protocols/fourrooms-transfer.toml --participants 10 --data /tmp/trial
    """
    from minihuman.api import simulate as simulate_sessions

    with show_progress("") as progress:
        played = simulate_sessions(
            protocol,
            participants=participants,
            data=data,
            seed=seed,
            player=player,
            parallel=parallel,
            max_price=max_price,
            isolate_worlds=isolate_worlds,
            trust=ask_trust(trust),
            on_progress=progress,
        )
        logs = []
        for path in played:
            print(path, flush=True)
            logs.append(path)
    if player.startswith("model:"):  # any other player's failure raises at once
        _require_whole_sessions(logs, player)


def _require_whole_sessions(logs: list[Path], player: str) -> None:
    """Raise SimulationError if a failure of ``player`` ended the session of one of ``logs`` before its last episode."""
    from minihuman.log.read.session_reader import read_log

    cut_short = []
    for path in logs:
        log = read_log(path)
        n_planned = len(log.plan.episodes)
        n_ended = sum(episode.outcome not in (None, "abandoned") for episode in log.episodes)
        if log.end_reason == "player_failed" and n_ended < n_planned:
            cut_short.append(f"{path}, with {n_ended} of {n_planned} episodes")
    if cut_short:
        sessions = "1 session"
        if len(cut_short) > 1:
            sessions = f"{len(cut_short)} sessions"
        raise SimulationError(
            f"{player} ended {sessions} before the last episode, without a valid answer or at a limit; the first is "
            f"{cut_short[0]}"
        )


def watch(
    study: StudyFolder,
    port: Annotated[int, Option(min=0, max=65535, help="The port to serve the page on; 0 chooses a free one.")] = 0,
) -> None:
    """Watch running sessions on a local web page.

    The page shows pictures, keys and reaction times; use it to take notes, and to pause or abort a session.
    The command reads the live logs, so you can stop and restart it at any time.

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


def desk(
    folder: Annotated[Path, Argument("The folder of the protocols.", "FOLDER")] = Path(),
    data: DataFolder = Path("sessions"),
    port: Annotated[int, Option(min=0, max=65535, help="The port of the page; 0 chooses a free one.")] = 0,
    browser: Annotated[bool, Option(help="Open the page in the default browser.")] = True,
) -> None:
    """Run studies from a start page in a browser on this machine.

    The page lists the studies of a folder: build and edit them, start the next participant, resume a session, see who
    is due, check, watch, verify, report. Each button starts a command of minihuman and shows what it prints.

    Example: minihuman desk
    """
    open_desk(folder, data, port=port, browser=browser)


def open_desk(folder: Path, data_folder: Path, *, port: int = 0, browser: bool = True, page: str = "") -> None:
    """Serve the start page, with the builder, until the program is interrupted.

    Args:
        folder: the folder of the protocols.
        data_folder: the folder that contains the studies' folders.
        port: the port to serve on; 0 chooses a free one.
        browser: whether to open the page in the default browser.
        page: the path, relative to the start page, of the page to open; "" for the start page.
    """
    import webbrowser
    from contextlib import closing

    from minihuman.builder.application import PATH, BuilderApplication
    from minihuman.operating_system import exit_when_terminated
    from minihuman.web.server.desk import run_desk

    def announce(url: str) -> None:
        print(f"open {url}{page}   (Ctrl-C ends it; running sessions go on)", flush=True)
        if browser:
            webbrowser.open(f"{url}{page}")

    exit_when_terminated()
    with closing(BuilderApplication(folder, data_folder.absolute())) as builder:
        run_desk(folder, data_folder.absolute(), port=port, say=announce, rooms={PATH: builder})
