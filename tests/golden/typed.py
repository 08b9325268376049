"""Frozen studies whose answers are typed: letter by letter, as sessions edited once, and whole, as fields do."""

from collections.abc import Iterable, Mapping
from pathlib import Path

from minihuman.activities.questions.number.draft import NUMBER_RULES
from minihuman.admin.next_session import plan_next_session
from minihuman.experiment.machine.inputs import (
    TEXT_RULES,
    Input,
    KeyDown,
    KeyUp,
    ScreenShown,
    TextEdited,
    TextInput,
    Tick,
)
from minihuman.experiment.machine.session import CONSENT_RULES, KEY_RULES, SessionMachine
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.log.record.mcap_recorder import McapRecorder
from minihuman.worlds.adapters.world import World

STARTED_NS = 1_780_000_000_000_000_000
MS = 1_000_000
TYPED = """
[study]
name = "{name}"
version = "1"
seed = 11
participants = 4
[keys]
keyboard_check = false
[[groups]]
name = "all"
parts = ["asked"]
[[questions]]
name = "asked"
[[questions.items]]
name = "why"
kind = "long_text"
ask = "Why?"
[[questions.items]]
name = "who"
kind = "text"
ask = "Who?"
[[questions.items]]
name = "age"
kind = "number"
ask = "How old?"
"""
OLD_FACTS = {"number_rules": NUMBER_RULES, "consent_rules": CONSENT_RULES, "key_rules": KEY_RULES}


def play(data: Path, name: str, inputs: Iterable[Input], facts: Mapping[str, str]) -> None:
    """Play a session by inputs alone; its last Enter closes it."""
    protocol = decode_protocol(TYPED.replace("{name}", name).encode())
    plan = plan_next_session(protocol, data, participant="sub-01", session=1)
    session = SessionMachine(plan, World, {"player": "human", "platform": "golden", **facts}, picture_px=None)
    recorder = McapRecorder(data, plan, started_ns=STARTED_NS)
    for happened in (Tick(0), *inputs):
        if events := session.receive(happened):
            recorder.write(events)
    assert session.over, session.phase
    recorder.close()
    session.close()


def press(t_ms: int, *keys: str) -> list[Input]:
    """Return presses and releases of keys, one each 20 ms."""
    moves: list[Input] = []
    for place, key in enumerate(keys):
        at_ns = (t_ms + 20 * place) * MS
        moves += [KeyDown(at_ns, key, key), KeyUp(at_ns + 10 * MS, key, key)]
    return moves


def make_typed(data: Path) -> None:
    """Type with blanks around, a correction in the middle and a joiner, as windows sent it before there were fields."""
    inputs = [
        ScreenShown(100 * MS, 90 * MS, 100 * MS),
        TextInput(200 * MS, " becuse"),
        *press(300, "left", "left", "left"),
        TextInput(400 * MS, "a"),
        *press(500, "end", "enter"),
        TextInput(600 * MS, "it was\u00a0ne\u200car  "),
        *press(700, "tab"),
        TextInput(900 * MS, "Me x"),
        *press(1000, "backspace", "enter"),
        TextInput(1100 * MS, "4x2"),
        *press(1200, "enter"),
        *press(1300, "enter"),
    ]
    play(data, "typed", inputs, OLD_FACTS)


def make_fields(data: Path) -> None:
    """Say whole texts, each as it stood when it settled, and how it came there."""
    inputs = [
        ScreenShown(100 * MS, 90 * MS, 100 * MS),
        TextEdited(800 * MS, " becuse", ("typed",), 7, 200 * MS),
        TextEdited(1500 * MS, " because\nit was\u00a0ne\u200car  ", ("typed", "pasted", "script"), 4, 1200 * MS),
        *press(1600, "tab"),
        TextEdited(2300 * MS, "日本", ("composed", "undone"), 9, 1900 * MS),
        *press(2400, "enter"),
        TextEdited(3000 * MS, "4x2", ("typed",), 3, 2800 * MS),
        *press(3100, "enter"),
        TextEdited(3700 * MS, "42", ("typed",), 1, 3600 * MS),
        *press(3800, "enter"),
        *press(3900, "enter"),
    ]
    play(data, "fields", inputs, {**OLD_FACTS, "text_rules": TEXT_RULES})
