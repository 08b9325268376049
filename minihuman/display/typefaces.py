"""Typefaces: which face has which character, the faces that ship with the package and those installed here.

Every plan is measured in the shipped faces alone; installed ones are only drawn with.
"""

import os
import sys
import unicodedata
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import uharfbuzz as harfbuzz

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
class Typeface:
    """One face in one file."""

    path: str
    index: int = 0  # in a collection

    @property
    def name(self) -> str:
        """The file's name, to say which it was."""
        return Path(self.path).name


@cache
def open_face(face: Typeface) -> harfbuzz.Face:
    """Open a face's file."""
    return harfbuzz.Face(harfbuzz.Blob.from_file_path(face.path), face.index)


@cache
def list_characters(face: Typeface) -> frozenset[int]:
    """List every character that a face has."""
    return frozenset(open_face(face).unicodes)


@cache
def shipped_typeface(*, bold: bool = False) -> Typeface:
    """DejaVu Sans 2.37, in the folder `fonts`: Latin, Greek, Cyrillic, Arabic, Hebrew and many signs."""
    return Typeface(str(Path(__file__).parent / "fonts" / f"DejaVuSans{'-Bold' if bold else ''}.ttf"))


class TypefaceSet:
    """Faces in the order in which they are asked for a character.

    Args:
        language: decides how characters that Chinese, Japanese and Korean share are drawn.
        bold: whether the one that comes with us is bold; the others are as they are.
        fonts: files of faces to ask before ours, by their names; one that is not installed is passed over.
    """

    def __init__(self, language: str = "en", *, bold: bool = False, fonts: tuple[str, ...] = ()) -> None:
        self.language = language
        self._first = (
            *(face for name in fonts if (face := find_installed_typeface(name)) is not None),
            shipped_typeface(bold=bold),
        )

    def of(self, character: str) -> Typeface | None:
        """The first face that has a character; None if none has."""
        code = ord(character)
        for face in self._first:
            if code in list_characters(face):
                return face
        return next((face for face in _installed_typefaces(self.language) if code in list_characters(face)), None)

    def missing(self, text: str) -> str:
        """The first character of a text that no face has; "" if there is none."""
        for character in dict.fromkeys(text):
            if unicodedata.category(character) not in _UNSEEN and self.of(character) is None:
                return character
        return ""


@cache
def select_typefaces(language: str, *, bold: bool = False, fonts: tuple[str, ...] = ()) -> TypefaceSet:
    """The faces of a language, and those to be asked before them."""
    return TypefaceSet(language, bold=bold, fonts=fonts)


def find_installed_typeface(name: str) -> Typeface | None:
    """The face in the font file of that name; None where this machine has none."""
    path = _files().get(name)
    return None if path is None else Typeface(path)


@cache
def _installed_typefaces(language: str) -> tuple[Typeface, ...]:
    paths = _files()
    index = _CJK_FACE.get(language.lower(), 2)
    faces = [
        Typeface(paths[name], index if name == "NotoSansCJK-Regular.ttc" else 0)
        for name in (*_NOTO, *_SYSTEM)
        if name in paths
    ]
    more = sorted(name for name in paths if name.startswith("NotoSans") and name.endswith("-Regular.ttf"))
    return tuple(faces + [Typeface(paths[name]) for name in more if name not in _NOTO])


@cache
def _files() -> dict[str, str]:
    """Font files of this machine by name."""
    paths: dict[str, str] = {}
    for folder in _folders():
        for root, inner_folders, names in os.walk(folder):
            inner_folders.sort()  # of two files with one name the same everywhere: file systems list them as they like
            for name in names:
                if name.endswith((".ttf", ".ttc", ".otf")):
                    paths.setdefault(name, os.path.join(root, name))
    return paths


def _folders() -> Iterator[Path]:
    home = Path.home()
    if sys.platform == "darwin":
        yield from (home / "Library/Fonts", Path("/Library/Fonts"), Path("/System/Library/Fonts"))
    elif sys.platform == "win32":
        yield Path(os.environ.get("WINDIR", r"C:\Windows")) / "Fonts"
    else:
        yield from (home / ".local/share/fonts", home / ".fonts", Path("/usr/local/share/fonts"))
        yield Path("/usr/share/fonts")
