"""Emphasis and lists in texts: the same words are set apart in a window and in a browser."""

from pathlib import Path

import numpy as np
import pytest

from minihuman.display.drawing import sheet
from minihuman.display.drawing.screen import compose_screen
from minihuman.display.drawing.sheet import Sheet
from minihuman.display.text import EMPHASIS_MARK, break_page_lines, style_lines
from minihuman.experiment.machine.screens import PageScreen, TextLocale
from tests.machine import needs
from tests.web.browser import browsing
from tests.web.serving import serving

M = EMPHASIS_MARK
CASES = [
    ("Please *read* this.", ["read"]),
    ("*All of it*", ["all of it"]),
    ("one *two* and *three four*, five", ["two", "three four"]),
    ("2*3*4 and 5 * 6 * 7", []),
    ("required * and * optional", []),
    ("**not this**", []),
    ("a word*s end* here", []),
    ("over\n*two\nlines* of a paragraph", ["two\nlines"]),
    ("not *over\n\na blank* line", []),
    ("(*in brackets*)", ["in brackets"]),
    ("קראו *בעיון* את הטקסט", ["בעיון"]),
    ("问题 *很重要*。", ["很重要"]),
    ("* first\n* second", []),
]
TEXT = """Please *read this carefully*.

- You may stop at any time.
- Your data are *anonymous*.

It takes 5 minutes."""


@pytest.mark.parametrize(("text", "emphasised"), CASES)
def test_what_is_emphasised(text: str, emphasised: list[str]):
    styled = "\n".join(style_lines(text.split("\n"))).replace(f"{M}\n{M}", "\n")
    assert [piece.lower() for piece in styled.split(M)[1::2]] == emphasised
    assert styled.replace(M, "").replace("\u2022", "*") == (text if not emphasised else _bare(text, emphasised))


def _bare(text: str, emphasised: list[str]) -> str:
    for words in emphasised:
        at = text.lower().index(f"*{words}*")
        text = text[:at] + text[at + 1 : at + 1 + len(words)] + text[at + 2 + len(words) :]
    return text


def test_a_line_that_begins_within_is_emphasised_from_its_beginning():
    assert style_lines(["a *b", "c", "d* e"]) == [f"a {M}b{M}", f"{M}c{M}", f"{M}d{M} e"]


def test_items_of_a_list_have_bullets():
    assert style_lines(["- one", "  - two", "-3 degrees", "a - b"]) == ["• one", "  • two", "-3 degrees", "a - b"]


@pytest.mark.parametrize("rtl", [False, True])
def test_emphasised_words_are_bold_and_in_the_accent_colour_and_the_line_is_as_long_as_measured(rtl: bool):
    page = Sheet((1200, 200), TextLocale("he" if rtl else "en", rtl))
    line = style_lines(["קראו *בעיון* את" if rtl else "Please *read* this"])[0]
    page.put((600, 100), line, 40, sheet.INK, "m")
    drawn = np.argwhere((np.asarray(page.page) != sheet.BACKGROUND).any(axis=2))[:, 1]
    assert abs((drawn.max() - drawn.min()) - page.width_px(line, 40)) < 8
    assert abs((drawn.max() + drawn.min()) / 2 - 600) < 4
    accent = np.argwhere((np.asarray(page.page) == sheet.ACCENT).all(axis=2))[:, 1]
    assert len(accent)
    assert drawn.min() + 40 < accent.min() < accent.max() < drawn.max() - 20


def test_lines_are_broken_as_if_there_were_no_emphasis_but_its_marks():
    text = "An *emphasised part of a sentence that is long enough to be broken* " * 4
    lines = style_lines(break_page_lines(text.strip()))
    assert [line.replace(M, "").count("*") for line in lines] == [0] * len(lines)
    assert all(line.count(M) % 2 == 0 for line in lines)


def test_a_window_shows_no_marks(tmp_path: Path):
    shown = compose_screen(PageScreen("Consent", TEXT, 1, 1, ""), (960, 720))
    assert (shown == sheet.ACCENT).all(axis=2).sum() > 50


@pytest.mark.program
@needs("chromium")
def test_the_page_emphasises_what_a_window_does(tmp_path: Path):
    path = tmp_path / "emphasis.toml"
    path.write_text(f'''
[study]
name = "emphasis"
version = "1"
seed = 4
consent = """{TEXT}"""
[keys]
keyboard_check = false
[[groups]]
name = "all"
blocks = ["play"]
[[blocks]]
name = "play"
world = "minihuman/MiniGrid-FourRooms-v0"
episodes = 1
actions = ["left", "right", "forward"]
max_steps = 2
''')
    with serving(path, tmp_path) as served, browsing() as sit_down:
        person = sit_down(f"http://127.0.0.1:{served.port}/#t={served.tokens[0]}")
        person.until("s.kind === 'page'")
        person.page.screenshot(path=str(tmp_path / "consent.png"))
        assert person.page.locator("em").all_inner_texts() == ["read this carefully", "anonymous"]
        assert "• You may stop" in person.screen()
        assert "*" not in person.screen()
        found = person.page.evaluate(
            "async ([module, texts]) => { const { prose } = await import(module);"
            " return texts.map((text) => [...prose({}, text).querySelectorAll('em')].map((em) => em.textContent)); }",
            ["/static/elements.js", [text for text, _ in CASES]],
        )
        assert [[words.lower() for words in each] for each in found] == [emphasised for _, emphasised in CASES]
        assert person.errors == []
