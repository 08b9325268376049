"""The demo: a short session with its figures and replay. Also free play, without protocol and log."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

from minihuman.admin.next_session import plan_next_session
from minihuman.admin.protocol_file import find_shipped_protocol, read_protocol
from minihuman.admin.verify.episodes import verify_episodes
from minihuman.display.windows.blocking_window import AUTO_WINDOW, open_window
from minihuman.display.windows.window import Clock, Window
from minihuman.errors import WindowError
from minihuman.experiment.keys import assign_usual_keys
from minihuman.experiment.machine.inputs import KeyDown, Stop
from minihuman.experiment.machine.screen_texts import capitalise
from minihuman.experiment.machine.screens import PlayScreen, Screen, TextScreen
from minihuman.experiment.plan.dry_run import check_worlds
from minihuman.experiment.plan.stated_outcomes import find_world_rule
from minihuman.experiment.protocol.protocol import Protocol
from minihuman.experiment.words import ENGLISH, load_words
from minihuman.log.model.session_log import SessionLog
from minihuman.log.read.session_reader import read_log
from minihuman.runtime.host import host_session
from minihuman.runtime.machine import SessionClock
from minihuman.runtime.simulated_session import simulate
from minihuman.worlds.adapters.world import World
from minihuman.worlds.contract import Palette, View
from minihuman.worlds.outcomes import EpisodeOutcome, OutcomeJudge

_SEED = 0
_PLAYER = "human-like"

PrintLine = Callable[[str], None]


def run_demo(data: Path, *, window: str, fullscreen: bool, say: PrintLine) -> Iterator[tuple[str, Path]]:
    """Play the demo, verify its log and draw it; yield the name and path of each output, the log first.

    Without a display a simulated participant plays, unless a window was requested by name. ``say`` receives lines on
    who plays and on the verification.

    Raises:
        WindowError: if the requested window cannot be opened here.
    """
    log = read_log(
        _play_demo(read_protocol(find_shipped_protocol("demo")), data, window=window, fullscreen=fullscreen, say=say)
    )
    yield "log", log.path
    verification = verify_episodes(log)
    counts = f"{verification.episodes} episodes, {verification.steps} steps"
    say(verification.difference or f"verified: {counts}, played again from seed and keys")
    if log.episodes:
        yield from _save_outputs(log)
    else:
        say("no episode was begun, so there is nothing to draw or replay")


def _play_demo(protocol: Protocol, data: Path, *, window: str, fullscreen: bool, say: PrintLine) -> Path:
    """Play the demo's session in a window or, without a display, by a simulated participant; return its log."""
    check_worlds(protocol)
    clock = SessionClock()
    try:
        opened = open_window(window, clock, fullscreen=fullscreen)
    except WindowError:
        if window != AUTO_WINDOW:
            raise
        say("There is no display here: a simulated participant plays.")
        (log,) = simulate(protocol, data, participants=1, seed=_SEED, player=_PLAYER)
        return log
    with closing(opened):
        played = host_session(plan_next_session(protocol, data), opened, clock, data)
    assert played is not None, "a session with a recorder on disk has a log"
    return played


def _save_outputs(log: SessionLog) -> Iterator[tuple[str, Path]]:
    """Draw a log's figures and save its replay; yield the name and path of each output."""
    from minihuman.figures.gallery import draw_session  # matplotlib and rerun take seconds: after the session,
    from minihuman.replay.recording import save_recording  # not before its window opens

    folder = log.path.parent
    for figure in draw_session(log, folder / "figures"):
        if figure.suffix == ".png":
            yield f"figure {figure.stem}", figure
    yield "replay", save_recording([log], folder / "replay.rrd")


_NEXT_LAYOUT_KEY = "backspace"
_DEFAULT_PICTURE_PX = (640, 480)  # if the window does not say what it has room for
_WAIT_NS = 200_000_000  # per wait, since a toolkit that waits in C does not notice Ctrl-C


@dataclass(frozen=True, slots=True)
class FreePlay:
    """The world, seed and view of a free play."""

    world: str  # a Gymnasium id
    seed: int = 0  # of the first layout; each further one takes the next number
    view: View = "partial"
    palette: Palette = "classic"


def run_free_play(play: FreePlay, window: Window, clock: Clock) -> int:
    """Let a person play layout after layout until Escape or the window is closed; return how many were begun.

    Raises:
        WorldError: if the world cannot be made or drawn.
    """
    world = World(play.world, trusted=True)
    keys = assign_usual_keys(world)
    presses = _yield_presses(window, clock)
    n_layouts = 0
    try:
        while True:
            n_layouts += 1
            if not _play_layout(play, world, keys, window, presses, play.seed + n_layouts - 1):
                return n_layouts
    finally:
        world.close()


def _play_layout(
    play: FreePlay, world: World, keys: Mapping[str, str], window: Window, presses: Iterator[str], seed: int
) -> bool:
    """Play one layout until it ends or the person leaves it; return whether the person wants another one.

    Args:
        play: the view and the palette.
        world: the world.
        keys: the action of each key.
        window: the window.
        presses: the keys that the person presses.
        seed: the seed of the layout.
    """
    mission = world.reset(seed).mission
    judge = OutcomeJudge(find_world_rule(play.world).rule)
    steps = 0
    reward = 0.0
    while True:
        hint = f"Seed {seed}, step {steps}.   Backspace: another layout   Escape: leave"
        picture = world.frame(play.view, window.picture_px or _DEFAULT_PICTURE_PX, play.palette)
        window.show(PlayScreen(picture, mission, hint, tuple(keys.items()), step=steps))
        key = _read_next_key(presses, {*keys, _NEXT_LAYOUT_KEY})
        if key is None or key == _NEXT_LAYOUT_KEY:
            return key is not None
        change = world.step(world.action_names.index(keys[key]))
        steps += 1
        reward += change.reward
        outcome = judge.judge_step(change.collect_facts(judge.rule, return_=reward))
        if outcome is not None:
            window.show(_describe_ending(outcome, steps, reward))
            return _read_next_key(presses, {"enter", "kp_enter", _NEXT_LAYOUT_KEY}) is not None


def _describe_ending(outcome: EpisodeOutcome, steps: int, reward: float) -> Screen:
    title = capitalise(load_words(ENGLISH)[f"outcome.{outcome}"])
    return TextScreen(title, f"{steps} steps, reward {reward:.2f}", "Enter: another layout    Escape: leave")


def _read_next_key(presses: Iterator[str], accepted: set[str]) -> str | None:
    """Return the next accepted key that is pressed; None if the person leaves."""
    return next((key for key in presses if key in accepted), None)


def _yield_presses(window: Window, clock: Clock) -> Iterator[str]:
    """Yield every key press, including repeats of held keys, until Escape or the window is closed."""
    while True:
        for happened in window.wait(clock() + _WAIT_NS):
            match happened:
                case Stop() | KeyDown(key="escape"):
                    return
                case KeyDown(key=key):
                    yield key
