"""A study's own faces: asked first where they have a character, named by `check` where they are missing."""

import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

from minihuman.study.screens import TextScreen
from minihuman.study.words import Words
from minihuman.typeset import faces
from minihuman.typeset.faces import faces_for, installed, shipped
from minihuman.windows.compose import compose

FACE = "STIXGeneral.ttf"  # comes with matplotlib; a serif face without Hebrew


@pytest.fixture
def its_face(tmp_path, monkeypatch):
    """A face in the user's own folder."""
    folder = tmp_path / ("Library/Fonts" if sys.platform == "darwin" else ".local/share/fonts")
    folder.mkdir(parents=True)
    shutil.copy(Path(shipped().path).with_name(FACE), folder)
    monkeypatch.setenv("HOME", str(tmp_path))
    _forget()
    yield installed(FACE)
    _forget()


def _forget():
    for remembered in (faces._files, faces._installed, faces.faces_for):
        remembered.cache_clear()


def test_a_face_that_the_study_names_is_asked_first_and_ours_where_it_has_nothing(its_face):
    asked = faces_for("en", fonts=(FACE,))
    assert asked.of("a") == its_face
    assert asked.of("א") == shipped()
    assert faces_for("en").of("a") == shipped()


def test_a_face_that_is_not_installed_is_passed_over():
    assert faces_for("en", fonts=("NoSuchFace.ttf",)).of("a") == shipped()


def test_a_screen_is_drawn_in_the_studys_face(its_face):
    def drawn(*fonts):
        return compose(TextScreen("Welcome", "Please read.", "Enter", script=Words("en", {}, fonts).script), (640, 480))

    assert not np.array_equal(drawn(FACE), drawn())
    assert np.array_equal(drawn("NoSuchFace.ttf"), drawn())
