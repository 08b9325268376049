"""Pages: a text cut where a page is full. The page's shape is fixed, so that what was on which page can be shown again.

A page is as high as the window and 4:3; all lengths are shares of its height. The reference is drawn at 900 px.
"""

from minihuman.typeset.faces import Faces
from minihuman.typeset.lines import wrap

REFERENCE_PX = 900  # the height at which lines are broken
TYPE = 1 / 30  # of the height; nothing that must be read is smaller than 1/40
LINE = 1.45  # of the type size
COLUMN = 1.16  # of the height
TEXT_TOP, TEXT_BOTTOM = 0.15, 0.82
PICTURE = 0.40  # of the height, with the gap below, where there is one above the text
_HEADING = 40  # characters of the longest heading
_SHORT = 240  # characters that fit any page, however wide


def lines_on(*, picture: bool) -> int:
    """How many lines a page has."""
    return int((TEXT_BOTTOM - TEXT_TOP - (PICTURE if picture else 0.0)) / (TYPE * LINE) + 1e-9)


def page_lines(text: str, faces: Faces) -> list[str]:
    """The lines of a page's text, as broken at the reference."""
    return wrap(text, faces=faces, size_px=round(REFERENCE_PX * TYPE), wide_px=REFERENCE_PX * COLUMN)


def pages(text: str, faces: Faces, *, pictures: int = 0) -> tuple[str, ...]:
    """Cut a text into pages; the first ``pictures`` of them have a picture above the text. Blank lines begin none."""
    text = text.strip()
    if not pictures and len(text) <= _SHORT and text.count("\n") < 5:
        return (text,)
    lines = _marked_lines(text, faces)
    found: list[str] = []
    while lines:
        room = lines_on(picture=len(found) < pictures)
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


def _marked_lines(text: str, faces: Faces) -> list[str]:
    """Lines that put together are the text: each with the blank or the line break that followed it."""
    found = []
    place = 0
    for line in page_lines(text, faces):
        assert text.startswith(line, place), "a line is a piece of the text"
        end = place + len(line)
        while end < len(text) and text[end].isspace() and text[end] != "\n":
            end += 1
        if end < len(text) and text[end] == "\n":
            end += 1
        found.append(text[place:end])
        place = end
    return found
