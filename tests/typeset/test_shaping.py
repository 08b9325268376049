"""Shaping: letters join and marks attach, each direction keeps its order, and nothing of the machine decides."""

import ast
import os
import subprocess
import sys
import unicodedata
from pathlib import Path

import bidi
import numpy as np
import pytest
from hypothesis import example, given, strategies as st
from PIL import Image, ImageDraw

import minihuman
from minihuman.display import typefaces
from minihuman.display.shaping import ShapedLine, _find_levels, is_rtl, measure_width_px, shape_line
from minihuman.display.text import draw_line, measure_reference_px
from minihuman.display.typefaces import Typeface, can_set, select_typefaces, shipped_typeface
from tests.typefaces import FACE, FOLDER
from tests.typeset.screen_digests import forget_typefaces

SIZE_PX = 40
MIXED = "אבג abc 123 דהו (x) שלום, السلام 45%"
texts = st.text(st.sampled_from("abAB 12.,()-אבש\u05b8عسل٣\u200f\u2067\u2069\u202b\u202c"), max_size=20)


def shape(text: str, language: str = "en", *, rtl: bool = False) -> ShapedLine:
    return shape_line(text, select_typefaces(language), SIZE_PX, rtl=rtl)


def draw(text: str, language: str = "en", *, rtl: bool = False) -> np.ndarray:
    image = Image.new("L", (600, 80))
    faces = select_typefaces(language)
    draw_line(ImageDraw.Draw(image), (20, 40), text, faces=faces, size_px=SIZE_PX, colour=(255,), rtl=rtl)
    return np.asarray(image)


def count_blobs_apart(picture: np.ndarray) -> int:
    """How many pieces of ink have an empty column between them."""
    inked = (picture > 0).any(axis=0)
    return int((np.diff(inked.astype(int)) == 1).sum())


def test_letters_of_arabic_join() -> None:
    assert count_blobs_apart(draw("سلم", "ar", rtl=True)) == 1
    apart = sum(shape(letter, "ar", rtl=True).width_64 for letter in "سلم")
    assert shape("سلم", "ar", rtl=True).width_64 < apart


def test_a_point_of_hebrew_lies_below_its_letter_and_takes_no_room() -> None:
    assert shape("בַ", "he", rtl=True).width_64 == shape("ב", "he", rtl=True).width_64
    assert (draw("בַ", "he", rtl=True) > 0).sum() > (draw("ב", "he", rtl=True) > 0).sum()


def test_the_first_letter_of_a_right_to_left_line_is_its_rightmost() -> None:
    *_, rightmost = shape("אב", "he", rtl=True).glyphs
    [first] = shape("א", "he", rtl=True).glyphs
    assert rightmost.glyph == first.glyph


def test_numbers_and_latin_words_keep_their_direction_in_a_right_to_left_line() -> None:
    glyphs = [glyph.glyph for glyph in shape("אב 12", "he", rtl=True).glyphs]
    one, two = (shape(digit).glyphs[0].glyph for digit in "12")
    assert glyphs[:2] == [one, two]


def test_a_pair_of_letters_is_kerned() -> None:
    assert shape("AV").width_64 < shape("A").width_64 + shape("V").width_64


def test_a_sign_keeps_its_width_in_every_size() -> None:
    widths = [measure_width_px("Width", select_typefaces("en"), size_px) / size_px for size_px in (20, 40, 200)]
    assert max(widths) - min(widths) < 0.02


@given(texts, st.booleans())
@example("b\u202b \u202c", True)
@example("1\u05e9 \u202b\u2067", False)
def test_characters_stand_in_the_order_of_the_bidirectional_algorithm(text: str, rtl: bool) -> None:
    """Reordered by our levels and rule L2, the text is what python-bidi shows."""
    levels = list(_find_levels(text, rtl=rtl))
    order = list(range(len(text)))
    for level in range(max(levels, default=0), 0, -1):
        place = 0
        while place < len(order):
            stop = place
            while stop < len(order) and levels[order[stop]] >= level:
                stop += 1
            order[place:stop] = reversed(order[place:stop])
            place = max(stop, place + 1)
    removed = {"BN", "LRE", "RLE", "LRO", "RLO", "PDF", "LRI", "RLI", "FSI", "PDI"}  # shown by nobody

    def visible(characters: str) -> str:
        return "".join(one for one in characters if unicodedata.bidirectional(one) not in removed)

    expected = bidi.get_display(text, base_dir="R" if rtl else "L") if text else ""
    assert visible("".join(text[place] for place in order)) == visible(expected)


