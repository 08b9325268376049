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
_BASELINE = 0.36  # the distance of the baseline below the middle of a line's height, in type sizes


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

    Args:
        draw: the drawing context.
        place: the point (x, y) in pixels at the middle of the line's height, at the end that ``anchor`` names.
        text: the line, without line breaks.
        faces: the typefaces to choose from.
        size_px: the size of type in pixels.
        colour: the colour of the type.
        anchor: which point of the line is at ``place``: its left end ("l"), its middle ("m") or its right end ("r").
        rtl: whether the text as a whole runs from right to left; parts in the other direction keep their own.
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
    """Return whether a line can be broken between two characters: after a blank, or if one is Chinese or Japanese.

    Without a blank, it cannot be broken before closing punctuation or after opening punctuation.
    """
    if before.isspace():
        return not after.isspace()
    if after.isspace() or after in _NO_LINE_START or before in _NO_LINE_END:
        return False
    return _is_chinese_or_japanese(before) or _is_chinese_or_japanese(after)


def _is_chinese_or_japanese(character: str) -> bool:
    return bool(_WIDE.match(character)) and not _KOREAN.match(character)


def wrap_text(text: str, *, faces: TypefaceSet, size_px: int, max_width_px: float) -> list[str]:
    """Break a text into lines of at most ``max_width_px`` pixels, keeping the line breaks in the text.

    A word that is longer than a line is broken, too.
    """
    return _break_lines(text, lambda piece: measure_width_px(piece, faces, size_px), max_width_px)


def _break_lines(text: str, measure: Callable[[str], float], max_width_px: float) -> list[str]:
    """Break a text into lines of at most ``max_width_px``; ``measure`` returns the width of a text in pixels.

    Blanks at the end of a line are dropped, and do not count in its width.
    """
    lines: list[str] = []
    for paragraph in text.strip("\n").split("\n"):
        line = ""
        line_px = 0.0
        for token in split_tokens(paragraph):
            for piece in _split_long(token, measure, max_width_px):
                piece_px = measure(piece)
                inked_px = piece_px
                if piece[-1].isspace():
                    inked_px = measure(piece.rstrip())
                if line and line_px + inked_px > max_width_px:
                    lines.append(line.rstrip())
                    line = ""
                    line_px = 0.0
                line += piece
                line_px += piece_px
        lines.append(line.rstrip())
    return lines


def _split_long(token: str, measure: Callable[[str], float], max_width_px: float) -> Iterator[str]:
    """Yield the pieces of a token, each as long as a line permits, but at least one character."""
    while len(token) > 1 and measure(token.rstrip()) > max_width_px:
        cut = next(n for n in range(len(token) - 1, 0, -1) if n == 1 or measure(token[:n]) <= max_width_px)
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
_SHORT_LINE_BREAKS = 5  # fewer line breaks than these fit any page, too
_ROUNDING_ERROR = 1e-9  # of a division of lengths, which must not lose a line


_EMPHASIS = re.compile(r"(?<![\w*])\*(?=[^\s*])((?:[^*\n]|\n(?!\n))*[^\s*])\*(?![\w*])")
_LIST_ITEM = re.compile(r"(?m)^( *)[-*] (?=\S)")
EMPHASIS_MARK = "\ue000"  # a private-use character, which no text contains


def style_lines(lines: list[str]) -> list[str]:
    """Return lines with marks for emphasis (``*word*``), and with a bullet for "- " or "* " at the start of a line.

    In each returned line, every odd `EMPHASIS_MARK` begins emphasis, and the next one ends it: emphasis that goes on in
    the next line is ended and begun again.
    """
    text = _EMPHASIS.sub(rf"{EMPHASIS_MARK}\1{EMPHASIS_MARK}", _LIST_ITEM.sub("\\1\u2022 ", "\n".join(lines)))
    styled = []
    is_emphasised = False  # at the start of the line
    for line in text.split("\n"):
        styled_line = line
        if is_emphasised:
            styled_line = EMPHASIS_MARK + styled_line
        if line.count(EMPHASIS_MARK) % 2 == 1:
            is_emphasised = not is_emphasised
        if is_emphasised:
            styled_line += EMPHASIS_MARK
        styled.append(styled_line)
    return styled


