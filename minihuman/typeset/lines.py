"""Lines: running text broken where it may be, by measured width."""

import re
from collections.abc import Iterator

from minihuman.typeset.faces import Faces
from minihuman.typeset.line import width_px

# what must not begin a line, and what must not end one, in Chinese and Japanese (JIS X 4051, GB/T 15834)
_NOT_FIRST = frozenset(
    "、。，．：；！？）］｝〉》」』】〕〗’”…—ー々ぁぃぅぇぉっゃゅょゎァィゥェォッャュョヮ・%‰℃,.:;!?)]}"
)
_NOT_LAST = frozenset("（［｛〈《「『【〔〖‘“([{$￥")
_WIDE = re.compile(
    "[\u1100-\u11ff\u2e80-\u9fff\uac00-\ud7af\uf900-\ufaff\ufe30-\ufe4f\uff00-\uffef\U00020000-\U0003ffff]"
)
_KOREAN = re.compile("[\u1100-\u11ff\uac00-\ud7af]")


def tokens(paragraph: str) -> Iterator[str]:
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
    if after.isspace() or after in _NOT_FIRST or before in _NOT_LAST:
        return False
    wide = [bool(_WIDE.match(character)) and not _KOREAN.match(character) for character in (before, after)]
    return any(wide)


def wrap(text: str, *, faces: Faces, size_px: int, wide_px: float) -> list[str]:
    """Break text into lines no longer than ``wide_px``; its own line breaks stay. A piece too long is broken."""
    lines: list[str] = []
    for paragraph in text.strip("\n").split("\n"):
        line, length = "", 0.0
        for token in tokens(paragraph):
            for piece in _fitting(token, faces, size_px, wide_px):
                its = width_px(piece, faces, size_px)
                bare = its if not piece[-1].isspace() else width_px(piece.rstrip(), faces, size_px)
                if line and length + bare > wide_px:
                    lines.append(line.rstrip())
                    line, length = "", 0.0
                line += piece
                length += its
        lines.append(line.rstrip())
    return lines


def _fitting(token: str, faces: Faces, size_px: int, wide_px: float) -> Iterator[str]:
    while len(token) > 1 and width_px(token.rstrip(), faces, size_px) > wide_px:
        cut = next(n for n in range(len(token) - 1, 0, -1) if n == 1 or width_px(token[:n], faces, size_px) <= wide_px)
        yield token[:cut]
        token = token[cut:]
    yield token
