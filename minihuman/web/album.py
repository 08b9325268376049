"""Pictures as they go over the line: each one once, by its content, packed as small as it can be shown soon. No I/O."""

import hashlib
import io
import zlib
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from minihuman.web.wire import Picture

Encoding = Literal["auto", "lossless", "jpeg"]
ZLIB, JPEG = 0, 1
JPEG_QUALITY = 85
_FLAT = 0.12  # of its bytes: what zlib makes smaller than this is drawn of few colours, and stays exact
_EVERY = 8  # rows; a picture is judged by these first


class Album:
    """Numbers pictures, and packs those that the page does not have.

    Args:
        encoding: "lossless", "jpeg", or "auto": exact where that is small, as for a grid, else JPEG.
    """

    def __init__(self, encoding: Encoding = "auto") -> None:
        self._encoding = encoding
        self.next = 0  # the number of the next one
        self._numbers: dict[bytes, int] = {}
        self._packed: dict[int, Picture] = {}  # not sent yet
        self.used: set[str] = set()  # how they were packed

    def number(self, picture: NDArray[np.uint8]) -> int:
        """A picture's number, uint8[H, W, 3]; a new one is to be sent before it is named."""
        raw = np.ascontiguousarray(picture)
        digest = hashlib.sha1(raw.data, usedforsecurity=False).digest() + bytes(str(picture.shape), "ascii")
        known = self._numbers.get(digest)
        if known is None:
            known = self._numbers[digest] = self.next
            self.next += 1
            self._packed[known] = self._pack(known, raw)
        return known

    def forget(self) -> None:
        """The page lets go of what it has: a picture that comes again is a new one."""
        self._numbers.clear()

    def take_new(self) -> list[Picture]:
        """What is to be sent."""
        new, self._packed = list(self._packed.values()), {}
        return new

    def _pack(self, number: int, picture: NDArray[np.uint8]) -> Picture:
        height, width = picture.shape[:2]
        if self._encoding == "lossless" or (self._encoding == "auto" and _may_be_flat(picture)):
            packed = zlib.compress(picture.data, 1)
            if self._encoding == "lossless" or len(packed) < _FLAT * picture.nbytes:
                self.used.add("lossless")
                return Picture(number, ZLIB, width, height, packed)
        out = io.BytesIO()
        Image.fromarray(picture).save(out, "JPEG", quality=JPEG_QUALITY)
        self.used.add(f"JPEG {JPEG_QUALITY}")
        return Picture(number, JPEG, width, height, out.getvalue())


def _may_be_flat(picture: NDArray[np.uint8]) -> bool:
    """Whether it is worth packing all of it to find out; what is drawn of many colours shows in some rows."""
    rows = picture[::_EVERY]
    return len(zlib.compress(rows.tobytes(), 1)) < 2 * _FLAT * rows.nbytes
