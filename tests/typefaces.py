"""Faces that tests of other scripts need: ``.ci/run`` installs them; elsewhere such tests are skipped and say so."""

import os

import pytest

from minihuman.display.typefaces import select_typefaces
from minihuman.experiment import words


def need_faces(language: str) -> None:
    """Skip the test where no face has the language's characters; fail it in CI."""
    if missing := select_typefaces(language).missing("".join(words.load_words(language).values())):
        told = f"no face has {missing!r} of {language}; apt-get install fonts-noto-core fonts-noto-cjk"
        if os.environ.get("CI"):
            pytest.fail(told)
        pytest.skip(told)
