"""The demo: a short session on the spot, and everything that can be made of its log."""

from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

from msgspec.structs import replace

from minihuman.admin.next_session import plan_next_session
from minihuman.admin.protocol_file import find_shipped_protocol, read_protocol
from minihuman.admin.verify.episodes import verify_episodes
from minihuman.display.windows.blocking_window import AUTO_WINDOW, open_window
from minihuman.errors import WindowError
from minihuman.experiment.protocol.protocol import Protocol
from minihuman.log.model.session_log import SessionLog
from minihuman.log.read.session_reader import read_log
from minihuman.runtime.host import host_session
from minihuman.runtime.machine import SessionClock
from minihuman.runtime.simulated_session import simulate
from minihuman.runtime.warm_up import share_compilation, warm_up

_SEED = 0
_PLAYER = "human-like"

PrintLine = Callable[[str], None]


def run_demo(data: Path, *, window: str, fullscreen: bool, say: PrintLine) -> Iterator[tuple[str, Path]]:
    """Play the demo, prove its log and draw it; yield what each thing made is called, and where it is.

    Without a display a simulated participant plays, unless a window was asked for by name.

    Raises:
        WindowError: if the window asked for cannot be opened here.
    """
    log = read_log(
        _play(read_protocol(find_shipped_protocol("demo")), data, window=window, fullscreen=fullscreen, say=say)
    )
    yield "log", log.path
    proof = verify_episodes(log)
    say(
        proof.difference or f"verified: {proof.episodes} episodes, {proof.steps} steps, played again from seed and keys"
    )
    if log.episodes:
        yield from _make_outputs(log)
    else:
        say("no episode was begun, so there is nothing to draw or replay")


def _play(protocol: Protocol, data: Path, *, window: str, fullscreen: bool, say: PrintLine) -> Path:
    """The window opens when its first world is there; what the others take is compiled behind it."""
    first, *others = protocol.blocks
    with share_compilation([first], others, plans=True) as process:
        warm_up(replace(protocol, blocks=(first,)), process=process)
        clock = SessionClock()
        try:
            opened = open_window(window, clock, fullscreen=fullscreen)
        except WindowError:
            if window != AUTO_WINDOW:
                raise
            say("There is no display here: a simulated participant plays.")
            warm_up(protocol, process=process)
            for block in protocol.blocks:
                process.compile_plan(block)
            (log,) = simulate(protocol, data, participants=1, seed=_SEED, player=_PLAYER)
            return log
        with closing(opened):
            played = host_session(plan_next_session(protocol, data), opened, clock, data)
    assert played is not None, "a session with a recorder on disk has a log"
    return played


def _make_outputs(log: SessionLog) -> Iterator[tuple[str, Path]]:
    from minihuman.figures.gallery import draw_session  # matplotlib and rerun take seconds: after the session,
    from minihuman.replay.recording import save_recording  # not before its window opens

    folder = log.path.parent
    for figure in draw_session(log, folder / "figures"):
        if figure.suffix == ".png":
            yield f"figure {figure.stem}", figure
    yield "replay", save_recording([log], folder / "replay.rrd")