@given(st.text(max_size=30))
def test_any_text_can_be_measured_and_drawn(text: str) -> None:
    draw(text, rtl=is_rtl(text))
    assert measure_reference_px(text) >= 0


def test_half_a_character_that_a_page_sends_is_a_box() -> None:
    assert shape("א\ud800b", "he", rtl=True).width_64 > shape("אb", "he", rtl=True).width_64


def test_a_line_is_the_same_in_every_locale(tmp_path: Path) -> None:
    program = (
        "import contextlib, hashlib, locale\n"
        "with contextlib.suppress(locale.Error): locale.setlocale(locale.LC_ALL, '')\n"
        "from tests.typeset.test_shaping import MIXED, draw\n"
        "print(hashlib.sha256(draw(MIXED + ' fi ş', rtl=True).tobytes()).hexdigest())"
    )
    environment = os.environ | {"PYTHONUTF8": "1"}
    digests = {
        subprocess.run(
            [sys.executable, "-c", program],
            cwd=Path(__file__).parents[2],
            env=environment | {"LC_ALL": name, "LANG": name, "TZ": zone, "PYTHONHASHSEED": seed},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for name, zone, seed in (("C", "UTC", "0"), ("tr_TR.UTF-8", "Asia/Tokyo", "1"), ("ar_EG.UTF-8", "UTC", "2"))
    }
    assert len(digests) == 1


def test_no_module_lets_pillow_choose_how_text_is_laid_out() -> None:
    """Where it may choose, it does by whether the system has FriBiDi."""
    free = []
    for path in Path(minihuman.__file__).parent.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text)) if "truetype" in text else ():
            if isinstance(node, ast.Call) and ast.unparse(node.func).endswith("truetype"):
                free += [path.name] * ("layout_engine" not in {keyword.arg for keyword in node.keywords})
    assert free == []


def test_pages_are_measured_as_on_a_machine_without_a_font(monkeypatch: pytest.MonkeyPatch) -> None:
    text = "很长的标题 with Latin, हिन्दी and שלום 12"
    forget_typefaces()
    here = measure_reference_px(text)
    monkeypatch.setattr(typefaces, "_list_font_folders", lambda: iter(()))
    forget_typefaces()
    measure_reference_px.cache_clear()
    assert measure_reference_px(text) == here
    forget_typefaces()


def test_a_face_without_rules_for_a_script_whose_letters_join_cannot_set_it(tmp_path: Path) -> None:
    from fontTools.ttLib import TTFont

    with TTFont(shipped_typeface().path) as font:
        del font["GSUB"]
        font.save(tmp_path / "NoRules.ttf")
    bare = Typeface(str(tmp_path / "NoRules.ttf"))
    assert can_set(shipped_typeface(), "ع")
    assert not can_set(bare, "ع")
    assert can_set(bare, "א")
    assert can_set(bare, "a")


def test_the_face_of_a_language_is_asked_first_where_several_have_its_characters(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "fonts"
    folder.mkdir()
    for name in ("NotoSansJP-Regular.otf", "NotoSansSC-Regular.otf"):
        (folder / name).symlink_to(FACE)
    monkeypatch.setattr(typefaces, "_list_font_folders", lambda: iter([folder]))
    forget_typefaces()
    chosen = {language: select_typefaces(language).of("中") for language in ("zh", "ja")}
    forget_typefaces()
    assert {language: face and face.name for language, face in chosen.items()} == {
        "zh": "NotoSansSC-Regular.otf",
        "ja": "NotoSansJP-Regular.otf",
    }


def test_the_tests_own_face_has_all_that_they_draw() -> None:
    from tests.typefaces import list_test_characters

    assert FACE.is_relative_to(FOLDER)
    lacking = [character for character in list_test_characters() if not can_set(Typeface(str(FACE)), character)]
    assert lacking == [], "python -m tests.typefaces NotoSansCJK-Regular.ttc takes them out of the whole face"
