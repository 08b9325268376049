"""The command that writes other formats: export."""

from pathlib import Path
from typing import Annotated

import typer


def add_to(app: typer.Typer) -> None:
    """Add these commands."""
    app.command()(export)


def export(
    format_name: Annotated[str, typer.Argument(metavar="FORMAT", help="csv, parquet, minari, lerobot, imitation.")],
    source: Annotated[Path, typer.Argument(metavar="SRC", help="A log, or a folder with logs in it.")],
    out: Annotated[Path, typer.Argument(metavar="OUT", help="A folder that does not exist yet.")],
    outcome: Annotated[list[str], typer.Option(help="Only episodes that ended so; may be repeated.")] = [],  # noqa: B006
    block: Annotated[list[str], typer.Option(help="Only this block; may be repeated.")] = [],  # noqa: B006
    participant: Annotated[list[str], typer.Option(help="Only this participant; may be repeated.")] = [],  # noqa: B006
    tag: Annotated[list[str], typer.Option(help="Only episodes marked so; may be repeated.")] = [],  # noqa: B006
    without_tag: Annotated[list[str], typer.Option(help="No episode marked so; may be repeated.")] = [],  # noqa: B006
    stored_frames: Annotated[
        bool, typer.Option("--stored-frames", help="Take the observations that the logs hold; do not play them again.")
    ] = False,
) -> None:
    """Write demonstrations for other libraries, every observation played again, or stored, and checked.

    Example: minihuman export minari sessions/fourrooms-transfer demos --outcome goal --without-tag exclude
    """
    from rich.console import Console

    from minihuman.data.selection import Filters
    from minihuman.export.run import export as run

    filters = Filters(*(tuple(values) for values in (outcome, block, participant, tag, without_tag)))
    with Console(stderr=True).status("exporting") as status:
        written, card = run(
            format_name, source, out, filters, stored_frames=stored_frames, progress=lambda log: status.update(str(log))
        )
    for line in card.skipped:
        print(f"left out: {line}")
    print(f"{written.episodes} episodes, {written.steps} steps in {out}; see {out / 'README.md'}")
