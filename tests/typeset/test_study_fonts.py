"""A study's own faces: asked first where they have a character, named by `check` where they are missing."""

import shutil
import sys
from pathlib import Path

import matplotlib
import numpy as np
import pytest

from minihuman.display import typefaces
from minihuman.display.drawing.screen import compose_screen
from minihuman.display.typefaces import find_installed_typeface, select_typefaces, shipped_typeface
from minihuman.experiment.machine.screens import TextScreen
from minihuman.experiment.words import InterfaceWords

FACE = "STIXGeneral.ttf"  # comes with matplotlib; a serif face without Hebrew


@pytest.fixture
def its_face(tmp_path, monkeypatch):
    """A face in the user's own folder."""
    folder = tmp_path / ("Library/Fonts" if sys.platform == "darwin" else ".local/share/fonts")
    folder.mkdir(parents=True)
    shutil.copy(Path(matplotlib.get_data_path()) / "fonts" / "ttf" / FACE, folder)
    monkeypatch.setenv("HOME", str(tmp_path))
    _forget()
    yield find_installed_typeface(FACE)
    _forget()


def _forget():
    for remembered in (typefaces._find_font_files, typefaces._list_installed_typefaces, typefaces.select_typefaces):
        remembered.cache_clear()


def test_a_face_that_the_study_names_is_asked_first_and_ours_where_it_has_nothing(its_face):
    asked = select_typefaces("en", fonts=(FACE,))
    assert asked.of("a") == its_face
    assert asked.of("א") == shipped_typeface()
    assert select_typefaces("en").of("a") == shipped_typeface()


def test_a_face_that_is_not_installed_is_passed_over():
    assert select_typefaces("en", fonts=("NoSuchFace.ttf",)).of("a") == shipped_typeface()


def test_a_screen_is_drawn_in_the_studys_face(its_face):
    def drawn(*fonts):
        return compose_screen(
            TextScreen("Welcome", "Please read.", "Enter", locale=InterfaceWords("en", {}, fonts).locale), (640, 480)
        )

    assert not np.array_equal(drawn(FACE), drawn())
    assert np.array_equal(drawn("NoSuchFace.ttf"), drawn())
