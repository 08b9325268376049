"""Free play: a world controlled by keys and shown on the screen, without protocol and without log."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from minihuman.display.windows.window import Clock, Window
from minihuman.experiment.keys import assign_usual_keys
from minihuman.experiment.machine.inputs import KeyDown, Stop
from minihuman.experiment.machine.screens import PlayScreen, Screen, TextScreen
from minihuman.worlds.adapters.world import StepResult, World
from minihuman.worlds.contract import Palette, View

_ANEW = "backspace"
_AIR_NS = 200_000_000  # a toolkit that blocks in C does not see Ctrl-C


@dataclass(frozen=True, slots=True)
class FreePlay:
    """What to play and how to look at it."""

    world: str  # a Gymnasium id
    seed: int = 0  # of the first layout; each further one takes the next number
    view: View = "partial"
    palette: Palette = "classic"


def run_free_play(play: FreePlay, window: Window, clock: Clock) -> int:
    """Let a person play layout after layout until Escape or the window's cross; says how many were begun.

    Raises:
        WorldError: if the world cannot be made or drawn.
    """
    world = World(play.world, trusted=True)
    keys = assign_usual_keys(world)
    presses = _presses(window, clock)
    begun = 0
    try:
        while True:
            begun += 1
            if not _episode(play, world, keys, window, presses, play.seed + begun - 1):
                return begun
    finally:
        world.close()


def _episode(
    play: FreePlay, world: World, keys: Mapping[str, str], window: Window, presses: Iterator[str], seed: int
) -> bool:
    """One layout; whether another is wanted."""
    mission = world.reset(seed).mission
    steps, reward = 0, 0.0
    while True:
        hint = f"Seed {seed}, step {steps}.   Backspace: another layout   Escape: leave"
        picture = world.frame(play.view, window.picture_px or (640, 480), play.palette)
        window.show(PlayScreen(picture, mission, hint, tuple(keys.items()), step=steps))
        key = _next_key(presses, {*keys, _ANEW})
        if key in (None, _ANEW):
            return key == _ANEW
        happened = world.step(world.action_names.index(keys[key]))
        steps, reward = steps + 1, reward + happened.reward
        if happened.terminated or happened.truncated:
            window.show(_over(happened, steps, reward))
            return _next_key(presses, {"enter", "kp_enter", _ANEW}) is not None


def _over(last: StepResult, steps: int, reward: float) -> Screen:
    ended = "Goal reached" if last.reward > 0 else "The episode is over"
    title = ended if last.terminated else "Out of time"
    return TextScreen(title, f"{steps} steps, reward {reward:.2f}", "Enter: another layout    Escape: leave")


def _next_key(presses: Iterator[str], wanted: set[str]) -> str | None:
    """The next press of a wanted key; None when the person leaves."""
    return next((key for key in presses if key in wanted), None)


def _presses(window: Window, clock: Clock) -> Iterator[str]:
    """Every key pressed, repeats of held ones too, until Escape or the window's cross."""
    while True:
        for happened in window.wait(clock() + _AIR_NS):
            match happened:
                case Stop() | KeyDown(key="escape"):
                    return
                case KeyDown(key=key):
                    yield key
