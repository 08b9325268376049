"""The square that a trial has for a photodiode: what is drawn, and what another program sees of it on a display."""

from pathlib import Path

import msgspec
import numpy as np
import pytest

from minihuman.activities.trials.drawing import draw_stimuli
from minihuman.activities.trials.plan import TimelineSpec
from minihuman.admin.verify.log import find_log_differences
from minihuman.worlds.adapters.world import World
from tests.activities.trials.test_timelines import PRIMING, plan_of, show_next
from tests.counts import count
from tests.machine import needs
from tests.picture_times import FRAME_MS, show_at_desk, show_in_chromium, write_study
from tests.study.sessions import Desk

CORNERS = {"top left": (0, 0), "top right": (0, -1), "bottom left": (-1, 0), "bottom right": (-1, -1)}


@pytest.mark.parametrize("corner", CORNERS)
def test_a_square_in_the_corner_is_white_in_every_other_picture(corner: str) -> None:
    desk = Desk(plan_of(f'{PRIMING}timeline.photodiode = "{corner}"\n'))
    desk.show()
    levels = []
    for shown in range(4):
        if shown:
            show_next(desk)
        screen = desk.session.screen
        picture = draw_stimuli(screen.contents, (640, 480), {}, "en")
        levels.append(int(picture[CORNERS[corner]].max()))
        assert sum(int(picture[place].max()) == levels[-1] for place in CORNERS.values()) == 1
    assert levels == [255, 0, 255, 0]


def test_a_response_does_not_change_the_square_and_without_one_nothing_is_drawn() -> None:
    for field, squares in (('timeline.photodiode = "top left"', ["#000000"]), ("", [])):
        desk = Desk(plan_of(f"{PRIMING}{field}\n"))
        desk.show()
        for _ in range(3):
            show_next(desk)
        screen = desk.session.screen
        before, after = screen.pictures[4], screen.pictures[8]
        assert [content.colour for content in after] == squares
        assert [content.colour for content in before if content.shape] == squares
        assert screen.pictures[0] == ()


def test_the_methods_say_that_there_is_a_square() -> None:
    stimuli = ({"name": "cue", "text": "<", "duration_ms": 100},)
    with_square = msgspec.convert({"stimuli": stimuli, "photodiode": "top right"}, TimelineSpec)
    without = msgspec.convert({"stimuli": stimuli}, TimelineSpec)
    [said] = set(with_square.describe(0)) - set(without.describe(0))
    assert said == "a square for a photodiode (top right) changed between white and black with each picture"
    assert msgspec.json.encode(without).count(b"photodiode") == 0  # plans of before read and are written as they were


@pytest.mark.program
@needs("xvfb")
@pytest.mark.nightly(by_day=["pygame"])
@pytest.mark.parametrize("window", ["pygame", "pyglet"])
def test_the_log_says_when_pictures_were_on_the_display(tmp_path: Path, display: str, window: str) -> None:
    protocol = write_study(tmp_path, trials=count(6, 200))
    times = show_at_desk(protocol, tmp_path / "data", display, window)
    print(f"{window}: {times.describe()}")
    assert len(times.seen) == count(6, 200)
    assert np.median(np.abs(times.claim_errors)) <= FRAME_MS
    [log] = (tmp_path / "data").rglob("*.mcap")
    assert list(find_log_differences(log, World)) == []


@pytest.mark.program
@needs("xvfb", "chromium")
@pytest.mark.nightly
def test_the_log_says_when_pictures_were_in_a_window_of_chromium(tmp_path: Path, display: str) -> None:
    protocol = write_study(tmp_path, trials=count(6, 200), ready="first")
    times = show_in_chromium(protocol, tmp_path / "data", display)
    print(f"Chromium: {times.describe()}")
    assert len(times.seen) == count(6, 200)
    assert np.median(np.abs(times.claim_errors)) <= 2 * FRAME_MS
