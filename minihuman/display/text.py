"""Text layout: drawing a line of text, line breaking, and pagination.

A page has a fixed shape, so that the content of each page can be shown again later: it is as high as the window and
4:3, and all lengths are fractions of its height. Line breaks are computed for a reference of 900 px, in the shipped
typeface, so that a text has the same pages on every machine.
"""

import re
import unicodedata
from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from itertools import groupby

from PIL import ImageDraw

from minihuman.display.glyphs import draw_shaped
from minihuman.display.shaping import SUBPIXELS, is_rtl, measure_width_px, shape_line
from minihuman.display.typefaces import TypefaceSet, list_characters, select_typefaces, shipped_typeface

Colour = tuple[int, int, int]
_BASELINE = 0.36  # of the type size, below the middle of a line's height


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
    """Draw a line of text.

    ``place`` is the middle of the line's height at its left end ("l"), its middle ("m") or its right end ("r"). ``rtl``
    is the direction of the whole text; parts in the other direction keep their own.
    """
    line = shape_line(text, faces, size_px, rtl=rtl)
    x, y = place
    x -= {"l": 0.0, "m": line.width_px / 2, "r": line.width_px}[anchor]
    draw_shaped(draw, (x, y + size_px * _BASELINE), line, size_px, colour)


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
    """Yield the pieces of a paragraph between which a line can be broken; a blank belongs to the piece before it."""
    piece = ""
    for character in paragraph:
        if piece and _may_break(piece[-1], character):
            yield piece
            piece = ""
        piece += character
    if piece:
        yield piece


def _may_break(before: str, after: str) -> bool:
    """Return whether a line can be broken between two characters: at blanks, and around Chinese and Japanese."""
    if before.isspace():
        return not after.isspace()
    if after.isspace() or after in _NO_LINE_START or before in _NO_LINE_END:
        return False
    wide = [bool(_WIDE.match(character)) and not _KOREAN.match(character) for character in (before, after)]
    return any(wide)


def wrap_text(text: str, *, faces: TypefaceSet, size_px: int, wide_px: float) -> list[str]:
    """Break a text into lines of at most ``wide_px`` pixels, keeping its own line breaks.

    A piece that is longer than a line is broken, too.
    """
    return _break_lines(text, lambda piece: measure_width_px(piece, faces, size_px), wide_px)


def _break_lines(text: str, measure: Callable[[str], float], wide_px: float) -> list[str]:
    lines: list[str] = []
    for paragraph in text.strip("\n").split("\n"):
        line = ""
        length = 0.0
        for token in split_tokens(paragraph):
            for piece in _split_long(token, measure, wide_px):
                piece_px = measure(piece)
                inked_px = piece_px
                if piece[-1].isspace():
                    inked_px = measure(piece.rstrip())
                if line and length + inked_px > wide_px:
                    lines.append(line.rstrip())
                    line = ""
                    length = 0.0
                line += piece
                length += piece_px
        lines.append(line.rstrip())
    return lines


def _split_long(token: str, measure: Callable[[str], float], wide_px: float) -> Iterator[str]:
    """Yield the pieces of a token, of which none but a single character is longer than a line."""
    while len(token) > 1 and measure(token.rstrip()) > wide_px:
        cut = next(n for n in range(len(token) - 1, 0, -1) if n == 1 or measure(token[:n]) <= wide_px)
        yield token[:cut]
        token = token[cut:]
    yield token


PAGINATION_RULES = 1  # the version of the rules that divide a text into pages, which a plan records
PAGE_REFERENCE_PX = 900  # the height at which lines are broken
PAGE_TYPE_SIZE = 1 / 30  # of the height; nothing that must be read is smaller than 1/40
PAGE_LINE_HEIGHT = 1.45  # of the type size
PAGE_COLUMN_WIDTH = 1.16  # of the height
TEXT_TOP = 0.15
TEXT_BOTTOM = 0.82
PAGE_PICTURE_HEIGHT = 0.40  # of the height, with the gap below, where there is one above the text
_HEADING = 40  # characters of the longest heading
_SHORT = 240  # characters that fit any page, however wide


_EMPHASIS = re.compile(r"(?<![\w*])\*(?=[^\s*])((?:[^*\n]|\n(?!\n))*[^\s*])\*(?![\w*])")
_LIST_ITEM = re.compile(r"(?m)^( *)[-*] (?=\S)")
EMPHASIS_MARK = "\ue000"  # of a private use: no text has it


def style_lines(lines: list[str]) -> list[str]:
    """Return lines with the markup of emphasis (``*word*``) replaced and with a bullet for "- " at the start of a line.

    In each line, `EMPHASIS_MARK` begins and ends emphasis in turn.
    """
    text = _EMPHASIS.sub(rf"{EMPHASIS_MARK}\1{EMPHASIS_MARK}", _LIST_ITEM.sub("\\1\u2022 ", "\n".join(lines)))
    styled = []
    is_on = False
    for line in text.split("\n"):
        begins = EMPHASIS_MARK * is_on
        is_on ^= line.count(EMPHASIS_MARK) % 2 == 1
        styled.append(f"{begins}{line}{EMPHASIS_MARK * is_on}")
    return styled


