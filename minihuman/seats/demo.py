"""The demo: a short session on the spot, and everything that can be made of its log."""

from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

from msgspec.structs import replace

from minihuman.errors import WindowError
from minihuman.lab.next_session import next_session
from minihuman.lab.protocol_file import read_protocol
from minihuman.lab.shipped import shipped_protocol
from minihuman.lab.verify import verify
from minihuman.log.read.open_log import open_log
from minihuman.recorded.episode import SessionLog
from minihuman.seats.machine import SessionClock
from minihuman.seats.simulate import simulate
from minihuman.seats.sitting import sit
from minihuman.seats.warm_up import shared, warm_up
from minihuman.study.protocol import Protocol
from minihuman.windows.choose import AUTO, open_window

_SEED = 0
_PLAYER = "human-like"

Say = Callable[[str], None]


def demonstrate(data: Path, *, window: str, fullscreen: bool, say: Say) -> Iterator[tuple[str, Path]]:
    """Play the demo, prove its log and draw it; yield what each thing made is called, and where it is.

    Without a display a simulated participant plays, unless a window was asked for by name.

    Raises:
        WindowError: if the window asked for cannot be opened here.
    """
    log = open_log(_play(read_protocol(shipped_protocol("demo")), data, window=window, fullscreen=fullscreen, say=say))
    yield "log", log.path
    proof = verify(log)
    say(
        proof.difference or f"verified: {proof.episodes} episodes, {proof.steps} steps, played again from seed and keys"
    )
    if log.episodes:
        yield from _drawn(log)
    else:
        say("no episode was begun, so there is nothing to draw or replay")


def _play(protocol: Protocol, data: Path, *, window: str, fullscreen: bool, say: Say) -> Path:
    """The window opens when its first world is there; what the others take is compiled behind it."""
    first, *others = protocol.blocks
    with shared([first], others, plans=True) as companion:
        warm_up(replace(protocol, blocks=(first,)), companion=companion)
        clock = SessionClock()
        try:
            opened = open_window(window, clock, fullscreen=fullscreen)
        except WindowError:
            if window != AUTO:
                raise
            say("There is no display here: a simulated participant plays.")
            warm_up(protocol, companion=companion)
            for block in protocol.blocks:
                companion.compile_plan(block)
            (log,) = simulate(protocol, data, participants=1, seed=_SEED, player=_PLAYER)
            return log
        with closing(opened):
            played = sit(next_session(protocol, data), opened, clock, data)
    assert played is not None, "a session with a recorder on disk has a log"
    return played


def _drawn(log: SessionLog) -> Iterator[tuple[str, Path]]:
    from minihuman.figures.gallery import draw_session  # matplotlib and rerun take seconds: after the session,
    from minihuman.replay.recording import save_recording  # not before its window opens

    folder = log.path.parent
    for figure in draw_session(log, folder / "figures"):
        if figure.suffix == ".png":
            yield f"figure {figure.stem}", figure
    yield "replay", save_recording([log], folder / "replay.rrd")
