"""Languages: each complete, no English word left in a screen of a study in another language."""

import re
import string
from pathlib import Path

import pytest

from minihuman.display.drawing.sheet import Sheet
from minihuman.display.typefaces import select_typefaces
from minihuman.errors import ProtocolError
from minihuman.experiment import words
from minihuman.experiment.machine.points import format_points, format_score
from minihuman.experiment.machine.screens import TextLocale
from minihuman.experiment.plan.dry_run import list_missing_words
from minihuman.experiment.protocol.protocol import decode_logged_protocol, decode_protocol
from minihuman.experiment.protocol.specs import SHIPPED_FORMS, load_form
from minihuman.experiment.words import LANGUAGES, InterfaceWords
from minihuman.plugins import QUESTION_GROUP, list_plugin_names
from tests.typefaces import need_faces

ENGLISH = words.load_words("en")
OWN_LANGUAGE = Path(__file__).parents[1] / "recompute/protocols/kadur.toml"  # with every word but a team's
OTHERS = [language for language in LANGUAGES if language != "en"]
# printed so on keys in these countries, or the same word in both languages
SHARED = {"Esc", "Tab", "Alt", "Ctrl", "Num", "Insert", "{points} points", "ltr", "AltGr", "Points", "Enter"}


def fields(text):
    return sorted(name for _, name, _, _ in string.Formatter().parse(text) if name)


@pytest.mark.parametrize("language", OTHERS)
def test_a_language_has_every_word_with_the_same_fields(language):
    its = words.load_words(language)
    assert its.keys() == ENGLISH.keys()
    assert {key: fields(text) for key, text in its.items()} == {key: fields(text) for key, text in ENGLISH.items()}


@pytest.mark.parametrize("language", OTHERS)
def test_no_word_was_left_in_english(language):
    its = words.load_words(language)
    same = {text for key, text in its.items() if text == ENGLISH[key]}
    assert same <= SHARED


@pytest.mark.parametrize("language", LANGUAGES)
def test_every_character_of_a_language_has_a_face(language):
    need_faces(language)
    assert select_typefaces(language).missing("".join(words.load_words(language).values())) == ""


@pytest.mark.parametrize("language", ["zh", "ja", "ar", "he"])
def test_a_language_with_another_script_has_no_latin_word_but_names_of_keys(language):
    for key, text in words.load_words(language).items():
        if key != "direction":
            assert set(re.findall("[A-Za-z]{2,}", re.sub(r"\{\w+\}", "", text))) <= SHARED, key


@pytest.mark.parametrize("language", LANGUAGES)
@pytest.mark.parametrize("name", SHIPPED_FORMS)
def test_a_form_is_there_in_every_language(name, language):
    need_faces(language)
    english, its = load_form(name, "en"), load_form(name, language)
    assert [item.name for item in its.items] == [item.name for item in english.items]
    for item, other in zip(its.items, english.items, strict=True):
        assert item.ask
        assert len(item.options) == len(other.options)
        assert item.codes == other.codes
        assert language == "en" or item.ask != other.ask
    text = its.title + "".join(
        item.ask + item.low + item.high + item.unit + "".join(item.options) for item in its.items
    )
    assert select_typefaces(language).missing(text) == ""


def test_any_word_can_be_replaced():
    assert InterfaceWords("de", {"ready.title": "Los?"})["ready.title"] == "Los?"
    assert InterfaceWords("de")["ready.title"] == "Bereit?"


def test_a_worlds_english_is_shown_in_english_studies_only():
    assert InterfaceWords("en").mission("go to the red ball") == "go to the red ball"
    assert InterfaceWords("de").mission("go to the red ball") == ""
    assert InterfaceWords("de").mission("reach the goal") == "Erreichen Sie das Ziel"


def test_a_sign_stays_before_its_number_also_from_right_to_left():
    """Without the mark, Unicode's rules (UAX 9: a separator beside one number alone) show "0.3-" there."""
    assert format_score(InterfaceWords("ar"), -0.3) == "\u200e-0.3 نقطة"
    assert format_score(InterfaceWords("ar"), 2) == "\u200e+2 نقطة"
    assert format_score(InterfaceWords("en"), -0.3) == "-0.3 points"


def test_less_than_a_tenth_of_a_point_is_none():
    assert format_points(-0.04) == "0"
    assert format_points(-0.06) == "-0.1"


def test_a_language_of_ones_own_needs_a_teams_words_only_for_a_team():
    assert "team.title" not in words.flatten_words(decode_protocol(OWN_LANGUAGE.read_bytes()).words)


def test_a_log_whose_own_language_lacks_a_newer_word_is_read():
    whole = OWN_LANGUAGE.read_bytes().replace(b'language = "he"', b'language = "yi"')  # a language that we lack
    older = re.sub(rb"(?m)^getting_ready .*$", b"", whole, count=1)
    assert older != whole
    with pytest.raises(ProtocolError, match="1 are missing"):
        decode_protocol(older)
    assert decode_logged_protocol(older).study.name


def test_a_study_in_its_own_language_goes_on_without_the_words_that_are_newer_than_it_and_check_names_them():
    older = OWN_LANGUAGE.read_bytes().replace(b'language = "he"', b'language = "yi"')
    for word in words.LATER_WORDS:
        older = re.sub(rf"(?m)^{word.rpartition('.')[2]} .*$".encode(), b"", older)
    protocol = decode_protocol(older)
    assert [line.split()[6] for line in list_missing_words(protocol)] == [f"{word}," for word in words.LATER_WORDS]
    assert set(words.LATER_WORDS) <= set(words.load_words("en"))


@pytest.mark.parametrize("language", LANGUAGES)
def test_how_a_question_is_answered_is_one_line_of_the_screen(language):
    need_faces(language)
    sheet = Sheet((1280, 720), TextLocale(language))
    column_px = 1.16 * sheet.high
    for kind in list_plugin_names(QUESTION_GROUP, built_in=True):
        prompt = InterfaceWords(language).with_kind(kind)[f"prompt.{kind}"]
        assert sheet.width_px(prompt, round(sheet.high / 36)) <= column_px, f"{kind}: shorten {prompt!r}"
