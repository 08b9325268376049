"""All screens in eight languages: the same pictures on every machine, whatever fonts and libraries it has."""

import json

import pytest

from minihuman.display import typefaces
from minihuman.experiment.words import LANGUAGES
from tests.typefaces import FOLDER
from tests.typeset.screen_digests import FILE, digest_screens, forget_typefaces


@pytest.fixture
def faces_of_the_tests(monkeypatch: pytest.MonkeyPatch) -> None:
    """No face but those that ship with the package and the tests: what a machine has differs."""
    monkeypatch.setattr(typefaces, "_list_font_folders", lambda: iter([FOLDER / "fonts"]))
    forget_typefaces()
    yield
    forget_typefaces()


@pytest.mark.usefixtures("faces_of_the_tests")
@pytest.mark.parametrize("language", LANGUAGES)
def test_every_screen_of_a_language_has_the_pixels_that_it_has_everywhere(language: str) -> None:
    expected = json.loads(FILE.read_text(encoding="utf-8"))[language]
    drawn = digest_screens(language)
    assert drawn.keys() == expected.keys()
    assert {name for name in expected if drawn[name] != expected[name]} == set()
