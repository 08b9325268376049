"""Commands for the experimenter's desk: watch, withdraw, replace, bonus."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from minihuman.cli.declared import Argument, Option

if TYPE_CHECKING:
    from typer import Typer

Code = Annotated[str, Argument(metavar="CODE", help="The participant's code, such as sub-07.")]
StudyFolder = Annotated[Path, Option("--study", help="The study's folder, such as sessions/fourrooms-transfer.")]


def add_to(app: "Typer") -> None:
    """Add these commands."""
    from minihuman.cli.typed import add

    add(app, watch, withdraw, replace, bonus, gather)


def watch(
    study: Annotated[Path, Argument(metavar="STUDY", help="The study's folder.")],
    port: Annotated[int, Option(min=0, max=65535, help="Of the page; 0 takes a free one.")] = 0,
) -> None:
    """Show every running session on a page of this machine: picture, keys, reaction times, notes, pause, abort.

    It reads the live logs and can be ended and started again at any time; the sessions do not notice.

    Example: minihuman watch sessions/fourrooms-transfer
    """
    import os

    from minihuman.seats.watch.server import WatchServer

    server = WatchServer(study, port)
    os.nice(10)  # what it does not do aside, too
    print(f"open {server.url}   (Ctrl-C ends it; the sessions go on)", flush=True)
    try:
        server.serve()
    except KeyboardInterrupt:
        print()


def withdraw(
    code: Code,
    study: StudyFolder,
    erase: Annotated[bool, Option("--erase", help="Delete all that there is of them.")] = False,
    seal: Annotated[Path | None, Option(help="Move it into this ZIP archive, outside of the study.")] = None,
) -> None:
    """Take a participant out of a study: their data count nowhere any more, and their slot is offered again.

    Example: minihuman withdraw sub-07 --study sessions/fourrooms-transfer --erase
    """
    from minihuman.errors import AllocationError
    from minihuman.lab.withdraw import withdraw as take_out

    if erase == (seal is not None):
        raise AllocationError("say what becomes of the data: --erase, or --seal ARCHIVE.zip")
    print(take_out(study, code, seal=seal).line())
    print("Their slot is offered to the next. Make again what was made with their data: reports, figures, exports.")


def replace(code: Code, study: StudyFolder) -> None:
    """Offer the slot of somebody who does not come back to the next participant; what they did stays, and counts.

    Example: minihuman replace sub-07 --study sessions/fourrooms-transfer
    """
    from minihuman.lab.withdraw import replace as offer

    offer(study, code)
    print(f"the next `minihuman run` offers {code}'s slot")


def gather(study: Annotated[Path, Argument(metavar="STUDY", help="The study's folder.")]) -> None:
    """Bring a study's finished logs here from the shelf that several machines share, and put there what it lacks.

    Example: minihuman gather sessions/fourrooms-transfer
    """
    from minihuman.lab.shelf import gather as fetch

    came, went = fetch(study.absolute().parent, f"{study.absolute().name}/")
    print(f"{came} logs brought here, {went} put on the shelf")


def bonus(
    study: Annotated[Path, Argument(metavar="STUDY", help="The study's folder.")],
    platform: Annotated[str, Option(help="Only lines of id,amount for this one: prolific, sona, mturk.")] = "",
) -> None:
    """Print what each session earned as CSV, with who its participant is on the platform they came from.

    Example: minihuman bonus sessions/two-days --platform prolific > bonus.csv
    """
    from minihuman.lab.bonus import as_csv, for_platform, payments

    paid = payments(study)
    print(for_platform(paid, platform) if platform else as_csv(paid), end="")
