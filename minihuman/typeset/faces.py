"""Faces: which typeface has a character. One comes with a dependency, others are used where they are installed."""

import os
import sys
import unicodedata
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib.util import find_spec
from pathlib import Path

from PIL import ImageFont, features

# Noto faces by the scripts they are for, in the order in which they are asked; then what systems bring themselves.
# Debian and Ubuntu: apt install fonts-noto-core fonts-noto-cjk. Elsewhere: https://fonts.google.com/noto
_NOTO = (
    "NotoSansCJK-Regular.ttc",
    "NotoSans-Regular.ttf",
    "NotoSansArabic-Regular.ttf",
    "NotoSansHebrew-Regular.ttf",
    "NotoSansDevanagari-Regular.ttf",
    "NotoSansBengali-Regular.ttf",
    "NotoSansTamil-Regular.ttf",
    "NotoSansThai-Regular.ttf",
    "NotoSansGeorgian-Regular.ttf",
    "NotoSansArmenian-Regular.ttf",
    "NotoSansEthiopic-Regular.ttf",
    "NotoSansKhmer-Regular.ttf",
    "NotoSansSymbols2-Regular.ttf",
    "NotoSansMath-Regular.ttf",
)
_SYSTEM = (
    "msyh.ttc",
    "YuGothR.ttc",
    "malgun.ttf",
    "Nirmala.ttf",
    "LeelawUI.ttf",
    "PingFang.ttc",
    "Hiragino Sans GB.ttc",
    "ヒラギノ角ゴシック W3.ttc",
    "AppleSDGothicNeo.ttc",
    "Arial Unicode.ttf",
    "Thonburi.ttc",
    "Kohinoor.ttc",
)
_UNSEEN = frozenset({"Cc", "Cf", "Zs", "Zl", "Zp"})  # blanks, line breaks, marks of direction
_CJK_FACE = {"ja": 0, "ko": 1, "zh": 2, "zh-tw": 3, "zh-hk": 4}  # of the collection: the same character, drawn as there


@dataclass(frozen=True, slots=True)
class Face:
    """One face in one file."""

    path: str
    index: int = 0  # in a collection

    @property
    def name(self) -> str:
        """The file's name, to say which it was."""
        return Path(self.path).name


@cache
def characters(face: Face) -> frozenset[int]:
    """Every character that a face has."""
    from fontTools.ttLib import TTFont

    with TTFont(face.path, fontNumber=face.index, lazy=True) as font:
        return frozenset(font.getBestCmap() or {})


@lru_cache(maxsize=256)
def loaded(face: Face, size_px: int) -> ImageFont.FreeTypeFont:
    """A face in a size, shaped by raqm where Pillow has it."""
    engine = ImageFont.Layout.RAQM if features.check("raqm") else ImageFont.Layout.BASIC
    return ImageFont.truetype(face.path, size_px, index=face.index, layout_engine=engine)


@cache
def shipped(*, bold: bool = False) -> Face:
    """DejaVu Sans, which matplotlib brings: Latin, Greek, Cyrillic, Arabic, Hebrew and many signs."""
    spec = find_spec("matplotlib")  # found without importing it, which takes half a second
    assert spec is not None, "matplotlib is a dependency of this package"
    assert spec.origin is not None
    folder = Path(spec.origin).parent / "mpl-data" / "fonts" / "ttf"
    return Face(str(folder / f"DejaVuSans{'-Bold' if bold else ''}.ttf"))


class Faces:
    """Faces in the order in which they are asked for a character.

    Args:
        language: decides how characters that Chinese, Japanese and Korean share are drawn.
        bold: whether the one that comes with us is bold; the others are as they are.
        fonts: files of faces to ask before ours, by their names; one that is not installed is passed over.
    """

    def __init__(self, language: str = "en", *, bold: bool = False, fonts: tuple[str, ...] = ()) -> None:
        self.language = language
        self._first = (*(face for name in fonts if (face := installed(name)) is not None), shipped(bold=bold))

    def of(self, character: str) -> Face | None:
        """The first face that has a character; None if none has."""
        code = ord(character)
        for face in self._first:
            if code in characters(face):
                return face
        return next((face for face in _installed(self.language) if code in characters(face)), None)

    def missing(self, text: str) -> str:
        """The first character of a text that no face has; "" if there is none."""
        for character in dict.fromkeys(text):
            if unicodedata.category(character) not in _UNSEEN and self.of(character) is None:
                return character
        return ""


@cache
def faces_for(language: str, *, bold: bool = False, fonts: tuple[str, ...] = ()) -> Faces:
    """The faces of a language, and those to be asked before them."""
    return Faces(language, bold=bold, fonts=fonts)


def installed(name: str) -> Face | None:
    """The face in the font file of that name; None where this machine has none."""
    path = _files().get(name)
    return None if path is None else Face(path)


@cache
def _installed(language: str) -> tuple[Face, ...]:
    found = _files()
    index = _CJK_FACE.get(language.lower(), 2)
    faces = [
        Face(found[name], index if name == "NotoSansCJK-Regular.ttc" else 0)
        for name in (*_NOTO, *_SYSTEM)
        if name in found
    ]
    more = sorted(name for name in found if name.startswith("NotoSans") and name.endswith("-Regular.ttf"))
    return tuple(faces + [Face(found[name]) for name in more if name not in _NOTO])


@cache
def _files() -> dict[str, str]:
    """Font files of this machine by name."""
    found: dict[str, str] = {}
    for folder in _folders():
        for root, _, names in os.walk(folder):
            for name in names:
                if name.endswith((".ttf", ".ttc", ".otf")):
                    found.setdefault(name, os.path.join(root, name))
    return found


def _folders() -> Iterator[Path]:
    home = Path.home()
    if sys.platform == "darwin":
        yield from (home / "Library/Fonts", Path("/Library/Fonts"), Path("/System/Library/Fonts"))
    elif sys.platform == "win32":
        yield Path(os.environ.get("WINDIR", r"C:\Windows")) / "Fonts"
    else:
        yield from (home / ".local/share/fonts", home / ".fonts", Path("/usr/local/share/fonts"))
        yield Path("/usr/share/fonts")
