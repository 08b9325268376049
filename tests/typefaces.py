"""Faces that tests of other scripts need: ``.ci/run`` installs them; elsewhere such tests are skipped and say so."""

import os

import pytest

from minihuman.study import words
from minihuman.typeset.faces import faces_for


def need_faces(language: str) -> None:
    """Skip the test where no face has the language's characters; fail it in CI."""
    if missing := faces_for(language).missing("".join(words.of(language).values())):
        told = f"no face has {missing!r} of {language}; apt-get install fonts-noto-core fonts-noto-cjk"
        if os.environ.get("CI"):
            pytest.fail(told)
        pytest.skip(told)
