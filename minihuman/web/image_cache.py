"""The image cache: each picture is sent once, by its content, packed as small as can be decoded in time. No I/O."""

from collections import OrderedDict
from typing import Literal

import numpy as np
import xxhash
from isal import isal_zlib
from numpy.typing import NDArray
from simplejpeg import encode_jpeg

from minihuman.web.messages import PictureMessage

ImageEncoding = Literal["auto", "lossless", "jpeg"]
ZLIB, JPEG = 0, 1
JPEG_QUALITY = 85
_LEVEL = 1  # of ISA-L's four: a tenth of zlib's time at its first, and smaller
_FLAT = 0.12  # of its bytes: what zlib makes smaller than this is drawn of few colours, and stays exact
_EVERY = 8  # rows; a picture is judged by these first,
_ROWS = 12  # or by so many of a tall one
_SHARED_BYTES = 32 * 2**20  # of packed pictures that are kept for everybody


class _SharedImages:
    """Packed pictures by what they show, the latest: in grids many people see the same ones."""

    def __init__(self) -> None:
        self._kept: OrderedDict[tuple[bytes, ImageEncoding], tuple[int, bytes]] = OrderedDict()
        self._bytes = 0

    def of(self, digest: bytes, encoding: ImageEncoding, picture: NDArray[np.uint8]) -> tuple[int, bytes]:
        """A picture's packing and its bytes."""
        known = self._kept.get((digest, encoding))
        if known is not None:
            self._kept.move_to_end((digest, encoding))
            return known
        packed = self._kept[digest, encoding] = _encode_picture(encoding, picture)
        self._bytes += len(packed[1])
        while self._bytes > _SHARED_BYTES:
            self._bytes -= len(self._kept.popitem(last=False)[1][1])
        return packed


_SHARED = _SharedImages()


class ImageCache:
    """Numbers pictures, and packs those that the page does not have.

    Args:
        encoding: "lossless", "jpeg", or "auto": exact where that is small, as for a grid, else JPEG.
    """

    def __init__(self, encoding: ImageEncoding = "auto") -> None:
        self._encoding = encoding
        self.next = 0  # the number of the next one
        self._numbers: dict[bytes, int] = {}
        self._packed: dict[int, PictureMessage] = {}  # not sent yet
        self.used: set[str] = set()  # how they were packed

    def number(self, picture: NDArray[np.uint8]) -> int:
        """A picture's number, uint8[H, W, 3]; a new one is to be sent before it is named."""
        raw = np.ascontiguousarray(picture)
        digest = xxhash.xxh3_128_digest(raw.data) + bytes(str(picture.shape), "ascii")
        known = self._numbers.get(digest)
        if known is None:
            known = self._numbers[digest] = self.next
            self.next += 1
            packing, packed = _SHARED.of(digest, self._encoding, raw)
            self.used.add("lossless" if packing == ZLIB else f"JPEG {JPEG_QUALITY}")
            self._packed[known] = PictureMessage(known, packing, raw.shape[1], raw.shape[0], packed)
        return known

    def forget(self) -> None:
        """The page lets go of what it has: a picture that comes again is a new one."""
        self._numbers.clear()

    def take_new(self) -> list[PictureMessage]:
        """What is to be sent."""
        new, self._packed = list(self._packed.values()), {}
        return new


def _encode_picture(encoding: ImageEncoding, picture: NDArray[np.uint8]) -> tuple[int, bytes]:
    if encoding == "lossless" or (encoding == "auto" and _may_be_flat(picture)):
        packed = isal_zlib.compress(picture.data, _LEVEL)
        if encoding == "lossless" or len(packed) < _FLAT * picture.nbytes:
            return ZLIB, packed
    return JPEG, encode_jpeg(picture, quality=JPEG_QUALITY, colorsubsampling="420")


def _may_be_flat(picture: NDArray[np.uint8]) -> bool:
    """Whether it is worth packing all of it to find out; what is drawn of many colours shows in some rows."""
    rows = picture[:: max(_EVERY, len(picture) // _ROWS)]
    return len(isal_zlib.compress(rows.tobytes(), _LEVEL)) < 2 * _FLAT * rows.nbytes
