"""Pages: nothing of a text is lost, one is read to its end before it is agreed to."""

import numpy as np
import pytest

from minihuman.display.drawing import sheet
from minihuman.display.drawing.screen import compose_screen, find_spot
from minihuman.display.text import break_page_lines, count_page_lines, paginate_text, wrap_text
from minihuman.display.typefaces import select_typefaces
from minihuman.experiment import words
from minihuman.experiment.machine.events import Noted, PageShown, SessionEnded
from minihuman.experiment.machine.inputs import PointerPressed
from minihuman.experiment.machine.screens import PageScreen, TextLocale
from minihuman.experiment.machine.transitions import Phase
from minihuman.experiment.words import LANGUAGES
from tests.counts import count
from tests.study.sessions import Desk
from tests.study.studies import CORRIDOR, plan_of
from tests.typefaces import need_faces

LENGTHS = (10, 100, 700, 5000)
CONSENT = '[[pages]]\nname = "consent"\nasks_consent = true\ntext = """{text}"""\n'


def text_of(language: str, length: int) -> str:
    """So many words of the interface, in sentences and paragraphs."""
    its = [text for key, text in words.load_words(language).items() if "{" not in text and key != "direction"]
    sentences = [its[number % len(its)] for number in range(length)]
    gap = "" if language in ("zh", "ja") else " "
    return "\n\n".join(gap.join(sentences[start : start + 12]) for start in range(0, length, 12))[: length * 6]


def inked(text: str) -> str:
    return "".join(text.split())


@pytest.mark.parametrize("language", LANGUAGES)
@pytest.mark.parametrize("length", LENGTHS[: count(3, 4)])
def test_every_character_is_on_some_page_and_has_a_face(language, length):
    need_faces(language)
    text, faces = text_of(language, length), select_typefaces(language)
    found = paginate_text(text)
    assert inked("".join(found)) == inked(text)
    assert faces.missing(text) == ""
    assert all(len(break_page_lines(page)) <= count_page_lines(picture=False) for page in found)


@pytest.mark.parametrize("language", LANGUAGES)
@pytest.mark.parametrize("size_px", [(1280, 720), (1024, 768), (1920, 1080)][: count(1, 3)])
def test_a_full_page_leaves_its_margins_clear(language, size_px):
    [first, *_] = paginate_text(text_of(language, 700))
    locale = TextLocale(language, language in ("ar", "he"))
    shown = compose_screen(PageScreen("", first, 2, 3, "", (), locale=locale), size_px)
    ink = (shown != np.array(sheet.BACKGROUND)).any(axis=2)
    height, width = ink.shape
    margin = round(min(height, width * 3 / 4) * 0.02)
    assert ink.any()
    side = (width - round(min(height, width * 3 / 4) * 4 / 3)) // 2 + margin
    assert not ink[:, :side].any()
    assert not ink[:, width - side :].any()
    assert not ink[:margin].any()
    rows = np.nonzero(ink.any(axis=1))[0]
    assert rows.max() < height * 0.84  # above where the buttons are


def test_lines_follow_each_other_wherever_a_page_began():
    text = " ".join(["Taking part is voluntary, and you may stop at any time."] * 90)
    whole = break_page_lines(text)
    assert [line for page in paginate_text(text) for line in break_page_lines(page)] == whole


def test_chinese_signs_begin_no_line():
    faces = select_typefaces("zh")
    text = "感谢您考虑参加本项研究。在您决定之前，请您仔细阅读以下内容！" * 9
    for wide_px in range(300, 360, 7):
        lines = wrap_text(text, faces=faces, size_px=30, max_width_px=wide_px)
        assert "".join(lines) == text
        assert all(line[0] not in "。，！" for line in lines)


def test_a_heading_does_not_stand_alone_at_the_end_of_a_page():
    for fill in range(1, count_page_lines(picture=False) + 1):
        text = "\n".join(["A line of its own."] * fill + ["", "What we ask of you", "word " * 120])
        for page in paginate_text(text)[:-1]:
            assert not page.endswith("What we ask of you")


def consent(text: str) -> Desk:
    return Desk(plan_of(CONSENT.format(text=text) + CORRIDOR, ["consent", "corridor"]))


LONG = "You may stop at any time without giving a reason. " * 120


def test_a_consent_is_read_to_its_end_before_it_can_be_agreed_to():
    desk = consent(LONG)
    count_of_pages = desk.session.screen.pages
    assert count_of_pages > 3
    for page in range(1, count_of_pages):
        assert desk.session.screen.page == page
        assert not any(event.kind == "consent" for event in desk.of(Noted))
        desk.press("enter")
    desk.press("right", "space")  # an arrow too many agrees to nothing
    assert desk.session.phase is Phase.CONSENT
    assert desk.session.screen.prompt == words.load_words("en")["consent.prompt"]
    desk.press("enter")
    [note] = [event for event in desk.of(Noted) if event.kind == "consent"]
    assert desk.plan.consent_sha256 in note.text
    assert desk.session.phase is Phase.READY


def test_pages_turn_back_and_forward_by_key_and_by_button():
    desk = consent(LONG)
    desk.press("right", "page_down", "left", "space", "page_up")
    assert desk.session.screen.page == 2
    for name, page in (("go_on", 3), ("back", 2), ("back", 1), ("back", 1)):
        desk.give(PointerPressed(desk.now_ns, 0.5, 0.5, name))
        assert desk.session.screen.page == page


def test_the_buttons_are_where_they_are_drawn():
    desk = consent(LONG)
    desk.press("enter")
    found = {find_spot(desk.session.screen, (1280, 720), x / 200, y / 200)[0] for x in range(200) for y in range(200)}
    assert found == {"", "go_on", "back", "decline"}


def test_the_log_says_when_each_page_was_on_the_display():
    desk = consent(LONG)
    desk.show()
    desk.press("enter")
    desk.show()
    assert [(event.page, event.pages) for event in desk.of(PageShown)] == [
        (1, desk.session.screen.pages),
        (2, desk.session.screen.pages),
    ]


def test_escape_over_a_consent_ends_the_session_when_it_is_held():
    desk = consent("Short.")
    desk.press("escape")
    desk.hold("escape", 500)
    assert desk.session.phase is Phase.CONSENT
    desk.quit()
    assert desk.of(SessionEnded)[0].reason == "quit"


def test_a_page_shows_the_world_with_words_at_its_things():
    rest = """
[[pages]]
name = "how"
text = "Find the goal."
[pages.example]
world = "minihuman/MiniGrid-Empty-8x8-v0"
seed = 1
marks = { agent = "this is you", "green goal" = "goal" }
"""
    screen = Desk(plan_of(rest, ["how"])).session.screen
    assert [mark.label for mark in screen.marks] == ["this is you", "goal"]
    agent, goal = screen.marks
    assert (agent.x, agent.y) == pytest.approx((1.5 / 8, 1.5 / 8))
    assert (goal.x, goal.y) == pytest.approx((6.5 / 8, 6.5 / 8))
    assert screen.picture is not None
