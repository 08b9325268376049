"""Commands about logs: info, verify, recover."""

import sys
from pathlib import Path
from typing import Annotated

import typer


def add_to(app: typer.Typer) -> None:
    """Add these commands."""
    app.command()(info)
    app.command()(verify)
    app.command()(recover)


def info(
    log: Annotated[Path, typer.Argument(help="A session log, live file or session folder.")],
    json: Annotated[bool, typer.Option("--json", help="Print JSON instead of lines.")] = False,
) -> None:
    """Say what is in a session's log.

    Example: minihuman info sessions/demo/sub-01/ses-01/sub-01_ses-01.mcap
    """
    from minihuman.lab.describe import as_json, as_lines
    from minihuman.log.read.open_log import open_log

    session = open_log(log)
    print(as_json(session) if json else "\n".join(as_lines(session)))


def verify(
    logs: Annotated[list[Path], typer.Argument(help="Session logs.")],
) -> None:
    """Play logs again from seeds and actions and compare every hash; exit 1 if any number differs.

    Example: minihuman verify sessions/demo/sub-01/ses-01/sub-01_ses-01.mcap
    """
    from minihuman.lab.verify import other_rules
    from minihuman.lab.verify import verify as play_again
    from minihuman.log.read.open_log import open_log

    differ = False
    for log in logs:
        session = open_log(log)
        if other := other_rules(session):
            print(f"{log}: {other}")
        result = play_again(session)
        differ = differ or bool(result.difference)
        print(f"{log}: {result.difference or f'{result.episodes} episodes, {result.steps} steps, all as logged'}")
    raise typer.Exit(1 if differ else 0)


def recover(
    logs: Annotated[list[Path], typer.Argument(help="Cut-off or damaged logs, or folders of cut-off ones.")],
) -> None:
    """Finish cut-off logs and rewrite damaged ones; says what was kept of each. Exit 1 if one was damaged.

    Example: minihuman recover sessions/fourrooms-transfer
    """
    from minihuman.errors import MinihumanError
    from minihuman.lab.recover import recover_all

    codes = [0]
    for became in recover_all(logs):
        if isinstance(became, MinihumanError):
            print(f"minihuman: {became}", file=sys.stderr, flush=True)
            codes.append(became.exit_code)
        else:
            print(became.line(), flush=True)
            codes.append(int(became.damaged))
    if len(codes) == 1:
        print("no cut-off logs")
    raise typer.Exit(max(codes))
