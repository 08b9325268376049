"""A chunk cut into its records: by its index where that is right, else by walking from one to the next."""

import struct

import numpy as np
import pytest

from minihuman.log.salvage.records import split_chunk
from minihuman.log.salvage.scan import LogScanner
from tests.log.played import record
from tests.log.samples import session_events, session_plan


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    plan = session_plan(episodes=2)
    log = record(tmp_path_factory.mktemp("data"), plan, session_events(plan, steps=5))
    return max((record.data for record in LogScanner(log).records() if hasattr(record, "by_topic")), key=len)


def index(*places: int) -> bytes:
    return struct.pack("<HI", 1, 16 * len(places)) + b"".join(struct.pack("<QQ", 0, place) for place in places)


def test_a_chunk_is_cut_alike_with_its_index_and_without(data: bytes) -> None:
    walked = split_chunk(data, [])
    starts = walked.starts.tolist()
    assert len(starts) > 20
    assert [opcode for opcode, _ in walked.other_records].count(4) > 3  # channels
    for given in ([index(*starts)], [index(*starts[::2]), index(*starts[1::2])], [index(*starts[5:9])]):
        again = split_chunk(data, given)
        assert np.array_equal(again.starts, walked.starts)
        assert np.array_equal(again.heads, walked.heads)
        assert again.other_records == walked.other_records


@pytest.mark.parametrize("wrong", ["early", "late", "twice", "beyond", "negative", "cut", "empty"])
def test_an_index_that_does_not_fit_is_passed_over(data: bytes, wrong: str) -> None:
    starts = split_chunk(data, []).starts.tolist()
    given = {
        "early": index(*starts[:-1], starts[-1] - 1),
        "late": index(starts[0] + 3, *starts[1:]),
        "twice": index(*starts, starts[4]),
        "beyond": index(*starts, len(data)),
        "negative": index(*starts, 2**63 + 5),
        "cut": index(*starts)[:-5],
        "empty": b"",
    }
    assert split_chunk(data, [given[wrong]]).starts.tolist() == starts


def test_bytes_that_are_no_records_are_refused(data: bytes) -> None:
    starts = split_chunk(data, []).starts.tolist()
    with pytest.raises(ValueError, match="a record extends past the end of its chunk"):
        split_chunk(data[:-1], [index(*starts)])
