"""Commands to write a protocol with: new, schema."""

import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from minihuman.cli.declared import Argument, Option

if TYPE_CHECKING:
    from typer import Typer

    from minihuman.lab.new_study import Draft


def add_to(app: "Typer") -> None:
    """Add these commands."""
    from minihuman.cli.typed import add

    add(app, new, schema)


def new(
    folder: Annotated[Path, Argument(help="Where the file is to be; made if absent.")] = Path(),
    name: Annotated[str, Option(help="The study's name.")] = "",
    world: Annotated[str, Option(help="A Gymnasium id; `minihuman worlds` lists ours.")] = "",
    yes: Annotated[bool, Option("--yes", "-y", help="Ask nothing; take what is usual.")] = False,
) -> None:
    """Write a protocol that runs, from a few questions.

    Example: minihuman new my-study
    """
    import json

    from minihuman.errors import ProtocolError
    from minihuman.lab.new_study import SCHEMA_FILE, Draft, study_name
    from minihuman.study.schema import json_schema

    usual = Draft()
    usual = replace(usual, name=study_name(name or usual.name), world=world or usual.world)
    draft = usual if yes else _asked(usual)
    path = folder / f"{draft.name}.toml"
    if path.exists():
        raise ProtocolError(f"{path} already exists; choose another --name, or another folder")
    text = draft.toml()
    folder.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    (folder / SCHEMA_FILE).write_text(json.dumps(json_schema(), indent=1) + "\n", encoding="utf-8")
    print(f"{path} is a study that runs:\n  minihuman check {path}\n  minihuman run {path} --windowed")


def _asked(usual: "Draft") -> "Draft":
    import typer

    from minihuman.lab.new_study import Draft, study_name

    try:
        name = study_name(typer.prompt("Name of the study", default=usual.name))
        world = typer.prompt("World (`minihuman worlds` lists ours)", default=usual.world)
        episodes = typer.prompt("Episodes each", default=usual.episodes, type=int)
        participants = typer.prompt("Participants", default=usual.participants, type=int)
        shown = typer.confirm("Show which key does what?", default=False)
    except typer.Abort:
        print("Aborted.", file=sys.stderr)
        raise SystemExit(1) from None
    return Draft(name, world, episodes, participants, "shown" if shown else "fresh")


def schema() -> None:
    """Print the protocol file's JSON schema, for editors that complete and check TOML by one.

    Example: minihuman schema > minihuman.schema.json
    """
    import json

    from minihuman.study.schema import json_schema

    print(json.dumps(json_schema(), indent=1))
