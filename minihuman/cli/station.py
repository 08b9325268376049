"""Commands for the machine in front of you: demo, play, doctor."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from minihuman.cli.declared import Argument, Option

if TYPE_CHECKING:
    from typer import Typer


class ViewChoice(StrEnum):
    """How a world is seen."""

    PARTIAL = "partial"
    FULL = "full"


class PaletteChoice(StrEnum):
    """The colours a world is drawn in."""

    CLASSIC = "classic"
    COLOUR_SAFE = "colour-safe"


WindowOption = Annotated[str, Option("--window", help="auto, pygame or pyglet.")]
FullscreenOption = Annotated[bool, Option("--fullscreen", help="Take the whole screen.")]


def add_to(app: "Typer") -> None:
    """Add these commands."""
    from minihuman.cli.typed import add

    add(app, demo, play, doctor)


def demo(
    data: Annotated[Path, Option(help="Where the session is kept.")] = Path("sessions"),
    window: WindowOption = "auto",
    fullscreen: FullscreenOption = False,
) -> None:
    """Play a short session on the spot, then find its log, figures and replay; the first thing to try.

    Example: minihuman demo
    """
    from minihuman.seats.demo import demonstrate

    made = {}
    for name, path in demonstrate(data, window=window, fullscreen=fullscreen, say=print):
        made[name] = path
        print(f"{name:16} {path}", flush=True)
    print(f"Look at it: minihuman replay {made['log']}")


def play(
    world_id: Annotated[str, Argument(help="A Gymnasium id; `minihuman worlds` lists ours.")],
    seed: Annotated[int, Option(help="The first layout's seed.")] = 0,
    view: Annotated[ViewChoice, Option(help="As the agent sees it, or all from above.")] = ViewChoice.PARTIAL,
    palette: Annotated[PaletteChoice, Option(help="The colours.")] = PaletteChoice.CLASSIC,
    window: WindowOption = "auto",
    fullscreen: FullscreenOption = False,
) -> None:
    """Play a world by hand, with its keys on the screen; nothing is recorded.

    Example: minihuman play minihuman/MiniGrid-FourRooms-v0
    """
    from contextlib import closing
    from time import monotonic_ns

    from minihuman.seats.free_play import FreePlay, free_play
    from minihuman.windows.choose import open_window

    with closing(open_window(window, monotonic_ns, fullscreen=fullscreen)) as opened:
        free_play(FreePlay(world_id, seed, view.value, palette.value), opened, monotonic_ns)


def doctor(
    protocol: Annotated[Path | None, Argument(help="A study, whose own worlds are then drawn, too.")] = None,
    data: Annotated[Path, Option(help="Where sessions are to be kept.")] = Path("sessions"),
    window: WindowOption = "auto",
    fullscreen: Annotated[
        bool | None, Option("--fullscreen/--windowed", help="As `run` has it; with a study the whole screen.")
    ] = None,
    json: Annotated[bool, Option("--json", help="Print JSON instead of lines.")] = False,
) -> None:
    """Measure whether this machine is fit to run participants, or a study's; exit 1 if it is not.

    Example: minihuman doctor protocols/fourrooms-transfer.toml
    """
    import msgspec

    from minihuman.lab.protocol_file import read_protocol
    from minihuman.seats.doctor import examine, verdict

    study = None if protocol is None else read_protocol(protocol)
    whole = study is not None if fullscreen is None else fullscreen
    findings = []
    for finding in examine(window=window, data=data, fullscreen=whole, protocol=study):
        findings.append(finding)
        if not json:
            print(finding.line(), flush=True)
    print(msgspec.json.encode(findings).decode() if json else verdict(findings))
    raise SystemExit(1 if any(finding.unfit_because for finding in findings) else 0)
