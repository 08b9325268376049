"""What a held key does in real time: each tick takes the keys that are down or were pressed since the tick before."""

import random
from pathlib import Path

import pytest

from minihuman.display.windows.window import ScriptedWindow, VirtualClock
from minihuman.experiment.machine.events import KeyPressed, Stepped
from minihuman.experiment.machine.inputs import AxisChanged, KeyDown, KeyUp, PointerPressed, Tick
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.experiment.replay import compare_replay
from minihuman.log.model.session_log import EpisodeLog
from minihuman.log.read.session_reader import read_log
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.runtime.session_loop import run_session
from minihuman.worlds.adapters.world import World
from tests.counts import count
from tests.study.sessions import Desk

MS = 1_000_000
KEYS = ("left", "right", "up", "down")
_TOML = """
[study]
name = "levers"
version = "1"
seed = {seed}
closing = ""
[keys]
pool = ["left", "right", "up", "down", "x"]
keyboard_check = false
[[groups]]
name = "all"
blocks = ["levers"]
[[blocks]]
name = "levers"
world = "tests.worlds.levers:tests/Levers-v0"
success = "terminated and reward > 0"
options = {{ kind = "{kind}" }}
episodes = 1
actions = {actions}
key_map = "fixed"
fixed_keys = {{ {keys} }}
max_steps = {max_steps}
pace = "real_time"
step_period_ms = {period_ms}
noop_action = "{noop}"
hold = "{hold}"
final_frame_ms = 0
{more}
"""
ACTIONS = {
    "box": ("axis_0_minus", "axis_0_plus", "axis_1_plus"),
    "buttons": ("button_0", "button_1", "button_2"),
    "choices": ("choice_0_1", "choice_0_2", "choice_1_1"),
    "chords": ("1", "2", "3", "4"),
    "board": ("choice_0_1", "choice_0_2"),
    "pair": ("axis_0_minus", "axis_0_plus", "choice_2_1"),
}


def levers_plan(kind="box", *, period_ms=100.0, max_steps=1000, hold="repeat", seed=1, more=""):
    actions = ACTIONS[kind]
    toml = _TOML.format(
        kind=kind,
        seed=seed,
        actions=list(actions),
        keys=", ".join(f'{key} = "{action}"' for key, action in zip(KEYS, actions, strict=False)),
        period_ms=period_ms,
        max_steps=max_steps,
        noop="0" if kind == "chords" else "rest",
        hold=hold,
        more=more,
    )
    protocol = decode_protocol(toml.encode())
    return expand_protocol(protocol, enrol_participant(protocol, 0))


def play_script(plan, script, data: Path, *, frame_ms: float = 0.0) -> EpisodeLog:
    """Play (ms, key, down) from the ready screen on, through window, loop and file; the episode as its log has it.

    An axis is there with its value instead, and a click with where it is.
    """
    keys = [make_input(round((150 + ms) * MS), name, value) for ms, name, value in script]
    inputs = [KeyDown(60 * MS, "enter"), KeyUp(70 * MS, "enter"), *keys]
    last_ns = max(happened.t_ns for happened in inputs)
    inputs.append(
        KeyUp(last_ns + round(plan.episodes[0].max_steps * plan.episodes[0].step_period_ms * MS) + 500 * MS, "f7")
    )
    clock = VirtualClock()
    session = SessionMachine(plan, World, {"machine": "script"})
    log = McapRecorder(data, plan, started_ns=0)
    window = ScriptedWindow(inputs, clock, frame_ns=round(frame_ms * MS))
    path = run_session(session, window, log, clock)
    assert session.failure is None
    return read_log(path).episodes[0]


def make_input(t_ns: int, name: str, value):
    if isinstance(value, tuple):
        return PointerPressed(t_ns, *value, name)
    return (
        AxisChanged(t_ns, name, value) if isinstance(value, float) else (KeyDown if value else KeyUp)(t_ns, name, name)
    )


def expected_actions(episode: EpisodeLog, kind: str) -> list:
    """The action of each logged step, from the logged times of keys and steps alone."""
    key_actions = episode.plan.key_map.keys
    spans: list[tuple[int, int, str]] = []  # a press, its release, the key
    for press in episode.keys:
        if press.down and press.verdict != "repeat":
            spans.append((press.t_ns, 1 << 62, press.key))
        elif not press.down:
            place = max((n for n, span in enumerate(spans) if span[2] == press.key), default=None)
            if place is not None:
                spans[place] = (spans[place][0], press.t_ns, press.key)
    found = []
    for tick_ns, before_ns in zip(episode.t_ns[1:], episode.t_ns[:-1], strict=True):
        taken = {}
        for down_ns, up_ns, key in spans:
            if key in key_actions and ((down_ns < tick_ns <= up_ns) or before_ns <= down_ns < tick_ns):
                taken.pop(key, None)
                taken[key] = down_ns
        names = [key_actions[key] for key in sorted(taken, key=taken.__getitem__)]
        found.append(_combined(names, kind))
    return found


