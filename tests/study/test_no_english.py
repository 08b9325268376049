"""Every screen of a study in another language, looked at: none of the interface's English is on it."""

import re
from dataclasses import fields, is_dataclass
from pathlib import Path

import numpy as np
import pytest

from minihuman.admin.legibility import find_illegible_in_study
from minihuman.admin.protocol_file import read_protocol
from minihuman.display.drawing.screen import compose_screen
from minihuman.display.typefaces import TypefaceSet
from minihuman.display.windows.window import VirtualClock
from minihuman.experiment import words
from minihuman.experiment.machine import screen_texts
from minihuman.experiment.machine.screens import Screen, TextLocale
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.log.record.recorder import MemoryRecorder
from minihuman.runtime.session_loop import run_session
from minihuman.runtime.simulated_window import SimulatedWindow
from minihuman.simulation.participant import make_participant
from minihuman.worlds.adapters.world import World
from tests.typefaces import need_faces

PROTOCOLS = Path(__file__).parents[2] / "protocols"
ENGLISH = {word.lower() for text in words.load_words("en").values() for word in re.findall(r"[A-Za-z]{3,}", text)}
GERMAN = """
[study]
name = "deutsch"
version = "1"
seed = 5
language = "de"
consent = "Machen Sie mit?"
[keys]
pool = ["1", "2", "3", "kp_4", "up"]
[[groups]]
name = "alle"
parts = ["fragen", "wissen", "grid", "room", "last"]
[[questions]]
name = "fragen"
form = "demographics"
[[questions]]
name = "last"
form = "nasa-tlx"
[[questions]]
name = "wissen"
max_attempts = 9
[[questions.items]]
name = "a"
kind = "choice"
ask = "Was ist richtig?"
options = ["Dies", "Das"]
right = 2
[[questions.items]]
name = "b"
kind = "likert"
ask = "Wie gut?"
low = "gar nicht"
high = "sehr"
[[questions.items]]
name = "c"
kind = "long_text"
ask = "Warum?"
[[blocks]]
name = "grid"
world = "minihuman/MiniGrid-FourRooms-v0"
episodes = 2
actions = ["left", "right", "forward"]
max_steps = 60
key_map = "shown"
instructions = "Los geht es."
feedback = "{outcome}, {points}"
rest_text = "Ruhen Sie sich aus."
points = { goal = 1 }
show_points = true
show_outcome = true
fixation_ms = 100
[[blocks]]
name = "room"
world = "minihuman/MiniWorld-OneRoom-v0"
episodes = 1
actions = ["turn_left", "turn_right", "move_forward"]
max_steps = 30
key_map = "shown"
"""


def screens_of(protocol, session: int = 1) -> list[Screen]:
    """Every screen that a simulated participant sees."""
    plan = expand_protocol(protocol, enrol_participant(protocol, 0), session=session)
    clock = VirtualClock()
    machine = SessionMachine(plan, World, {}, picture_px=None)
    window = SimulatedWindow(make_participant("human-like", np.random.default_rng(1)), machine, clock)
    seen: list[Screen] = []
    show = window.show
    window.show = lambda screen: (seen.append(screen), show(screen))[1]  # type: ignore[method-assign]
    run_session(machine, window, MemoryRecorder(), clock)
    its = machine._context.words
    around = [
        screen_texts.build_pause_screen,
        screen_texts.build_focus_lost_screen,
        screen_texts.build_quit_screen,
        screen_texts.build_abort_screen,
        screen_texts.build_wait_screen,
    ]
    seen += [make(its) for make in around]
    seen += [
        screen_texts.build_end_screen(its, reason, "")
        for reason in ("complete", "quit", "screened_out", "disk_full", "world_error")
    ]
    return seen


def strings(value) -> list[str]:
    """Every text on a screen; names of keys, buttons and marks are none."""
    if isinstance(value, str):
        return [value]
    if is_dataclass(value):
        hidden = {"mark", "name", "script"}
        found = [getattr(value, field.name) for field in fields(value) if field.name not in hidden]
        if hasattr(value, "legend"):
            found.append([action for _, action in value.legend])
        return [text for inner in found for text in strings(inner)] if not isinstance(value, TextLocale) else []
    if isinstance(value, tuple | list):
        if value and all(isinstance(row, tuple) and len(row) == 3 for row in value):  # labels: name, cap, what is above
            return [text for _, cap, above in value for text in (cap, above)]
        if value and all(isinstance(row, tuple) and len(row) == 2 for row in value):  # keys, legend: name, ...
            return []
        return [text for inner in value for text in strings(inner)]
    return []


def test_no_english_word_is_in_any_screen_of_a_german_study():
    shared = {word.lower() for text in words.load_words("de").values() for word in re.findall(r"[A-Za-z]{3,}", text)}
    seen = screens_of(decode_protocol(GERMAN.encode()))
    told = {text for screen in seen for text in strings(screen)}
    assert len(seen) > 60
    assert "Eingabetaste" in " ".join(told)
    for text in told:
        found = {word.lower() for word in re.findall(r"[A-Za-zÄÖÜäöüß]{3,}", text)} & (ENGLISH - shared)
        assert not found - {"was"}, text


@pytest.mark.parametrize("session", [1, 2])
def test_no_latin_word_but_a_keys_name_is_in_any_screen_of_a_chinese_study(session):
    told = {
        text for screen in screens_of(read_protocol(PROTOCOLS / "two-days.toml"), session) for text in strings(screen)
    }
    assert {word for text in told for word in re.findall(r"[A-Za-z]{2,}", text)} <= {"Esc", "Tab"}


def test_every_screen_of_a_chinese_study_can_be_drawn():
    study = read_protocol(PROTOCOLS / "two-days.toml")
    seen = [screen for screen in screens_of(study) if type(screen).__name__ in ("PageScreen", "QuestionScreen")]
    for screen in seen[::7]:
        assert compose_screen(screen, (640, 480)).shape == (480, 640, 3)


def test_the_study_over_two_days_can_be_read():
    need_faces("zh")
    assert list(find_illegible_in_study(read_protocol(PROTOCOLS / "two-days.toml"))) == []


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (("Los geht es.", "Los geht es \U0010fff0."), r"grid, instruction 1: no face .*U\+10FFF0"),
        (('rest_text = "Ruhen', f'rest_text = "{"Ruhen Sie sich aus. " * 90}'), "grid, rest: does not fit a screen"),
        (("Was ist richtig?", "Was ist richtig? " * 200), "question 'a': does not fit"),
        (
            ('language = "de"', 'language = "de"\nfonts = ["Fraktur.ttf"]'),
            "fonts names 'Fraktur.ttf'",
        ),
        (("FourRooms-v0", "KeyCorridorS3R1-v0"), "the world says .* no words in 'de'"),
    ],
)
def test_check_names_what_cannot_be_read(change, says):
    problems = list(find_illegible_in_study(decode_protocol(GERMAN.replace(*change).encode())))
    assert any(re.search(says, problem) for problem in problems), problems


def test_what_no_face_has_is_said_once_however_many_texts_have_it(monkeypatch):
    monkeypatch.setattr(TypefaceSet, "missing", lambda self, text: text[:1])
    problems = list(find_illegible_in_study(decode_protocol(GERMAN.encode())))
    without_a_face = [problem for problem in problems if "no face" in problem]
    assert len(without_a_face) <= 2, "once a group"
    assert re.search(r"and \d{2,} more texts have such characters", without_a_face[0])
