"""The command that writes other formats: export."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from minihuman.cli.choosing import choosing, say
from minihuman.cli.declared import Argument, Option
from minihuman.cli.waiting import waiting
from minihuman.errors import room_for

if TYPE_CHECKING:
    from typer import Typer


def add_to(app: "Typer") -> None:
    """Add these commands."""
    from minihuman.cli.typed import add

    add(app, export)


@choosing()
def export(
    format_name: Annotated[
        str,
        Argument(
            metavar="FORMAT", help="csv, parquet, minari, lerobot, imitation, bids, psych-ds, frictionless, croissant."
        ),
    ],
    source: Annotated[Path, Argument(metavar="SRC", help="A log, or a folder with logs in it.")],
    out: Annotated[Path, Argument(metavar="OUT", help="A folder that does not exist yet.")],
    stored_frames: Annotated[
        bool, Option("--stored-frames", help="Take the observations that the logs hold; do not play them again.")
    ] = False,
    *,
    selection: Any,
) -> None:
    """Write a study for other programs: tables, demonstrations with every observation checked, archives' formats.

    Example: minihuman export minari sessions/fourrooms-transfer demos --outcome goal
    """
    from minihuman.export.run import export as run

    with waiting("exporting") as told, room_for(out):
        written, card = run(
            format_name,
            source,
            out,
            selection,
            stored_frames=stored_frames,
            progress=lambda log: told(str(log)),
        )
    say((*card.account.lines(), *(f"left out: {line}" for line in written.left_out)))
    print(f"{written.episodes} episodes, {written.steps} steps in {out}; see {out / 'README.md'}")
