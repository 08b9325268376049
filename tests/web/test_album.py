"""Pictures that go over the line: numbered for each page, packed once for all of them."""

import zlib

import numpy as np

from minihuman.web import screen_values
from minihuman.web.screen_values import JPEG, TILED, ZLIB, ImageCache
from minihuman.worlds.picture_hash import hash_picture
from minihuman.worlds.team import PictureTiles, make_team


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
        shared.pack(bytes([number]), "lossless", noise)
        assert sum(len(packed) for _, packed in shared._packed.values()) == shared._n_bytes <= 20_000
    assert (bytes([49]), "lossless") in shared._packed, "the latest stay"


def test_a_picture_that_was_hashed_for_the_log_is_not_hashed_again_and_is_sent_once(monkeypatch) -> None:
    cache = ImageCache("lossless")
    plain, other = (np.full((16, 16, 3), shade, np.uint8) for shade in (77, 78))
    cache.number(plain)
    hashes = [hash_picture(plain), hash_picture(other)]
    monkeypatch.setattr(screen_values, "hash_picture", lambda *_: (_ for _ in ()).throw(AssertionError("hashed again")))
    numbers = [cache.number(picture, picture_hash=known) for picture, known in zip((plain, other), hashes, strict=True)]
    assert numbers == [0, 1]
    assert [zlib.decompress(message.data)[0] for message in cache.take_new()] == [77, 78]


def taken(into: ImageCache, picture: np.ndarray) -> list:
    into.number(picture)
    return into.take_new()


def test_a_picture_of_tiles_is_packed_once_for_each_that_is_new() -> None:
    def draw(shade: int) -> np.ndarray:
        return np.full((4, 4, 3), shade, np.uint8)

    cache = ImageCache("jpeg")
    first = cache.number_tiles(PictureTiles([(1,), (2,), (1,), (1,)], 2, 4, draw))
    *tiles, whole = cache.take_new()
    assert [zlib.decompress(tile.data)[0] for tile in tiles] == [1, 2], "exact, whatever the study's encoding is"
    assert (whole.number, whole.encoding, whole.width, whole.height) == (first, TILED, 8, 8)
    assert np.frombuffer(whole.data, "<u4").tolist() == [tiles[0].number, tiles[1].number, *2 * [tiles[0].number]]
    second = cache.number_tiles(PictureTiles([(1,), (2,), (1,), (3,)], 2, 4, draw))
    assert len(cache.take_new()) == 2
    assert second != first
    assert cache.number_tiles(PictureTiles([(1,), (2,), (1,), (1,)], 2, 4, draw)) == first
    cache.forget()
    cache.number_tiles(PictureTiles([(1,), (2,), (1,), (1,)], 2, 4, draw))
    assert len(cache.take_new()) == 3


def test_a_kitchen_of_tiles_is_the_picture_that_it_draws() -> None:
    kitchen = make_team("minihuman/Team-CrampedRoom-v0")
    kitchen.reset(1)
    tiles = kitchen.picture_tiles(0, 400, 300)
    assert np.array_equal(tiles.join(), kitchen.frame(0, 400, 300))
    assert tiles.join().shape == (300, 375, 3)
