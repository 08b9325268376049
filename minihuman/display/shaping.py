"""Shaping of a line of text: the glyphs of each typeface and their positions, in both directions of writing.

HarfBuzz chooses and places glyphs, and python-bidi finds the direction of each character. Both come with the package
and are given the language, so a line does not depend on the machine's libraries or locale.
"""

import re
import unicodedata
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import groupby

import bidi
import uharfbuzz as harfbuzz

from minihuman.display.typefaces import (
    SHARED_SCRIPT,
    Typeface,
    TypefaceSet,
    can_set,
    find_script,
    open_face,
    shipped_typeface,
)

SUBPIXELS = 64  # of a pixel: the unit of FreeType's and HarfBuzz's positions
_FIRST_RTL = 0x590  # the first code point that can run from right to left, or that sets a direction
_LEVELS_HEADING = "\n    levels: [\n"  # a line break inside the text itself is escaped
_LEVEL = re.compile(r"Level\(\s*(\d+)")
_LINE_END = re.compile(r"[\s\u202a-\u202e\u2066-\u2069]+\Z")
_SURROGATE = re.compile("[\ud800-\udfff]")
_FOLLOWS = frozenset("PSZNM")  # Unicode categories of characters that keep the typeface before them: all but letters


@dataclass(frozen=True, slots=True)
class PlacedGlyph:
    """A glyph, by its index in a typeface, and its origin.

    The origin is given in 64ths of a pixel, to the right and up from the left end of the line's baseline.
    """

    face: Typeface
    glyph: int
    x_64: int
    y_64: int


@dataclass(frozen=True, slots=True, eq=False)  # equal if the same: comparing glyphs would cost more than shaping
class ShapedLine:
    """The glyphs of a line in visual order, from left to right."""

    glyphs: tuple[PlacedGlyph, ...]
    width_64: int

    @property
    def width_px(self) -> float:
        """The line's length in pixels."""
        return self.width_64 / SUBPIXELS


@dataclass(frozen=True, slots=True)
class _Run:
    """Neighbouring characters with the same typeface, script and embedding level; odd levels run from right to left."""

    start: int
    stop: int
    face: Typeface
    script: str
    level: int


def is_rtl(text: str) -> bool:
    """Return whether the first character of a text that has a direction runs from right to left."""
    return not _is_plainly_ltr(text) and bool(bidi.get_base_level(_without_surrogates(text)))


def _is_plainly_ltr(text: str) -> bool:
    """Return whether a text is surely from left to right alone, so that the Bidirectional Algorithm is not needed."""
    return all(ord(character) < _FIRST_RTL for character in text)


def _without_surrogates(text: str) -> str:
    """Return a text with U+FFFD for each lone surrogate, which a web page can send but UTF-8 cannot encode."""
    return _SURROGATE.sub("\ufffd", text)


@lru_cache(maxsize=16384)
def shape_line(text: str, faces: TypefaceSet, size_px: int, *, rtl: bool) -> ShapedLine:
    """Return the glyphs of a line of text and their positions.

    Args:
        text: the line, without line breaks.
        faces: the typefaces to choose from.
        size_px: the size of type in pixels.
        rtl: whether the text as a whole runs from right to left; parts in the other direction keep their own.
    """
    codepoints = [ord(character) for character in text]
    glyphs: list[PlacedGlyph] = []
    x_64 = 0
    for run in _order_runs(_split_runs(text, faces, rtl=rtl)):
        buffer = _shape_run(codepoints, run, size_px, faces.language)
        for info, position in zip(buffer.glyph_infos, buffer.glyph_positions, strict=True):
            glyphs.append(PlacedGlyph(run.face, info.codepoint, x_64 + position.x_offset, position.y_offset))
            x_64 += position.x_advance
    return ShapedLine(tuple(glyphs), x_64)


@lru_cache(maxsize=16384)
def measure_width_px(text: str, faces: TypefaceSet, size_px: int) -> float:
    """Return the length in pixels of a line of text at a size of type."""
    return shape_line(text, faces, size_px, rtl=is_rtl(text)).width_px


def _shape_run(codepoints: list[int], run: _Run, size_px: int, language: str) -> harfbuzz.Buffer:
    """Return HarfBuzz's buffer with the glyphs of a run.

    HarfBuzz gets the ``codepoints`` of the whole line, so that letters at the run's ends join with their neighbours.
    """
    buffer = harfbuzz.Buffer()
    buffer.add_codepoints(codepoints, run.start, run.stop - run.start)
    buffer.direction = "ltr"
    if run.level % 2:
        buffer.direction = "rtl"
    buffer.script = run.script
    buffer.language = language
    harfbuzz.shape(_load_font(run.face, size_px), buffer)
    return buffer


