from collections.abc import Sequence

import numpy as np
import pytest

from minihuman.display.drawing import sheet
from minihuman.display.drawing.play_screens import locate_picture
from minihuman.display.drawing.screen import compose_screen, picture_size_px, repaint_screen
from minihuman.display.drawing.sheet import arrange_keycaps
from minihuman.display.mission_paragraphs import split_mission
from minihuman.experiment.keys import KEY_NAMES, key_caption as caption, key_label
from minihuman.experiment.machine.screens import PlayScreen, Screen, TextScreen

SIZES = ((1280, 720), (1024, 768), (1920, 1080), (640, 360))
HD = SIZES[0]
BACKGROUND = np.array(sheet.BACKGROUND, np.uint8)


def lit_pixels(picture: np.ndarray, colour: Sequence[int]) -> int:
    return int((picture == np.array(colour, np.uint8)).all(axis=2).sum())


def edge_is_empty(picture: np.ndarray) -> bool:
    edges = (picture[:2], picture[-2:], picture[:, :2], picture[:, -2:])
    return all((edge == BACKGROUND).all() for edge in edges)


RULE = "If you put a purple hexagon directly to the left of a purple pyramid, the two turn into an orange key."
EIGHT_RULES = "Goal: Pick up a key. Rules: " + " ".join(f"({number}) {RULE}" for number in range(1, 9))


@pytest.mark.parametrize("size_px", SIZES)
def test_a_screen_fills_the_window(size_px: tuple[int, int]) -> None:
    screens = (
        TextScreen("Title", "Body", "Prompt"),
        PlayScreen(np.zeros((56, 56, 3), np.uint8), "mission", "progress"),
    )
    for screen in screens:
        picture = compose_screen(screen, size_px)
        assert picture.shape == (size_px[1], size_px[0], 3)
        assert picture.dtype == np.uint8


def test_the_same_screen_gives_the_same_picture_and_the_callers_may_draw_on_it() -> None:
    screen = PlayScreen(np.full((56, 56, 3), 200, np.uint8), "mission", "progress", (("1", "left"),))
    first = compose_screen(screen, HD)
    kept = first.copy()
    first[:] = 0
    assert np.array_equal(compose_screen(screen, HD), kept)
    words = TextScreen("Title", "Body", "Prompt")
    compose_screen(words, HD)[:] = 0
    assert compose_screen(words, HD).any()


def test_from_step_to_step_only_the_worlds_picture_is_painted() -> None:
    dark, light = (PlayScreen(np.full((7, 9, 3), shade, np.uint8), "mission", "1 of 2") for shade in (10, 200))
    frame = compose_screen(dark, HD)
    left, top, width, height = repaint_screen(frame, dark, light)
    assert np.array_equal(frame, compose_screen(light, HD))
    assert (width, height) < picture_size_px(HD)
    assert (frame[top : top + height, left : left + width] == 200).all()


@pytest.mark.parametrize(
    "next_screen",
    [
        TextScreen("Rest", "", ""),
        PlayScreen(np.zeros((7, 9, 3), np.uint8), "mission", "2 of 2"),
        PlayScreen(np.zeros((9, 7, 3), np.uint8), "mission", "1 of 2"),
        PlayScreen(np.zeros((7, 9, 3), np.uint8), "mission", "1 of 2", (("1", "left"),)),
    ],
)
def test_whatever_else_changes_the_whole_frame_is_painted(next_screen: Screen) -> None:
    shown = PlayScreen(np.full((7, 9, 3), 90, np.uint8), "mission", "1 of 2")
    frame = compose_screen(shown, HD)
    assert repaint_screen(frame, shown, next_screen) == (0, 0, *HD)
    assert np.array_equal(frame, compose_screen(next_screen, HD))


