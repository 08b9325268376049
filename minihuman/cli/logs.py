"""Commands about logs: info, verify, recover, seal."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from minihuman.cli.declared import Argument, Option
from minihuman.errors import printable

if TYPE_CHECKING:
    from typer import Typer


def add_to(app: "Typer") -> None:
    """Add these commands."""
    from minihuman.cli.typed import add

    add(app, info, verify, recover, seal)


def info(
    log: Annotated[Path, Argument(help="A session log, live file or session folder.")],
    json: Annotated[bool, Option("--json", help="Print JSON instead of lines.")] = False,
) -> None:
    """Say what is in a session's log.

    Example: minihuman info sessions/demo/sub-01/ses-01/sub-01_ses-01.mcap
    """
    from minihuman.lab.describe import as_json, as_lines
    from minihuman.log.read.open_log import open_log

    session = open_log(log)
    print(as_json(session) if json else printable("\n".join(as_lines(session))))


def verify(
    logs: Annotated[list[Path], Argument(help="Session logs, or folders of them: a session's, a study's.")],
    seal: Annotated[str | None, Option(help="A study's digest, or its seal's file: nothing may have changed.")] = None,
    trust: Annotated[list[str] | None, Option(help="A module whose worlds may be imported; may be repeated.")] = None,
    policies: Annotated[
        bool, Option("--policies", help="Ask the agents' policy files again what they would do in each state.")
    ] = False,
    json: Annotated[bool, Option("--json", help="Print a JSON object a line of what is found.")] = False,
) -> None:
    """Play logs again from seeds and inputs and compare everything; exit 1 if anything differs, 2 if one is unreadable.

    Example: minihuman verify sessions/demo/sub-01/ses-01/sub-01_ses-01.mcap
    """
    import msgspec

    from minihuman.errors import MinihumanError
    from minihuman.lab.proofs import proofs, sessions_at, unbroken

    def say(path: Path, line: str, *, fine: bool) -> None:
        told = {"log": str(path), "fine": fine, "said": line}
        print(msgspec.json.encode(told).decode() if json else printable(f"{path}: {line}"), flush=True)

    code = 0
    for path in logs if seal is not None else [path for given in logs for path in sessions_at(given)]:
        found = unbroken(path, seal) if seal is not None else proofs(path, trust=trust or (), policies=policies)
        try:
            for line, fine in found:
                code = max(code, int(not fine))
                say(path, line, fine=fine)
        except MinihumanError as error:  # of one log, which holds up none behind it
            code = max(code, error.exit_code)
            if json:
                say(path, str(error), fine=False)
            else:
                print(printable(f"minihuman: {error}"), file=sys.stderr, flush=True)
    raise SystemExit(code)


def seal(
    study: Annotated[Path, Argument(help="A study's folder, such as sessions/fourrooms-transfer.")],
) -> None:
    """Seal a study: one digest to publish, by which any later change to any of its files is noticed.

    Example: minihuman seal sessions/fourrooms-transfer
    """
    from minihuman.lab.seal import seal as sealed

    print(sealed(study).digest)


def recover(
    logs: Annotated[list[Path], Argument(help="Cut-off or damaged logs, or folders of cut-off ones.")],
) -> None:
    """Finish cut-off logs and rewrite damaged ones; says what was kept of each. Exit 1 if one was damaged.

    Example: minihuman recover sessions/fourrooms-transfer
    """
    from minihuman.errors import MinihumanError
    from minihuman.lab.recover import recover_all

    codes = [0]
    for became in recover_all(logs):
        if isinstance(became, MinihumanError):
            print(printable(f"minihuman: {became}"), file=sys.stderr, flush=True)
            codes.append(became.exit_code)
        else:
            print(printable(became.line()), flush=True)
            codes.append(int(became.damaged))
    if len(codes) == 1:
        print("no cut-off logs")
    raise SystemExit(max(codes))
