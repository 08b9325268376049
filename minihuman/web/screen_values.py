"""Screens as plain values for the page, with one function per kind of screen. The page decides how they look. No I/O.

The image cache sends each distinct picture once, packed as small as the page can decode in time.

A screen that every activity may show has a converter here, in `CONVERTERS`, and a function of the same name in
``page/screens.js``. An activity kind's own screen states how the page shows it, or is sent as the picture that a window
would show.
"""

from collections import OrderedDict
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import asdict
from importlib import import_module
from typing import Any, Literal

import numpy as np
import xxhash
from isal import isal_zlib
from numpy.typing import NDArray
from simplejpeg import encode_jpeg

from minihuman.display.drawing.screen import compose_screen
from minihuman.display.drawing.sheet import arrange_keycaps
from minihuman.display.mission_paragraphs import split_mission
from minihuman.experiment.keys import key_label
from minihuman.experiment.machine import screens
from minihuman.web.messages import PictureMessage
from minihuman.web.page_modules import find_module_address
from minihuman.web.screen_types import (
    BlankValues,
    ButtonValues,
    KeyValues,
    PageValues,
    PlayValues,
    QuestionValues,
    ScreenLocale,
    TextValues,
)
from minihuman.worlds.picture_hash import hash_picture
from minihuman.worlds.team import PictureTiles

_WINDOW_PX = (960, 720)  # of a picture that a plug-in draws
PENDING_PICTURE = -1  # the number of a picture that is not drawn yet: see ``_number_film``
NumberPicture = Callable[[NDArray[np.uint8]], int]  # returns a picture's number; the picture is sent before the screen


def convert_screen(screen: screens.Screen, number: NumberPicture) -> dict[str, Any]:
    """Convert a screen to JSON values: its kind, its locale, and the kind's fields.

    Args:
        screen: the screen.
        number: returns a picture's number, by which the values refer to the picture.
    """
    if isinstance(screen, screens.ActivityScreen):
        return _activity(screen, number)
    return dict(CONVERTERS[type(screen)](screen, number))


def _convert_locale(screen: screens.Screen) -> ScreenLocale:
    locale: ScreenLocale = {"language": screen.locale.language, "rtl": screen.locale.rtl}
    if screen.locale.theme != "dark":
        locale["theme"] = "light"
    return locale


def _activity(screen: screens.ActivityScreen, number: NumberPicture) -> dict[str, Any]:
    """Convert an activity kind's own screen; if the kind has no view for pages, convert the screen's picture."""
    view = screen.page_view
    if view is None:
        return dict(_convert_to_picture(screen, number))
    module, _, function = view.values.partition(":")
    values: dict[str, Any] = getattr(import_module(module), function)(screen, number)
    if isinstance(screen, screens.FilmsScreen):  # one picture of each film is sent now; the others follow
        values["films"] = [_number_film(film, screen.shown_step, number) for film in screen.films]
    view_fields = {"kind": "activity", "view": view.name, "module": find_module_address(view.module)}
    return view_fields | {"title": "", "prompt": "", "progress": ""} | dict(_convert_locale(screen)) | values


def select_values(screen: screens.Screen, names: str) -> dict[str, Any]:
    """Return a screen's fields with the given names, which are separated by spaces."""
    return {name: getattr(screen, name) for name in names.split()}


def _text(screen: screens.TextScreen, number: NumberPicture) -> TextValues:
    """Convert a text screen, with the positions and labels of the keys to try."""
    labels = {key: (cap, above) for key, cap, above in screen.labels}
    pressed = dict(screen.keys)
    caps, wide, high = arrange_keycaps([key for key, _ in screen.keys])
    keys: list[KeyValues] = [
        {
            "x": cap.x,
            "y": cap.y,
            "width": cap.width,
            "cap": labels[cap.key][0],
            "above": labels[cap.key][1],
            "pressed": pressed[cap.key],
        }
        for cap in caps
    ]
    return {
        "kind": "text",
        **_convert_locale(screen),
        "title": screen.title,
        "body": screen.body,
        "prompt": screen.prompt,
        "progress": screen.progress,
        "keys": keys,
        "wide": wide,
        "high": high,
        "waits": screen.waits,
    }


def _blank(screen: screens.BlankScreen, number: NumberPicture) -> BlankValues:
    return {"kind": "blank", **_convert_locale(screen), "cross": screen.cross}