def count_page_lines(*, picture: bool) -> int:
    """Return the number of text lines on a page, with or without a picture."""
    height = TEXT_BOTTOM - TEXT_TOP
    if picture:
        height -= PAGE_PICTURE_HEIGHT
    return int(height / (PAGE_TYPE_SIZE * PAGE_LINE_HEIGHT) + _ROUNDING_ERROR)


def break_page_lines(text: str) -> list[str]:
    """Return the lines of a page's text, broken at the reference size, whatever the typefaces that draw it."""
    return _break_lines(text, measure_reference_px, PAGE_REFERENCE_PX * PAGE_COLUMN_WIDTH)


_REFERENCE_TYPE_PX = round(PAGE_REFERENCE_PX * PAGE_TYPE_SIZE)
_OTHER_ADVANCE = 0.7  # in type sizes: the advance of a narrow character that the shipped typeface lacks


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
            width_64 += _measure_shipped_64(piece)
        else:
            width_64 += sum(map(_get_fallback_advance_64, piece))
    return width_64 / SUBPIXELS


def _measure_shipped_64(text: str) -> int:
    """Return the length of a text in the shipped typeface at the reference size, in 64ths of a pixel."""
    return shape_line(text, select_typefaces("en"), _REFERENCE_TYPE_PX, rtl=is_rtl(text)).width_64


def _get_fallback_advance_64(character: str) -> int:
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
    if not pictures and len(text) <= _SHORT and text.count("\n") < _SHORT_LINE_BREAKS:
        return (text,)
    lines = _break_without_loss(text)
    pages: list[str] = []
    while lines:
        most_lines = count_page_lines(picture=len(pages) < pictures)
        n_lines = _keep_heading_with_text(lines, most_lines)
        pages.append("".join(lines[:n_lines]).strip("\n"))
        lines = lines[n_lines:]
        while lines and not lines[0].strip():
            lines = lines[1:]
    pages += [""] * (pictures - len(pages))
    return tuple(pages) or ("",)


def is_division(pages: Sequence[str], text: str, *, pictures: int = 0) -> bool:
    """Return whether pages contain a whole text in order, with nothing but blanks left out between pages.

    The first ``pictures`` pages have a picture. Only these pages, or the only page, can be without text.
    """
    position = 0  # in the text, after the pages so far
    for number, page in enumerate(pages):
        words = page.strip()
        may_be_empty = number < pictures or len(pages) == 1
        if not words and (page or not may_be_empty):
            return False
        start = text.find(words, position)
        stop = start + len(words)
        blanks_before = blanks_after = ""
        if words:
            blanks_before, _, blanks_after = page.partition(words)
        gap = text[position : max(start, position)]
        if start < 0 or gap.strip() or not gap.endswith(blanks_before) or not text.startswith(blanks_after, stop):
            return False
        position = stop + len(blanks_after)
    return len(pages) >= pictures and not text[position:].strip()


def _keep_heading_with_text(lines: list[str], most_lines: int) -> int:
    """Return how many lines to put on a page of at most ``most_lines``, so that the page does not end with a heading.

    A heading is a short paragraph of one line.
    """
    if len(lines) <= most_lines:
        return most_lines
    last = most_lines  # the number of the last line that is not blank, from 1
    while last > 1 and not lines[last - 1].strip():
        last -= 1
    begins_paragraph = last == 1 or lines[last - 2].endswith("\n")
    ends_paragraph = lines[last - 1].endswith("\n")
    is_heading = begins_paragraph and ends_paragraph and len(lines[last - 1]) < _HEADING
    if is_heading and last > 1:
        return last - 1
    return most_lines


def _break_without_loss(text: str) -> list[str]:
    """Break a text into lines, each with the blanks and the line break after it, so that joined they are the text."""
    lines = []
    start = 0
    for line in break_page_lines(text):
        assert text.startswith(line, start), "a line is a piece of the text"
        end = start + len(line)
        while end < len(text) and text[end].isspace() and text[end] != "\n":
            end += 1
        if end < len(text) and text[end] == "\n":
            end += 1
        lines.append(text[start:end])
        start = end
    return lines
