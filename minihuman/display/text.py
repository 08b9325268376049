"""Text layout: typefaces for every script, the width of a line, line breaking, and pagination. Knows no screens.

One typeface comes with a dependency, others are used where they are installed. Text is set in either direction. The
shape of a page is fixed, so that what was on which page can be shown again: a page is as high as the window and 4:3,
all lengths are fractions of its height, and the reference is drawn at 900 px.
"""

import os
import re
import sys
import unicodedata
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path

from PIL import ImageDraw, ImageFont, features

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
def list_characters(face: Typeface) -> frozenset[int]:
    """Every character that a face has."""
    from fontTools.ttLib import TTFont

    with TTFont(face.path, fontNumber=face.index, lazy=True) as font:
        return frozenset(font.getBestCmap() or {})


@lru_cache(maxsize=256)
def load_font(face: Typeface, size_px: int) -> ImageFont.FreeTypeFont:
    """A face in a size, shaped by raqm where Pillow has it."""
    engine = ImageFont.Layout.RAQM if features.check("raqm") else ImageFont.Layout.BASIC
    return ImageFont.truetype(face.path, size_px, index=face.index, layout_engine=engine)


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
    found = _files()
    index = _CJK_FACE.get(language.lower(), 2)
    faces = [
        Typeface(found[name], index if name == "NotoSansCJK-Regular.ttc" else 0)
        for name in (*_NOTO, *_SYSTEM)
        if name in found
    ]
    more = sorted(name for name in found if name.startswith("NotoSans") and name.endswith("-Regular.ttf"))
    return tuple(faces + [Typeface(found[name]) for name in more if name not in _NOTO])


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


Colour = tuple[int, int, int]


@dataclass(frozen=True, slots=True)
class TextRun:
    """Characters in a row that one face draws, in the order they are read."""

    text: str
    face: Typeface
    rtl: bool


def is_rtl(text: str) -> bool:
    """Whether the first character with a direction runs from right to left."""
    for character in text:
        direction = unicodedata.bidirectional(character)
        if direction in ("R", "AL"):
            return True
        if direction == "L":
            return False
    return False


@lru_cache(maxsize=4096)
def split_runs(text: str, faces: TypefaceSet) -> tuple[TextRun, ...]:
    """A text cut where the face changes; a face that has all of it draws all of it, so that it is shaped as one.

    Signs and blanks go with what they follow. A character that no face has is drawn as the shipped face's box.
    """
    asked = {character: faces.of(character) for character in dict.fromkeys(text) if not character.isspace()}
    used = set(asked.values())
    if len(used) == 1 and None not in used:
        return (TextRun(text, next(iter(used)) or shipped_typeface(), is_rtl(text)),)
    found: list[TextRun] = []
    for character in text:
        face = asked.get(character)
        if face is None:
            face = found[-1].face if found and character not in asked else shipped_typeface()
        elif found and found[-1].face != face and unicodedata.category(character)[0] in "PSZN":
            face = found[-1].face if ord(character) in list_characters(found[-1].face) else face
        if found and found[-1].face == face:
            found[-1] = TextRun(found[-1].text + character, face, is_rtl(found[-1].text + character))
        else:
            found.append(TextRun(character, face, is_rtl(character)))
    return tuple(found)


@lru_cache(maxsize=16384)
def measure_width_px(text: str, faces: TypefaceSet, size_px: int) -> float:
    """How long a line is."""
    return sum(load_font(run.face, size_px).getlength(run.text) for run in split_runs(text, faces))


def draw_line(
    draw: ImageDraw.ImageDraw,
    place: tuple[float, float],
    text: str,
    *,
    faces: TypefaceSet,
    size_px: int,
    colour: Colour,
    anchor: str = "l",
    rtl: bool = False,
) -> None:
    """Set a line: ``place`` is the middle of its height at the left end ("l"), the middle ("m") or the right end ("r").

    ``rtl`` is the direction of the whole text; parts in the other direction keep theirs.
    """
    if not text:
        return
    pieces = split_runs(text, faces)
    x, y = place
    whole = measure_width_px(text, faces, size_px)
    x -= {"l": 0.0, "m": whole / 2, "r": whole}[anchor]
    baseline = y + size_px * 0.36
    for run in reversed(pieces) if rtl else pieces:
        font = load_font(run.face, size_px)
        direction = {"direction": "rtl" if rtl else "ltr"} if font.layout_engine and len(pieces) == 1 else {}
        draw.text((x, baseline), run.text, fill=colour, font=font, anchor="ls", **direction)  # type: ignore[arg-type]
        x += font.getlength(run.text)


# what must not begin a line, and what must not end one, in Chinese and Japanese (JIS X 4051, GB/T 15834)
_NO_LINE_START = frozenset(
    "、。，．：；！？）］｝〉》」』】〕〗’”…—ー々ぁぃぅぇぉっゃゅょゎァィゥェォッャュョヮ・%‰℃,.:;!?)]}"
)
_NO_LINE_END = frozenset("（［｛〈《「『【〔〖‘“([{$￥")
_WIDE = re.compile(
    "[\u1100-\u11ff\u2e80-\u9fff\uac00-\ud7af\uf900-\ufaff\ufe30-\ufe4f\uff00-\uffef\U00020000-\U0003ffff]"
)
_KOREAN = re.compile("[\u1100-\u11ff\uac00-\ud7af]")


def split_tokens(paragraph: str) -> Iterator[str]:
    """Pieces between which a line may be broken; a blank belongs to the piece before it."""
    piece = ""
    for character in paragraph:
        if piece and _may_break(piece[-1], character):
            yield piece
            piece = ""
        piece += character
    if piece:
        yield piece