def _play(screen: screens.PlayScreen, number: NumberPicture) -> dict[str, Any]:
    """Convert a play screen without its picture."""
    labels = {key: (cap, above) for key, cap, above in screen.labels}
    mission = screen.mission[:1].upper() + screen.mission[1:]
    values: PlayValues = {
        "kind": "play",
        **_convert_locale(screen),  # type: ignore[typeddict-item]  # which has no keys of this screen's
        "progress": screen.progress,
        "episode": screen.episode,
        "step": screen.step,
        "mark": screen.mark,
        "score_text": screen.score_text,
        "controller": screen.controller,
        "controller_text": screen.controller_text,
        "mission": mission,
        "legend": [(*labels.get(key, (key_label(key), "")), action) for key, action in screen.legend],
    }
    if len(paragraphs := split_mission(mission)) > 1:
        values["paragraphs"] = paragraphs
    if screen.accepts_pointer:
        values["pointer"] = True
    if screen.axes:
        values["axes"] = list(screen.axes)
    return {**values, **screen.page_fields}


def _number_film(pictures: Sequence[NDArray[np.uint8]], step: int, number: NumberPicture) -> list[int]:
    """Return the numbers of a film's pictures: `PENDING_PICTURE`, as not drawn yet, for all but that of ``step``.

    After the film's end, its last picture is that of the step.
    """
    current = min(step, len(pictures) - 1)
    numbers = [PENDING_PICTURE] * len(pictures)
    if pictures:
        numbers[current] = number(pictures[current])
    return numbers


def _page(screen: screens.PageScreen, number: NumberPicture) -> PageValues:
    """Convert a page of a text."""
    picture = None
    if screen.picture is not None:
        picture = number(screen.picture)
    return {
        "kind": "page",
        **_convert_locale(screen),
        "title": screen.title,
        "body": screen.body,
        "page": screen.page,
        "prompt": screen.prompt,
        "progress": screen.progress,
        "buttons": _convert_buttons(screen),
        "picture": picture,
        "marks": [(mark.x, mark.y, mark.label) for mark in screen.marks],
    }


def _convert_to_picture(screen: screens.ActivityScreen, number: NumberPicture) -> PageValues:
    """Convert a screen to a page that has only the picture that a window would show."""
    # page 1 of 1, without a title, a text and a prompt
    page = screens.PageScreen("", "", 1, 1, "", picture=compose_screen(screen, _WINDOW_PX), locale=screen.locale)
    return _page(page, number)


def _question(screen: screens.QuestionScreen, number: NumberPicture) -> QuestionValues:
    """Convert a question with its answer so far."""
    return {
        "kind": "question",
        **_convert_locale(screen),
        "title": screen.title,
        "question": screen.question,
        "prompt": screen.prompt,
        "progress": screen.progress,
        "note": screen.note,
        "item": {"form": type(screen.item).__name__, **asdict(screen.item)},
        "buttons": _convert_buttons(screen),
    }


def _convert_buttons(screen: screens.PageScreen | screens.QuestionScreen) -> list[ButtonValues]:
    return [{"name": button.name, "label": button.label, "enabled": button.enabled} for button in screen.buttons]


CONVERTERS: Mapping[type, Callable[[Any, NumberPicture], Mapping[str, Any]]] = {
    screens.TextScreen: _text,
    screens.BlankScreen: _blank,
    screens.PlayScreen: _play,
    screens.PageScreen: _page,
    screens.QuestionScreen: _question,
}


ImageEncoding = Literal["auto", "lossless", "jpeg"]
ZLIB = 0
JPEG = 1
TILED = 2
JPEG_QUALITY = 85
_LEVEL = 1  # of ISA-L's levels 0 to 3; it takes a tenth of the time of zlib's level 1, and packs smaller
_FLAT_RATIO = 0.12  # a picture that packs to a smaller fraction of its bytes has few colours, and is sent losslessly
_SAMPLE_INTERVAL = 8  # the sample that decides whether lossless packing is tried has every eighth row,
_SAMPLE_ROWS = 12  # but only about twelve rows of a tall picture
_SHARED_BYTES = 32 * 2**20  # of packed pictures that are cached for all sessions


class _SharedImages:
    """Caches recently packed pictures for all sessions, since many participants see the same grids."""

    def __init__(self) -> None:
        self._packed: OrderedDict[tuple[bytes, ImageEncoding], tuple[int, bytes]] = OrderedDict()
        self._n_bytes = 0

    def pack(self, digest: bytes, encoding: ImageEncoding, picture: NDArray[np.uint8]) -> tuple[int, bytes]:
        """Return the packing, such as ``JPEG``, and the packed bytes of a picture, from the cache if it has them.

        Args:
            digest: identifies the picture in the cache.
            encoding: the encoding, as for ``ImageCache``.
            picture: the picture, uint8[H, W, 3].
        """
        key = (digest, encoding)
        cached = self._packed.get(key)
        if cached is not None:
            self._packed.move_to_end(key)
            return cached
        packing, packed = _encode_picture(encoding, picture)
        self._packed[key] = (packing, packed)
        self._n_bytes += len(packed)
        while self._n_bytes > _SHARED_BYTES:
            _, (_, dropped) = self._packed.popitem(last=False)
            self._n_bytes -= len(dropped)
        return packing, packed


