"""No type below 1/40 of the height, on any screen, in any of our languages, however long a title or an action is."""

from dataclasses import replace

import numpy as np
import pytest

from minihuman.activities.play.screens import build_rest_screen
from minihuman.activities.preferences.drawing import draw_pair
from minihuman.activities.preferences.screens import PairScreen
from minihuman.activities.questions.screens import build_wrong_answer_screen
from minihuman.display.drawing import play_screens, sheet
from minihuman.display.drawing.screen import compose_screen, find_spot
from minihuman.display.text import draw_line
from minihuman.experiment.machine import screen_texts
from minihuman.experiment.machine.screens import PlayScreen, Screen
from minihuman.experiment.plan.expansion import enrol_participant, expand_protocol
from minihuman.experiment.plan.session_plan import SessionPlan
from minihuman.experiment.protocol.protocol import decode_protocol
from minihuman.experiment.words import LANGUAGES, InterfaceWords
from minihuman.runtime.screenshots import render_screens
from tests.typefaces import need_faces

SIZES_PX = [(1024, 768), (1280, 720)]
STUDY = """
[study]
name = "words"
version = "1"
seed = 5
language = "{language}"
consent = "?"
[keys]
pool = ["1", "2", "kp_4", "up", "space", "left_ctrl"]
[[groups]]
name = "all"
parts = ["about", "read", "quiz", "grid", "load"]
[[pages]]
name = "read"
title = "{long}"
text = "{long}"
[pages.example]
world = "minihuman/MiniGrid-Empty-5x5-v0"
seed = 3
marks = {{ agent = "{long}", "green goal" = "{long}" }}
[[questions]]
name = "about"
form = "demographics"
[[questions]]
name = "load"
form = "nasa-tlx"
[[questions]]
name = "quiz"
title = "{long}"
max_attempts = 2
[[questions.items]]
name = "a"
kind = "choices"
ask = "?"
options = ["1", "2", "3", "4", "5", "6", "7", "8", "9"]
right = [2]
[[questions.items]]
name = "b"
kind = "likert"
ask = "?"
points = 11
[[blocks]]
name = "grid"
world = "minihuman/MiniGrid-Empty-5x5-v0"
episodes = 1
actions = ["left", "right", "forward", "pickup", "drop", "toggle"]
max_steps = 3
key_map = "shown"
instructions = "?"
feedback = "{{outcome}}"
mission = "{long}"
points = {{ goal = 10 }}
show_points = true
show_outcome = true
"""
LONG = {"zh": "很长的标题" * 12, "ja": "長い題名です" * 11, "ar": "عنوان طويل جدا " * 6}


@pytest.fixture
def smallest(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, str]]:
    """What is set in type, and how large: every line that the drawing modules draw."""
    told: list[tuple[int, str]] = []

    def seen(draw, place, words, *, size_px, **settings):
        if words.strip():
            told.append((size_px, words))
        draw_line(draw, place, words, size_px=size_px, **settings)

    for module in (sheet, play_screens):
        monkeypatch.setattr(module, "draw_line", seen)
    return told


def plan_in(language: str) -> SessionPlan:
    long = LONG.get(language, "A title of many long words that goes on for quite a while, and then on " * 2)
    study = decode_protocol(STUDY.format(language=language, long=long.strip()).encode())
    return expand_protocol(study, enrol_participant(study, 0))


def all_screens(plan: SessionPlan) -> list[Screen]:
    """Those of a whole session, and those that something has to happen for."""
    words = InterfaceWords(plan.language, plan.words, plan.fonts)
    screens = [screen for _, screen in render_screens([plan], (1024, 768))[0]]
    screens += [
        screen_texts.build_pause_screen(words),
        screen_texts.build_focus_lost_screen(words),
        screen_texts.build_quit_screen(words),
        screen_texts.build_abort_screen(words),
    ]
    screens += [
        build_wrong_answer_screen(words, ""),
        build_rest_screen(words, "", 9),
        screen_texts.build_notice_screen(words, words["learning.title"], words["learning.body"]),
        screen_texts.build_wait_screen(words),
    ]
    screens += [screen_texts.build_end_screen(words, reason, "") for reason in ("world_error", "disk_full", "complete")]
    play = next(screen for screen in screens if isinstance(screen, PlayScreen) and screen.legend)
    for who in ("agent", "person"):
        screens.append(replace(play, controller=who, controller_text=words[f"steers.{who}"]))
    return screens


@pytest.mark.parametrize("language", LANGUAGES)
def test_no_screen_of_a_language_has_type_below_a_fortieth_of_its_height(
    language: str, smallest: list[tuple[int, str]]
) -> None:
    need_faces(language)
    screens = all_screens(plan_in(language))
    for size_px in SIZES_PX:
        least = round(min(size_px[1], size_px[0] * 3 / 4) / 40)
        for screen in screens:
            smallest.clear()
            compose_screen(screen, size_px)
            if not isinstance(screen, PlayScreen):
                find_spot(screen, size_px, 0.5, 0.5)
            small = [(px, line) for px, line in smallest if px < least]
            assert not small, f"{type(screen).__name__} of {size_px}: {small}"
    assert smallest


def test_a_pair_has_type_of_a_fortieth_too(smallest: list[tuple[int, str]]) -> None:
    words, picture = InterfaceWords("en"), np.zeros((40, 40, 3), np.uint8)
    title = "Which of the two did better, and is there anything that you would like to say of it before you go on?" * 2
    pair = PairScreen(words.locale, (picture,), (picture,), 0, title, title, title)
    draw_pair(pair, (1024, 768))
    assert min(smallest)[0] >= 19