def _combined(names, kind):
    if kind == "chords":
        chord = len(names) == 2 and set(names) == {"1", "2"}
        return 4 if chord else int(names[-1]) if names else 0
    vector = [0.0] * (3 if kind == "buttons" else 2)
    for name in names:
        place = int(name.split("_")[1])
        if kind == "box":
            vector[place] += -1.0 if name.endswith("minus") else 1.0 + place
        else:
            vector[place] = 1.0 if kind == "buttons" else float(name.split("_")[2])
    return tuple(vector)


def test_a_held_key_steps_every_period_and_a_tap_once(tmp_path):
    script = [(0, "right", True), (730, "right", False), (920, "left", True), (930, "left", False)]
    episode = play_script(levers_plan(max_steps=12), script, tmp_path)
    moved = [vector[0] for vector in episode.actions_taken]
    assert moved == [1.0] * 8 + [0.0, 0.0, -1.0, 0.0]
    names = [episode.start.action_names[action] for action in episode.actions]
    assert names[:2] == ["axis_0_plus"] * 2
    assert names[-1] == "rest"
    assert list(episode.step_keys)[:2] == ["right", "right"]
    answered = [number for number, ms in enumerate(episode.rt_ms) if ms == ms]
    assert answered == [0, 10], "a press answers one picture, however long it lasts"


def test_keys_that_are_held_together_combine_and_opposite_ones_cancel(tmp_path):
    script = [(0, "right", True), (5, "up", True), (250, "left", True), (450, "right", False), (650, "up", False)]
    episode = play_script(levers_plan(max_steps=8), script, tmp_path)
    assert episode.actions_taken[:3] == [(1.0, 2.0)] * 3
    assert (0.0, 2.0) in episode.actions_taken
    assert (-1.0, 2.0) in episode.actions_taken
    assert episode.actions_taken[-1] == (-1.0, 0.0)


def test_a_chord_of_the_environment_is_done_and_else_the_latest_key_wins(tmp_path):
    script = [(0, "left", True), (5, "right", True), (305, "up", True), (410, "right", False), (450, "up", False)]
    episode = play_script(levers_plan("chords", max_steps=6), script, tmp_path)
    assert episode.actions_taken == [4, 4, 4, 3, 3, 1], "left and right together; then up; then what is still held"


def test_once_is_what_it_always_was(tmp_path):
    plan = levers_plan(max_steps=5, hold="once")
    episode = play_script(plan, [(0, "right", True), (900, "right", False)], tmp_path)
    assert [vector[0] for vector in episode.actions_taken] == [1.0, 0.0, 0.0, 0.0, 0.0]


@pytest.mark.parametrize("number", range(count(50, 1000)))
def test_any_script_of_keys_gives_the_steps_that_its_log_says(number, tmp_path):
    draw = random.Random(number)
    kind = draw.choice(("box", "buttons", "choices", "chords"))
    period_ms = draw.choice((1000 / 15, 1000 / 60))
    script, at_ms, down = [], 0.0, set()
    for _ in range(draw.randrange(10, 60)):
        at_ms += draw.choice((0.0, 0.3, 2, 9, 30, 80, 200)) * draw.random()
        key = draw.choice((*KEYS, "x"))
        down ^= {key}
        script.append((at_ms, key, key in down))
    plan = levers_plan(kind, period_ms=period_ms, max_steps=max(5, int(at_ms / period_ms)), seed=number)
    episode = play_script(plan, script, tmp_path, frame_ms=draw.choice((0.0, 4.0, 17.0)))
    assert episode.actions_taken == expected_actions(episode, kind)
    pressed = [press.t_ns for press in episode.keys if press.down and press.key in plan.episodes[0].key_map.keys]
    stepped = [t_ns for t_ns, key in zip(episode.t_ns[1:], episode.step_keys, strict=True) if key]
    for t_ns in pressed:
        first_tick_ns = next((tick_ns for tick_ns in episode.t_ns[1:] if tick_ns > t_ns), None)
        assert first_tick_ns is None or first_tick_ns in stepped, "no tap is lost"


def test_a_session_with_held_keys_replays_event_by_event(tmp_path):
    plan = levers_plan("buttons", max_steps=12)
    desk = Desk(plan)
    desk.press("enter")
    desk.show()
    draw = random.Random(7)
    for _ in range(60):
        key, down = draw.choice(KEYS), draw.random() < 0.5
        desk.now_ns += draw.randrange(1, 40) * MS
        desk.give((KeyDown if down else KeyUp)(desk.now_ns, key, key))
        if desk.session.next_tick_ns is not None and desk.now_ns >= desk.session.next_tick_ns:
            desk.give(Tick(desk.now_ns))
    assert len(desk.of(Stepped)) > 5
    assert desk.of(KeyPressed)
    assert list(compare_replay(desk.events, World)) == []
