"""Digests of values: the same for the same, others for whatever else is held."""

import subprocess
import sys
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import msgspec
import numpy as np
import pytest

from minihuman.data.content import content_sha256


@dataclass(frozen=True, eq=False)
class Pair:
    first: object
    second: object


class Struct(msgspec.Struct):
    first: object
    second: object


ALL_DIFFERENT = [
    None, True, 1, 1.0, "1", b"1", Path("1"), np.float64(1), np.int64(1), np.array(1), (1,), [1], {1: None}, {None: 1},
    ("ab", "c"), ("a", "bc"), ("abc",), (("a",), "b"), ("a", ("b",)), ("a", "b"), ["a", "b"], {"a": "b"}, {"b": "a"},
    {"a": 1, "b": 2}, {"b": 2, "a": 1}, frozenset("ab"), float("nan"), 0.0, -0.0,
    np.zeros(4), np.zeros((2, 2)), np.zeros(4, np.float32), np.zeros(4, np.int64), np.array([0.0, 0, 0, 1]),
    np.array([0.0, 0, 0, np.nan]), Pair("a", "b"), Pair("ab", ""), Pair("a", np.zeros(1)), Struct("a", "b"), "",
]  # fmt: skip


def test_no_two_values_that_differ_have_the_same_digest():
    digests = [content_sha256(value) for value in ALL_DIFFERENT]
    for (place, one), (other, two) in combinations(enumerate(digests), 2):
        assert one != two, (ALL_DIFFERENT[place], ALL_DIFFERENT[other])


def test_equal_values_have_the_same_digest_however_they_lie_in_memory():
    grid = np.arange(12.0).reshape(3, 4)
    assert content_sha256(grid[:, ::2]) == content_sha256(grid[:, ::2].copy())
    assert content_sha256(Pair("a", grid)) == content_sha256(Pair("a", grid.copy()))
    assert content_sha256(frozenset("abc")) == content_sha256(frozenset("cba"))


def test_the_digest_is_the_same_in_another_process():
    said = "from minihuman.data.content import content_sha256 as f; print(f(({'x', 'y'}, {'a': 1.5}, 'b')))"
    told = {
        subprocess.run(
            [sys.executable, "-c", said], env={"PYTHONHASHSEED": seed}, capture_output=True, text=True, check=True
        ).stdout.strip()
        for seed in "12"
    }
    assert told == {content_sha256(({"x", "y"}, {"a": 1.5}, "b"))}


@pytest.mark.parametrize("value", [object(), lambda: 0, [1, object()], {"a": {1: object()}}, np.array([object()])])
def test_what_cannot_be_seen_into_is_refused(value):
    with pytest.raises(TypeError, match="no digest can see into"):
        content_sha256(value)
