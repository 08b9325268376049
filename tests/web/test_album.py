"""Pictures that go over the line: numbered for each page, packed once for all of them."""

import zlib

import numpy as np

from minihuman.web import album
from minihuman.web.album import JPEG, ZLIB, Album


def test_what_somebody_else_has_seen_is_not_packed_again(monkeypatch) -> None:
    picture = np.full((16, 16, 3), 201, np.uint8)
    [first] = taken(Album(), picture)
    monkeypatch.setattr(album, "_packed", lambda *_: (_ for _ in ()).throw(AssertionError("packed again")))
    later = Album()
    [second] = taken(later, picture.copy())
    assert second == first
    assert zlib.decompress(second.data) == picture.tobytes()
    assert later.used == {"lossless"}, "the facts say how it went"


def test_each_study_has_its_own_encoding_of_the_same_picture() -> None:
    noise = np.random.default_rng(1).integers(0, 256, (24, 24, 3)).astype(np.uint8)
    [small], [exact] = taken(Album("auto"), noise), taken(Album("lossless"), noise)
    assert (small.encoding, exact.encoding) == (JPEG, ZLIB)
    assert zlib.decompress(exact.data) == noise.tobytes()


def test_what_is_kept_for_everybody_has_a_bound(monkeypatch) -> None:
    monkeypatch.setattr(album, "_SHARED_BYTES", 20_000)
    shared = album._Shared()
    rng = np.random.default_rng(2)
    for number in range(50):
        noise = rng.integers(0, 256, (24, 24, 3)).astype(np.uint8)
        shared.of(bytes([number]), "lossless", noise)
        assert sum(len(packed) for _, packed in shared._kept.values()) == shared._bytes <= 20_000
    assert (bytes([49]), "lossless") in shared._kept, "the latest stay"


def taken(into: Album, picture: np.ndarray) -> list:
    into.number(picture)
    return into.take_new()