_SHARED = _SharedImages()


class ImageCache:
    """Numbers pictures, and packs those that the page does not have.

    Args:
        encoding: "lossless", "jpeg" or "auto"; "auto" is lossless if the result is small, as for grids, and JPEG
            otherwise.
    """

    def __init__(self, encoding: ImageEncoding = "auto") -> None:
        self._encoding = encoding
        self.next = 0  # the number of the next new picture
        self._numbers: dict[bytes, int] = {}
        self._new: list[PictureMessage] = []  # not sent yet
        self._tiles: dict[Hashable, int] = {}  # numbers of tiles, by key

    def number(self, picture: NDArray[np.uint8], *, is_tile: bool = False, picture_hash: int = 0) -> int:
        """Return a picture's number; a new picture must be sent before a message refers to it.

        Args:
            picture: the picture, uint8[H, W, 3].
            is_tile: whether the picture is a tile of another one; tiles are packed losslessly.
            picture_hash: the picture's `hash_picture`, if it was computed already; 0 otherwise.
        """
        raw = np.ascontiguousarray(picture)
        digest = (picture_hash or hash_picture(raw)).to_bytes(8, "little") + bytes(str(picture.shape), "ascii")
        if digest not in self._numbers:
            encoding = self._encoding
            if is_tile:
                encoding = "lossless"
            packing, packed = _SHARED.pack(digest, encoding, raw)
            self._add_picture(digest, packing, raw.shape[1], raw.shape[0], packed)
        return self._numbers[digest]

    def number_tiles(self, tiles: PictureTiles) -> int:
        """Return the number of a picture that is made of tiles; only new tiles are packed."""
        new_keys = dict.fromkeys(key for key in tiles.keys if key not in self._tiles)  # each once, in order
        self._tiles |= {key: self.number(tiles.draw(*key), is_tile=True) for key in new_keys}
        tile_numbers = np.array([self._tiles[key] for key in tiles.keys], "<u4").tobytes()
        digest = xxhash.xxh3_128_digest(tile_numbers)  # not the numbers, of which a long session has megabytes
        if digest not in self._numbers:
            n_rows = len(tiles.keys) // tiles.columns
            self._add_picture(digest, TILED, tiles.columns * tiles.tile_px, n_rows * tiles.tile_px, tile_numbers)
        return self._numbers[digest]

    def _add_picture(self, digest: bytes, packing: int, width: int, height: int, packed: bytes) -> None:
        self._new.append(PictureMessage(self.next, packing, width, height, packed))
        self._numbers[digest] = self.next
        self.next += 1

    def forget(self) -> None:
        """Forget all pictures, as the page does, so that a repeated picture is new again."""
        self._numbers.clear()
        self._tiles.clear()

    def take_new(self) -> list[PictureMessage]:
        """Return the pictures that are new since the last call, which the caller must send to the page."""
        new_pictures = self._new
        self._new = []
        return new_pictures


def _encode_picture(encoding: ImageEncoding, picture: NDArray[np.uint8]) -> tuple[int, bytes]:
    """Pack a picture, uint8[H, W, 3]; return the packing, ``ZLIB`` or ``JPEG``, and the packed bytes."""
    if encoding == "lossless" or (encoding == "auto" and _may_be_flat(picture)):
        packed = isal_zlib.compress(picture.data, _LEVEL)
        if encoding == "lossless" or len(packed) < _FLAT_RATIO * picture.nbytes:
            return ZLIB, packed
    return JPEG, encode_jpeg(picture, quality=JPEG_QUALITY, colorsubsampling="420")


def _may_be_flat(picture: NDArray[np.uint8]) -> bool:
    """Return whether a sample of rows suggests that the picture has few colours and packs well."""
    rows = picture[:: max(_SAMPLE_INTERVAL, len(picture) // _SAMPLE_ROWS)]
    packed_rows = isal_zlib.compress(rows.tobytes(), _LEVEL)
    return len(packed_rows) < 2 * _FLAT_RATIO * rows.nbytes  # with a margin, as a sample packs less well
