"""Typefaces: the characters of each typeface, the typefaces that ship with the package, and those installed here.

Every plan is measured in the shipped typefaces alone; installed ones are used only for drawing.
"""

import os
import re
import sys
import unicodedata
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path

import uharfbuzz as harfbuzz

# Noto faces by script, in the order in which they are searched; then faces that come with operating systems.
_CJK_COLLECTION = "NotoSansCJK-Regular.ttc"
_NOTO = (
    _CJK_COLLECTION,
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
SHARED_SCRIPT = "Zyyy"  # of signs, blanks and marks, which go with the text around them
_UNSEEN = frozenset({"Cc", "Cf", "Zs", "Zl", "Zp"})  # Unicode categories: blanks, line breaks, directional marks
_CJK_FACE = {"ja": 0, "ko": 1, "zh": 2, "zh-tw": 3, "zh-hk": 4}  # of the collection: the same character, drawn as there
_CJK_SUFFIX = {"ja": "JP", "ko": "KR", "zh": "SC", "zh-tw": "TC", "zh-hk": "HK"}  # of the same faces in single files
_OTHERS = re.compile(r"(NotoSans|SourceHanSans)\w*-Regular\.(ttf|otf)")
# Scripts whose letters change or move by what stands beside them: a face needs rules for them (GSUB, or Apple's morx).
_JOINING_SCRIPTS = frozenset(
    [
        "Adlm",
        "Arab",
        "Bali",
        "Beng",
        "Cakm",
        "Deva",
        "Gujr",
        "Guru",
        "Java",
        "Khmr",
        "Knda",
        "Lana",
        "Mlym",
        "Mong",
        "Mymr",
        "Nkoo",
        "Orya",
        "Phag",
        "Rohg",
        "Sinh",
        "Syrc",
        "Taml",
        "Telu",
        "Tibt",
    ]
)


@dataclass(frozen=True, slots=True)
class Typeface:
    """One typeface in a font file."""

    path: str
    index: int = 0  # in a collection

    @property
    def name(self) -> str:
        """The name of the font file."""
        return Path(self.path).name


@cache
def open_face(face: Typeface) -> harfbuzz.Face:
    """Open the font file of a typeface for HarfBuzz."""
    return harfbuzz.Face(harfbuzz.Blob.from_file_path(face.path), face.index)


@cache
def list_characters(face: Typeface) -> frozenset[int]:
    """Return the code points of all characters in a typeface."""
    return frozenset(open_face(face).unicodes)


@cache
def list_joined_scripts(face: Typeface) -> frozenset[str]:
    """Return the scripts (ISO 15924 codes) for which a typeface has rules that join and place letters."""
    harfbuzz_face = open_face(face)
    if "morx" in harfbuzz_face.table_tags:  # Apple's rules do not name scripts
        return _JOINING_SCRIPTS
    return frozenset(harfbuzz.ot_tag_to_script(tag) for tag in harfbuzz_face.get_table_script_tags("GSUB"))


@lru_cache(maxsize=4096)
def find_script(character: str) -> str:
    """Return the script of a character as an ISO 15924 code; "Zyyy" if several scripts share the character."""
    buffer = harfbuzz.Buffer()
    buffer.add_codepoints([ord(character)])
    buffer.guess_segment_properties()
    return buffer.script or SHARED_SCRIPT


def can_set(face: Typeface, character: str) -> bool:
    """Return whether a typeface has a character and, if letters of its script join, the rules for joining them."""
    if ord(character) not in list_characters(face):
        return False
    script = find_script(character)
    return script not in _JOINING_SCRIPTS or script in list_joined_scripts(face)


@cache
def shipped_typeface(*, bold: bool = False) -> Typeface:
    """Return the shipped typeface DejaVu Sans 2.37: Latin, Greek, Cyrillic, Arabic, Hebrew and many signs."""
    name = "DejaVuSans.ttf"
    if bold:
        name = "DejaVuSans-Bold.ttf"
    return Typeface(str(Path(__file__).parent / "fonts" / name))


class TypefaceSet:
    """Typefaces in the order in which they are searched for a character.

    Args:
        language: the language, which decides how characters shared by Chinese, Japanese and Korean are drawn
        bold: whether the shipped typeface is bold; other typefaces are not
        fonts: the names of font files to search before the shipped typeface; files that are not installed are skipped
        first: a typeface to search before all others
    """

    def __init__(
        self, language: str = "en", *, bold: bool = False, fonts: tuple[str, ...] = (), first: Typeface | None = None
    ) -> None:
        self.language = language
        named = [first, *map(find_installed_typeface, fonts)]
        self._first = (*(face for face in named if face is not None), shipped_typeface(bold=bold))

    def of(self, character: str) -> Typeface | None:
        """Return the first typeface that can draw a character; None if there is none."""
        for face in self._first:
            if can_set(face, character):
                return face
        return next((face for face in _list_installed_typefaces(self.language) if can_set(face, character)), None)

    def missing(self, text: str) -> str:
        """Return the first character of a text that no typeface can draw, blanks excepted; "" if there is none."""
        for character in dict.fromkeys(text):
            if unicodedata.category(character) not in _UNSEEN and self.of(character) is None:
                return character
        return ""


@cache
def select_typefaces(language: str, *, bold: bool = False, fonts: tuple[str, ...] = ()) -> TypefaceSet:
    """Return the typefaces for a language, with the named font files before them."""
    return TypefaceSet(language, bold=bold, fonts=fonts)


def find_installed_typeface(name: str) -> Typeface | None:
    """Return the typeface in an installed font file of a given name; None if there is no such file."""
    path = _find_font_files().get(name)
    if path is None:
        return None
    return Typeface(path)


@cache
def _list_installed_typefaces(language: str) -> tuple[Typeface, ...]:
    """Return the known typefaces on this computer in the order of search; a language can change their order."""
    paths = _find_font_files()
    language = language.lower()
    indices = {_CJK_COLLECTION: _CJK_FACE.get(language, _CJK_FACE["zh"])}
    faces = [Typeface(paths[name], indices.get(name, 0)) for name in (*_NOTO, *_SYSTEM) if name in paths]
    suffix = _CJK_SUFFIX.get(language, "SC")

    def is_for_other_language(name: str) -> bool:
        family = Path(name).stem.removesuffix("-Regular")
        return not family.upper().endswith(suffix)

    other_names = sorted(name for name in paths if _OTHERS.fullmatch(name) and name not in _NOTO)
    other_names.sort(key=is_for_other_language)
    faces += [Typeface(paths[name]) for name in other_names]
    return tuple(faces)


@cache
def _find_font_files() -> dict[str, str]:
    """Return the path of each font file on this machine, by file name; of equal names, the first folder's counts."""
    paths: dict[str, str] = {}
    for folder in _list_font_folders():
        for root, inner_folders, names in os.walk(folder):
            inner_folders.sort()  # if two files have one name, the same one is chosen on every file system
            for name in names:
                if name.endswith((".ttf", ".ttc", ".otf")):
                    paths.setdefault(name, os.path.join(root, name))
    return paths


def user_font_folder() -> Path:
    """Return the folder in which a user can install font files without administrator rights."""
    return next(_list_font_folders())


def _list_font_folders() -> Iterator[Path]:
    """Yield the folders in which this system keeps font files, the user's own folder first."""
    home = Path.home()
    if sys.platform == "darwin":
        yield from (home / "Library/Fonts", Path("/Library/Fonts"), Path("/System/Library/Fonts"))
    elif sys.platform == "win32":
        yield Path(os.environ.get("LOCALAPPDATA", home / "AppData/Local")) / "Microsoft/Windows/Fonts"
        yield Path(os.environ.get("WINDIR", r"C:\Windows")) / "Fonts"
    else:  # the XDG Base Directory Specification
        yield Path(os.environ.get("XDG_DATA_HOME") or home / ".local/share") / "fonts"
        yield home / ".fonts"
        for folder in (os.environ.get("XDG_DATA_DIRS") or "/usr/local/share:/usr/share").split(":"):
            yield Path(folder) / "fonts"
