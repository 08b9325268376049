"""Pictures that go over the line: numbered for each page, packed once for all of them."""

import zlib

import numpy as np

from minihuman.web import screen_values
from minihuman.web.screen_values import JPEG, ZLIB, ImageCache


def test_what_somebody_else_has_seen_is_not_packed_again(monkeypatch) -> None:
    picture = np.full((16, 16, 3), 201, np.uint8)
    [first] = taken(ImageCache(), picture)
    monkeypatch.setattr(
        screen_values, "_encode_picture", lambda *_: (_ for _ in ()).throw(AssertionError("packed again"))
    )
    later = ImageCache()
    [second] = taken(later, picture.copy())
    assert second == first
    assert zlib.decompress(second.data) == picture.tobytes()
    assert second.encoding == ZLIB


def test_each_study_has_its_own_encoding_of_the_same_picture() -> None:
    noise = np.random.default_rng(1).integers(0, 256, (24, 24, 3)).astype(np.uint8)
    [small], [exact] = taken(ImageCache("auto"), noise), taken(ImageCache("lossless"), noise)
    assert (small.encoding, exact.encoding) == (JPEG, ZLIB)
    assert zlib.decompress(exact.data) == noise.tobytes()


def test_what_is_kept_for_everybody_has_a_bound(monkeypatch) -> None:
    monkeypatch.setattr(screen_values, "_SHARED_BYTES", 20_000)
    shared = screen_values._SharedImages()
    rng = np.random.default_rng(2)
    for number in range(50):
        noise = rng.integers(0, 256, (24, 24, 3)).astype(np.uint8)
        shared.of(bytes([number]), "lossless", noise)
        assert sum(len(packed) for _, packed in shared._kept.values()) == shared._bytes <= 20_000
    assert (bytes([49]), "lossless") in shared._kept, "the latest stay"


def taken(into: ImageCache, picture: np.ndarray) -> list:
    into.number(picture)
    return into.take_new()