def count_page_lines(*, picture: bool) -> int:
    """Return the number of text lines on a page, with or without a picture."""
    height = TEXT_BOTTOM - TEXT_TOP
    if picture:
        height -= PAGE_PICTURE_HEIGHT
    return int(height / (PAGE_TYPE_SIZE * PAGE_LINE_HEIGHT) + 1e-9)


def break_page_lines(text: str) -> list[str]:
    """Break a page's text into lines at the reference size, independently of the typefaces that draw it."""
    return _break_lines(text, measure_reference_px, PAGE_REFERENCE_PX * PAGE_COLUMN_WIDTH)


_REFERENCE_TYPE_PX = round(PAGE_REFERENCE_PX * PAGE_TYPE_SIZE)
_OTHER_ADVANCE = 0.7  # of the type size: of a character that the shipped face lacks and that is not wide


@lru_cache(maxsize=16384)
def measure_reference_px(text: str) -> float:
    """Return the length of a line in pixels at the reference size, in the shipped typeface.

    Characters that the typeface lacks have a fixed width: 1 em for Chinese, Japanese and Korean, 0 for combining marks,
    and 0.7 em for others, which is more than most need.
    """
    shipped_characters = list_characters(shipped_typeface())
    width_64 = 0
    for is_shipped, members in groupby(
        text, lambda character: ord(character) in shipped_characters or character.isspace()
    ):
        piece = "".join(members)
        if is_shipped:
            width_64 += _measure_shipped(piece)
        else:
            width_64 += sum(map(_advance_of_other, piece))
    return width_64 / SUBPIXELS


def _measure_shipped(text: str) -> int:
    return shape_line(text, select_typefaces("en"), _REFERENCE_TYPE_PX, rtl=is_rtl(text)).width_64


def _advance_of_other(character: str) -> int:
    """Return the fixed advance of a character that the shipped typeface lacks, in 64ths of a pixel."""
    if unicodedata.category(character) in ("Mn", "Me", "Cf"):
        return 0
    share = _OTHER_ADVANCE
    if _WIDE.match(character):
        share = 1.0
    return round(_REFERENCE_TYPE_PX * share * SUBPIXELS)


def paginate_text(text: str, *, pictures: int = 0) -> tuple[str, ...]:
    """Divide a text into pages, the first ``pictures`` of which have a picture above the text.

    Blank lines at the start of a page are dropped.
    """
    text = text.strip()
    if not pictures and len(text) <= _SHORT and text.count("\n") < 5:
        return (text,)
    lines = _marked_lines(text)
    pages: list[str] = []
    while lines:
        room = count_page_lines(picture=len(pages) < pictures)
        room = _without_heading(lines, room)
        page = lines[:room]
        lines = lines[room:]
        pages.append("".join(page).strip("\n"))
        while lines and not lines[0].strip():
            lines = lines[1:]
    pages += [""] * (pictures - len(pages))
    return tuple(pages) or ("",)


def is_division(pages: Sequence[str], text: str, *, pictures: int = 0) -> bool:
    """Return whether pages are a complete division of a text in order, with nothing but blanks left out.

    Only pages with a picture, or the only page, can be without text.
    """
    place = 0
    for number, page in enumerate(pages):
        words = page.strip()
        if not words and (page or not (number < pictures or len(pages) == 1)):
            return False
        start = text.find(words, place)
        stop = start + len(words)
        before = after = ""
        if words:
            before, _, after = page.partition(words)
        gap = text[place : max(start, place)]
        if start < 0 or gap.strip() or not gap.endswith(before) or not text.startswith(after, stop):
            return False
        place = stop + len(after)
    return len(pages) >= pictures and not text[place:].strip()


def _without_heading(lines: list[str], room: int) -> int:
    """Return how many lines to put on a page so that no heading, a one-line paragraph, stands alone at its end."""
    if len(lines) <= room:
        return room
    last = room
    while last > 1 and not lines[last - 1].strip():
        last -= 1
    is_single_line = last == 1 or lines[last - 2].endswith("\n")
    follows = lines[last - 1].endswith("\n") and len(lines[last - 1]) < _HEADING
    if is_single_line and follows and last > 1:
        return last - 1
    return room


def _marked_lines(text: str) -> list[str]:
    """Break a text into lines that include the blank or line break after them; joined, they are the text."""
    marked_lines = []
    place = 0
    for line in break_page_lines(text):
        assert text.startswith(line, place), "a line is a piece of the text"
        end = place + len(line)
        while end < len(text) and text[end].isspace() and text[end] != "\n":
            end += 1
        if end < len(text) and text[end] == "\n":
            end += 1
        marked_lines.append(text[place:end])
        place = end
    return marked_lines
