"""What the page computes ahead and what the session decides: the same, whatever a hand and the focus do, in any order.

The page's own modules run in Node (`virtual_browser`), the session in Python; scripts are drawn.
"""

import random
from collections.abc import Iterator
from pathlib import Path

import pytest

from minihuman.experiment.machine.events import KeyPressed, Noted, Stepped
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.experiment.replay import BROWSER_NOTE, compare_replay
from minihuman.worlds.adapters.world import World
from tests.counts import count
from tests.machine import needs
from tests.web.protocols import study
from tests.web.virtual_browser import Act, Line, Played, VirtualBrowser, virtual_browser

pytestmark = [pytest.mark.program, needs("node")]

PAGE = 'computed = "page"\n'
REAL_TIME = 'pace = "real_time"\nstep_period_ms = 100.0\nnoop_action = "done"\n'
BLOCKS = {
    "a key a step": PAGE,
    "repeats step": PAGE + "auto_repeat = true\n",
    "time steps": PAGE + REAL_TIME,
    "time is limited": PAGE + "max_episode_s = 4.0\n",
    "a cross before": PAGE + "fixation_ms = 300.0\n",
    "the server computes": 'computed = "server"\n',
    "the server computes time": 'computed = "server"\n' + REAL_TIME,
    "held keys step": 'computed = "server"\n' + REAL_TIME + 'hold = "repeat"\n',
}
BY_DAY = ["a key a step", "time steps"]
MARKS = ("held_before_focus", "shortcut")
SEEDS = count(12, 400)
PLAYED = ("1", "2", "3")
OTHERS = ("enter", "escape", "f8", "x", "left_ctrl", "left_shift")


@pytest.fixture(scope="module")
def browser() -> Iterator[VirtualBrowser]:
    with virtual_browser() as program:
        yield program


def draw_acts(rng: random.Random, length: int) -> list[Act]:
    """Draw what a hand and the focus do: presses, releases, holds that repeat, chords, and visits to other windows."""
    acts: list[Act] = [(400.0, "down", "enter"), (480.0, "up", "enter")]
    at_ms = rng.choice((500.0, 700.0, 1200.0))
    keys_down: list[str] = []
    has_focus = True
    for _ in range(length):
        at_ms += rng.choice((0.0, 1.0, 8.0, 30.0, 90.0, 250.0, 700.0))
        kind = rng.random()
        if kind < 0.18:
            has_focus = not has_focus
            acts.append((at_ms, "focus" if has_focus else "blur", ""))
        elif keys_down and kind < 0.5:
            acts.append((at_ms, "up", keys_down.pop(rng.randrange(len(keys_down)))))
        else:
            key = rng.choice(PLAYED) if rng.random() < 0.8 else rng.choice(OTHERS)
            if key not in keys_down:
                keys_down.append(key)
                acts.append((at_ms, "down", key))
    if not has_focus:
        acts.append((at_ms + 50.0, "focus", ""))
    return [*acts, *((at_ms + 60.0 + place, "up", key) for place, key in enumerate(keys_down))]


def draw_line(rng: random.Random) -> Line:
    up_ms, down_ms = rng.choice(((0.5, 0.5), (40.0, 40.0), (150.0, 150.0), (20.0, 300.0)))
    return Line(up_ms, down_ms, tuple(rng.choice((0.0, 0.0, 5.0, 60.0)) for _ in range(7)))


def plan_of(folder: Path, block: str) -> SessionPlan:
    protocol = decode_protocol(study(folder, episodes=3, max_steps=12, block=block).read_bytes())
    return expand_protocol(protocol, enrol_participant(protocol, 0))


def check(played: Played, seed: int) -> None:
    """Compare where the page and the session are, and what the page said of its steps."""
    events = played.recorder.events
    notes = [event.text for event in events if isinstance(event, Noted) and event.kind == BROWSER_NOTE]
    assert (seed, notes) == (seed, [])
    assert (seed, list(compare_replay(events, World))) == (seed, [])
    play = played.host.session.play
    assert (seed, played.page["playing"]) == (seed, play is not None), "the page shows another screen"
    if play is not None:
        assert (seed, played.page["step"]) == (seed, play.steps), "the page is elsewhere"
    presses = [event for event in events if isinstance(event, KeyPressed) and event.down]
    by_finger = {(press.t_ns - press.waited_ns, press.key) for press in presses if press.verdict not in MARKS}
    stepped = {(event.key_t_ns, event.key) for event in events if isinstance(event, Stepped) and event.key}
    assert (seed, stepped - by_finger) == (seed, set())


@pytest.mark.nightly(by_day=BY_DAY)
@pytest.mark.parametrize("name", BLOCKS)
def test_the_page_steps_where_the_session_does_whatever_hand_and_focus_do(
    name: str, browser: VirtualBrowser, tmp_path: Path
) -> None:
    plan = plan_of(tmp_path, BLOCKS[name])
    steps = marked = 0
    for seed in range(SEEDS):
        rng = random.Random(f"{name} {seed}")
        played = browser.play(plan, draw_acts(rng, 40), draw_line(rng))
        check(played, seed)
        played.host.close()
        steps += sum(isinstance(event, Stepped) for event in played.recorder.events)
        marked += sum(isinstance(event, KeyPressed) and event.verdict in MARKS for event in played.recorder.events)
    assert steps > 2 * SEEDS
    assert marked > 2 * SEEDS