def test_a_small_picture_is_enlarged_by_a_whole_number_and_centred() -> None:
    colours = np.random.default_rng(0).integers(1, 255, (7, 7, 3), dtype=np.uint8)
    shown = compose_screen(PlayScreen(colours, "", ""), HD)
    scale = picture_size_px(HD)[1] // 7
    rows, columns = np.nonzero((shown != BACKGROUND).any(axis=2))
    cut = shown[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
    assert np.array_equal(cut, np.kron(colours, np.ones((scale, scale, 1), np.uint8)))
    assert abs(columns.min() + columns.max() + 1 - HD[0]) <= 1


def test_a_large_picture_is_averaged_into_the_room_it_has() -> None:
    picture = np.zeros((2000, 3000, 3), np.uint8)
    picture[:, ::2] = 255
    shown = compose_screen(PlayScreen(picture, "", ""), HD)
    width, height = picture_size_px(HD)
    columns = np.nonzero((shown != BACKGROUND).any(axis=(0, 2)))[0]
    assert columns.max() - columns.min() + 1 <= width
    assert 100 < shown[HD[1] // 2, HD[0] // 2].mean() < 155
    assert edge_is_empty(shown)
    assert height < HD[1]


@pytest.mark.parametrize("size_px", SIZES)
def test_rules_stand_on_both_sides_of_the_picture_and_the_goal_alone_above_it(size_px: tuple[int, int]) -> None:
    picture = np.full((90, 90, 3), 200, np.uint8)
    goal_alone = compose_screen(PlayScreen(picture, "Goal: Pick up a key.", ""), size_px)
    shown = compose_screen(PlayScreen(picture, EIGHT_RULES, ""), size_px)
    left, top, width, _ = locate_picture(picture, size_px)
    rules = (shown != goal_alone).any(axis=2)
    assert rules[:, :left].any()
    assert rules[:, left + width :].any()
    assert not rules[:top].any()
    assert not rules[:, left : left + width].any()
    assert edge_is_empty(shown)


def test_only_a_mission_with_rules_has_paragraphs() -> None:
    rules = [f"({number}) {RULE}" for number in range(1, 9)]
    assert split_mission(EIGHT_RULES) == ["Goal: Pick up a key.", "Rules:", *rules]
    assert split_mission(f"Goal: Pick up a key. Rule: {RULE}") == ["Goal: Pick up a key.", f"Rule: {RULE}"]
    for mission in ("", "get to the green goal square", "put the red ball next to a box, then open a door (1)"):
        assert split_mission(mission) == [mission]


def test_first_person_pictures_get_640_by_480_in_the_usual_window() -> None:
    width, height = picture_size_px(HD)
    assert width >= 640
    assert height >= 480


@pytest.mark.parametrize("size_px", SIZES)
@pytest.mark.parametrize("paragraphs", [1, 3, 8])
def test_long_texts_stay_on_the_page(size_px: tuple[int, int], paragraphs: int) -> None:
    body = "\n\n".join(["You may stop at any time without giving a reason. " * 3] * paragraphs)
    shown = compose_screen(TextScreen("Consent", body, "Press Enter if you agree, Escape if you do not"), size_px)
    assert edge_is_empty(shown)
    assert lit_pixels(shown, sheet.ACCENT) > 0


def test_a_word_longer_than_the_line_is_broken() -> None:
    assert edge_is_empty(compose_screen(TextScreen("", "x" * 400, ""), HD))


def test_no_last_word_stands_alone() -> None:
    shown = compose_screen(
        TextScreen("", "Press each of these keys once. A key lights up when it has arrived.", ""), HD
    )
    rows = (shown != BACKGROUND).any(axis=2)
    inked = np.nonzero(rows.any(axis=1))[0]
    gap = int(np.argmax(np.diff(inked)))
    second = rows[inked[gap + 1] :].any(axis=0)
    first = rows[: inked[gap] + 1].any(axis=0)
    assert np.ptp(np.nonzero(second)[0]) > 0.5 * np.ptp(np.nonzero(first)[0])


def test_a_key_lights_up_when_it_has_been_pressed() -> None:
    pool = tuple(str(digit) for digit in range(1, 10))
    lit = [
        lit_pixels(
            compose_screen(TextScreen("", "", "", keys=tuple((key, key <= last) for key in pool)), HD), sheet.HIGHLIGHT
        )
        for last in ("0", "4", "9")
    ]
    assert lit[0] == 0
    assert lit[1] == pytest.approx(lit[2] * 4 / 9, rel=0.05)


def test_every_key_of_the_vocabulary_can_be_drawn_apart() -> None:
    caps, width, height = arrange_keycaps(sorted(KEY_NAMES))
    assert {cap.key for cap in caps} == KEY_NAMES
    for cap in caps:
        assert 0 <= cap.x <= cap.x + cap.width <= width
        assert 0 <= cap.y <= height - 1
        overlapping = [
            other.key
            for other in caps
            if other is not cap and other.y == cap.y and cap.x < other.x + other.width and other.x < cap.x + cap.width
        ]
        assert overlapping == []
    assert edge_is_empty(
        compose_screen(TextScreen("", "", "", keys=tuple((key, True) for key in sorted(KEY_NAMES))), HD)
    )


def test_no_two_keys_say_the_same() -> None:
    words = [(key_label(key), caption(key)) for key in sorted(KEY_NAMES)]
    assert len(set(words)) == len(words)


def test_keys_lie_as_on_a_keyboard() -> None:
    caps, width, height = arrange_keycaps(("1", "2", "9"))
    assert [(cap.x, cap.y) for cap in caps] == [(0.0, 0.0), (1.0, 0.0), (8.0, 0.0)]
    assert (width, height) == (9.0, 1.0)
    places = {cap.key: (cap.x, cap.y) for cap in arrange_keycaps(("up", "left", "down", "right"))[0]}
    assert places == {"up": (1.0, 0.0), "left": (0.0, 1.0), "down": (1.0, 1.0), "right": (2.0, 1.0)}


def test_a_legend_of_many_actions_stays_on_the_page() -> None:
    legend = tuple((key, f"a_long_action_name_{key}") for key in "123456789")
    picture = np.full((56, 56, 3), 9, np.uint8)
    assert edge_is_empty(compose_screen(PlayScreen(picture, "", "", legend), HD))
    assert lit_pixels(compose_screen(PlayScreen(picture, "", "", legend), HD), sheet.SURFACE) > 0


def test_words_stand_out_from_the_page() -> None:
    def luminance(colour: sheet.Colour) -> float:
        linear = [c / 3294 if c <= 10 else ((c / 255 + 0.055) / 1.055) ** 2.4 for c in colour]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    page = luminance(sheet.BACKGROUND)
    contrast = {
        colour: (luminance(colour) + 0.05) / (page + 0.05) for colour in (sheet.INK, sheet.MUTED_INK, sheet.ACCENT)
    }
    assert contrast[sheet.INK] > 10
    assert all(ratio > 4.5 for ratio in contrast.values())  # WCAG 2.2, level AA