@lru_cache(maxsize=256)
def _load_font(face: Typeface, size_px: int) -> harfbuzz.Font:
    """Open a typeface at a size; advances are not rounded to pixels, so that widths grow in proportion to the size."""
    font = harfbuzz.Font(open_face(face))
    font.scale = (size_px * SUBPIXELS, size_px * SUBPIXELS)
    font.ppem = (size_px, size_px)
    return font


def _split_runs(text: str, faces: TypefaceSet, *, rtl: bool) -> Iterator[_Run]:
    """Yield the runs of a text in the order of its characters."""
    attributes = zip(select_faces(text, faces), _resolve_scripts(text), _find_levels(text, rtl=rtl), strict=True)
    start = 0
    for (face, script, level), members in groupby(attributes):
        stop = start + sum(1 for _ in members)
        yield _Run(start, stop, face, script, level)
        start = stop


def select_faces(text: str, faces: TypefaceSet) -> list[Typeface]:
    """Return the typeface of each character.

    If one typeface is preferred for all characters of a text, it draws the blanks, too, so that the text is one run.
    Otherwise, signs, blanks and marks take the typeface of the character before them. A character that is in no
    typeface is drawn as the shipped typeface's box.
    """
    preferred = {character: faces.of(character) for character in dict.fromkeys(text) if not character.isspace()}
    used = set(preferred.values())
    if len(used) == 1 and (face := used.pop()) is not None:
        return [face] * len(text)
    chosen: list[Typeface] = []
    for character in text:
        face = preferred.get(character)
        if chosen and (character not in preferred or _can_follow(character, face, chosen[-1])):
            face = chosen[-1]
        chosen.append(face or shipped_typeface())
    return chosen


def _can_follow(character: str, face: Typeface | None, before: Typeface) -> bool:
    """Return whether a sign, number or mark is drawn in the typeface of the character before it.

    That typeface, ``before``, must have the character. It takes precedence over the character's preferred typeface
    ``face``, which is None if no typeface has the character; the result is False then.
    """
    follows = face is not None and unicodedata.category(character)[0] in _FOLLOWS
    return follows and can_set(before, character)


def _resolve_scripts(text: str) -> list[str]:
    """Return the script of each character.

    Characters that several scripts share take the script of the text before them or, at the beginning, the first that
    follows.
    """
    scripts = [find_script(character) for character in text]
    current = next((script for script in scripts if script != SHARED_SCRIPT), SHARED_SCRIPT)
    for index, script in enumerate(scripts):
        if script != SHARED_SCRIPT:
            current = script
        scripts[index] = current
    return scripts


def _find_levels(text: str, *, rtl: bool) -> Sequence[int]:
    """Return each character's embedding level by the Unicode Bidirectional Algorithm (UAX #9), with rule L1."""
    if not rtl and _is_plainly_ltr(text):
        return [0] * len(text)
    return _apply_line_end_rule(text, _query_levels(_without_surrogates(text), rtl=rtl), base=int(rtl))


def _query_levels(text: str, *, rtl: bool) -> list[int]:
    """Return each character's embedding level, as python-bidi computes it.

    The library reports levels only in its debugging output, with one level per byte of UTF-8.

    Raises:
        RuntimeError: if the output has another form, as in another release of the library.
    """
    base_direction = "L"
    if rtl:
        base_direction = "R"
    report = str(bidi.get_display(text, base_dir=base_direction, debug=True))
    levels = [int(level) for level in _LEVEL.findall(report.partition(_LEVELS_HEADING)[2].partition("\n    ]")[0])]
    lengths = [len(character.encode()) for character in text]
    if len(levels) != sum(lengths):
        raise RuntimeError(
            f"python-bidi reports {len(levels)} levels for {sum(lengths)} bytes; install another release"
        )
    starts = [sum(lengths[:index]) for index in range(len(text))]  # each character's first byte
    return [levels[start] for start in starts]


def _apply_line_end_rule(text: str, levels: list[int], *, base: int) -> list[int]:
    """Return levels in which blanks and directional marks at a line's end have the text's level ``base`` (rule L1)."""
    trailing = _LINE_END.search(text)
    if trailing is None:
        return levels
    n_trailing = len(trailing[0])
    return [*levels[: len(levels) - n_trailing], *[base] * n_trailing]


def _order_runs(runs: Iterator[_Run]) -> list[_Run]:
    """Return the runs of a line in visual order, from left to right (rule L2 of UAX #9)."""
    ordered = list(runs)
    highest = max((run.level for run in ordered), default=0)
    for level in range(highest, 0, -1):
        ordered = _reverse_runs(ordered, level)
    return ordered


def _reverse_runs(runs: list[_Run], level: int) -> list[_Run]:
    """Return runs with each sequence of neighbours whose level is at least ``level`` reversed."""
    reversed_runs: list[_Run] = []
    for is_reversed, members in groupby(runs, lambda run: run.level >= level):
        sequence = list(members)
        if is_reversed:
            sequence.reverse()
        reversed_runs += sequence
    return reversed_runs
