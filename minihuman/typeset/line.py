"""A line of text: which face draws which of it, how wide it is, and set onto a picture, in either direction."""

import unicodedata
from dataclasses import dataclass
from functools import lru_cache

from PIL import ImageDraw

from minihuman.typeset.faces import Face, Faces, loaded, shipped

Colour = tuple[int, int, int]


@dataclass(frozen=True, slots=True)
class Run:
    """Characters in a row that one face draws, in the order they are read."""

    text: str
    face: Face
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
def runs(text: str, faces: Faces) -> tuple[Run, ...]:
    """A text cut where the face changes; a face that has all of it draws all of it, so that it is shaped as one.

    Signs and blanks go with what they follow. A character that no face has is drawn as the shipped face's box.
    """
    asked = {character: faces.of(character) for character in dict.fromkeys(text) if not character.isspace()}
    used = set(asked.values())
    if len(used) == 1 and None not in used:
        return (Run(text, next(iter(used)) or shipped(), is_rtl(text)),)
    found: list[Run] = []
    for character in text:
        face = asked.get(character)
        if face is None:
            face = found[-1].face if found and character not in asked else shipped()
        elif found and found[-1].face != face and _is_sign(character):
            face = found[-1].face if faces.of(character) and _has(found[-1].face, character) else face
        if found and found[-1].face == face:
            found[-1] = Run(found[-1].text + character, face, is_rtl(found[-1].text + character))
        else:
            found.append(Run(character, face, is_rtl(character)))
    return tuple(found)


def _is_sign(character: str) -> bool:
    return unicodedata.category(character)[0] in "PSZN"


def _has(face: Face, character: str) -> bool:
    from minihuman.typeset.faces import characters

    return ord(character) in characters(face)


@lru_cache(maxsize=16384)
def width_px(text: str, faces: Faces, size_px: int) -> float:
    """How long a line is."""
    return sum(loaded(run.face, size_px).getlength(run.text) for run in runs(text, faces))


def draw_line(
    draw: ImageDraw.ImageDraw,
    place: tuple[float, float],
    text: str,
    *,
    faces: Faces,
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
    pieces = runs(text, faces)
    x, y = place
    whole = width_px(text, faces, size_px)
    x -= {"l": 0.0, "m": whole / 2, "r": whole}[anchor]
    baseline = y + size_px * 0.36
    for run in reversed(pieces) if rtl else pieces:
        font = loaded(run.face, size_px)
        direction = {"direction": "rtl" if rtl else "ltr"} if font.layout_engine and len(pieces) == 1 else {}
        draw.text((x, baseline), run.text, fill=colour, font=font, anchor="ls", **direction)  # type: ignore[arg-type]
        x += font.getlength(run.text)