def _may_break(before: str, after: str) -> bool:
    if before.isspace():
        return not after.isspace()
    if after.isspace() or after in _NO_LINE_START or before in _NO_LINE_END:
        return False
    wide = [bool(_WIDE.match(character)) and not _KOREAN.match(character) for character in (before, after)]
    return any(wide)


def wrap_text(text: str, *, faces: TypefaceSet, size_px: int, wide_px: float) -> list[str]:
    """Break text into lines no longer than ``wide_px``; its own line breaks stay. A piece too long is broken."""
    lines: list[str] = []
    for paragraph in text.strip("\n").split("\n"):
        line, length = "", 0.0
        for token in split_tokens(paragraph):
            for piece in _fitting(token, faces, size_px, wide_px):
                its = measure_width_px(piece, faces, size_px)
                bare = its if not piece[-1].isspace() else measure_width_px(piece.rstrip(), faces, size_px)
                if line and length + bare > wide_px:
                    lines.append(line.rstrip())
                    line, length = "", 0.0
                line += piece
                length += its
        lines.append(line.rstrip())
    return lines


def _fitting(token: str, faces: TypefaceSet, size_px: int, wide_px: float) -> Iterator[str]:
    while len(token) > 1 and measure_width_px(token.rstrip(), faces, size_px) > wide_px:
        cut = next(
            n for n in range(len(token) - 1, 0, -1) if n == 1 or measure_width_px(token[:n], faces, size_px) <= wide_px
        )
        yield token[:cut]
        token = token[cut:]
    yield token


PAGE_REFERENCE_PX = 900  # the height at which lines are broken
PAGE_TYPE_SIZE = 1 / 30  # of the height; nothing that must be read is smaller than 1/40
PAGE_LINE_HEIGHT = 1.45  # of the type size
PAGE_COLUMN_WIDTH = 1.16  # of the height
TEXT_TOP, TEXT_BOTTOM = 0.15, 0.82
PAGE_PICTURE_HEIGHT = 0.40  # of the height, with the gap below, where there is one above the text
_HEADING = 40  # characters of the longest heading
_SHORT = 240  # characters that fit any page, however wide


_EMPHASIS = re.compile(r"(?<![\w*])\*(?=[^\s*])((?:[^*\n]|\n(?!\n))*[^\s*])\*(?![\w*])")
_LIST_ITEM = re.compile(r"(?m)^( *)[-*] (?=\S)")
EMPHASIS_MARK = "\ue000"  # of a private use: no text has it


def style_lines(lines: list[str]) -> list[str]:
    """Lines as they are set: of ``*so*`` the marks go, and "- " at a line's beginning is a bullet.

    What lies between the first and the second `EMPHASIS_MARK` of a line is emphasised, and so on.
    """
    text = _EMPHASIS.sub(rf"{EMPHASIS_MARK}\1{EMPHASIS_MARK}", _LIST_ITEM.sub("\\1\u2022 ", "\n".join(lines)))
    styled, is_on = [], False
    for line in text.split("\n"):
        begins = EMPHASIS_MARK * is_on
        is_on ^= line.count(EMPHASIS_MARK) % 2 == 1
        styled.append(f"{begins}{line}{EMPHASIS_MARK * is_on}")
    return styled


def count_page_lines(*, picture: bool) -> int:
    """How many lines a page has."""
    return int(
        (TEXT_BOTTOM - TEXT_TOP - (PAGE_PICTURE_HEIGHT if picture else 0.0)) / (PAGE_TYPE_SIZE * PAGE_LINE_HEIGHT)
        + 1e-9
    )


def break_page_lines(text: str, faces: TypefaceSet) -> list[str]:
    """The lines of a page's text, as broken at the reference."""
    return wrap_text(
        text,
        faces=faces,
        size_px=round(PAGE_REFERENCE_PX * PAGE_TYPE_SIZE),
        wide_px=PAGE_REFERENCE_PX * PAGE_COLUMN_WIDTH,
    )


def paginate_text(text: str, faces: TypefaceSet, *, pictures: int = 0) -> tuple[str, ...]:
    """Cut a text into pages; the first ``pictures`` of them have a picture above the text. Blank lines begin none."""
    text = text.strip()
    if not pictures and len(text) <= _SHORT and text.count("\n") < 5:
        return (text,)
    lines = _marked_lines(text, faces)
    found: list[str] = []
    while lines:
        room = count_page_lines(picture=len(found) < pictures)
        room = _without_heading(lines, room)
        page, lines = lines[:room], lines[room:]
        found.append("".join(page).strip("\n"))
        while lines and not lines[0].strip():
            lines = lines[1:]
    found += [""] * (pictures - len(found))
    return tuple(found) or ("",)


def _without_heading(lines: list[str], room: int) -> int:
    """How many lines to put on a page: a heading, a paragraph of one line, does not stand alone at its end."""
    if len(lines) <= room:
        return room
    last = room
    while last > 1 and not lines[last - 1].strip():
        last -= 1
    alone = last == 1 or lines[last - 2].endswith("\n")
    follows = lines[last - 1].endswith("\n") and len(lines[last - 1]) < _HEADING
    return last - 1 if alone and follows and last > 1 else room


def _marked_lines(text: str, faces: TypefaceSet) -> list[str]:
    """Lines that put together are the text: each with the blank or the line break that followed it."""
    found = []
    place = 0
    for line in break_page_lines(text, faces):
        assert text.startswith(line, place), "a line is a piece of the text"
        end = place + len(line)
        while end < len(text) and text[end].isspace() and text[end] != "\n":
            end += 1
        if end < len(text) and text[end] == "\n":
            end += 1
        found.append(text[place:end])
        place = end
    return found
