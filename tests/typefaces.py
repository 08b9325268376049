"""Faces that tests of other scripts need: a small one with Chinese and Japanese lies beside them.

``python -m tests.typefaces NotoSansCJK-Regular.ttc`` takes the characters that the tests draw out of the whole face; it
needs fontTools, which Matplotlib brings.
"""

import os
import re
import sys
from pathlib import Path

import pytest

from minihuman.display.typefaces import select_typefaces
from minihuman.experiment import words

ROOT = Path(__file__).parents[1]
FOLDER = ROOT / "tests" / "typeset"  # its folder "fonts" is looked into, as those of the system are
FACE = FOLDER / "fonts" / "NotoSansCJKsc-Regular.otf"
_SIMPLIFIED_CHINESE = 2  # the face's place in the collection
_SOURCES = ("tests/**/*.py", "minihuman/**/*.toml", "minihuman/display/*.py", "protocols/**/*.toml")
_EAST_ASIAN = re.compile("[\u2e80-\u9fff\uf900-\ufaff\ufe30-\ufe4f\uff00-\uffef]")
_ALWAYS = "".join(map(chr, (*range(0x20, 0x7F), *range(0x3041, 0x3097), *range(0x30A1, 0x30FB))))
_SIGNS = "\u2014\u2018\u2019\u201c\u201d\u2026\u30fb\u30fc"


def use_test_faces() -> None:
    """Let this process and those that it starts find the tests' face, after all that the system has."""
    folders = os.environ.get("XDG_DATA_DIRS") or "/usr/local/share:/usr/share"
    os.environ["XDG_DATA_DIRS"] = f"{folders}:{FOLDER}"


def need_faces(language: str) -> None:
    """Skip the test where no face has the language's characters: on macOS and Windows, without one installed."""
    if missing := select_typefaces(language).missing("".join(words.load_words(language).values())):
        reason = (
            f"no face has {missing!r} of {language}; install Noto Sans CJK, or: python -m tests.typefaces COLLECTION"
        )
        if sys.platform == "linux":
            pytest.fail(reason)
        pytest.skip(reason)


def list_test_characters() -> str:
    """List the characters that tests, protocols and shipped texts have of Chinese and Japanese, and some always."""
    paths = sorted(path for pattern in _SOURCES for path in ROOT.glob(pattern))
    found = {character for path in paths for character in _EAST_ASIAN.findall(path.read_text(encoding="utf-8"))}
    return "".join(sorted(found | set(_ALWAYS + _SIGNS)))


def write_test_face(collection: Path) -> None:
    from fontTools import subset

    options = subset.Options(
        layout_features=["ccmp", "kern", "locl", "mark", "mkmk"],
        hinting=False,
        name_IDs=[0, 1, 2, 3, 4, 5, 6, 13, 14],
        font_number=_SIMPLIFIED_CHINESE,
    )
    face = subset.load_font(str(collection), options)
    subsetter = subset.Subsetter(options)
    subsetter.populate(text=list_test_characters())
    subsetter.subset(face)
    subset.save_font(face, str(FACE), options)


if __name__ == "__main__":
    write_test_face(Path(sys.argv[1]))
