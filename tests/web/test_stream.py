"""Two ends of the stream, over sockets that break whenever they like."""

import json
import random

import pytest

from minihuman.web.message_codec import decode_page_message
from minihuman.web.message_streams import IncomingStream, OutgoingStream
from minihuman.web.messages import MessageError

WITH_EVERY_KEY = [
    (
        ["k", 7, 61_000_123, 1234, "left", 1, "0123456789abcdef", "a", True],
        {"t": "key", "key": "left", "down": True, "stamp": 60_998_889_000, "symbol": "a", "repeat": True}
        | {"digest": "0123456789abcdef"},
    ),
    (["k", 7, 61_000_123, 5, "left", 0], {"t": "key", "key": "left", "down": False, "stamp": 61_000_118_000}),
    (
        ["s", 7, 61_000_123, 60, 900, 12, 345],
        {"t": "shown", "flip": 61_000_063_000, "submit": 60_999_223_000, "episode": 12, "step": 345},
    ),
    (["s", 7, 61_000_123, 0, 0, 12, 345, 2**52 - 1], None),
    (["t", 7, 61_000_123], {"t": "tick"}),
    (["t", 7, 61_000_123, "0123456789abcdef"], {"t": "tick", "digest": "0123456789abcdef"}),
]


@pytest.mark.parametrize(("short", "what"), WITH_EVERY_KEY)
def test_what_comes_with_every_key_may_be_a_short_array_or_an_object_with_names(short, what) -> None:
    what = what or {"t": "shown", "flip": 61_000_123_000, "submit": 61_000_123_000, "episode": 12, "step": 345} | {
        "node": 2**52 - 1
    }
    full = {"t": "n", "n": 7, "at": 61_000_123_000, "what": what}
    assert decode_page_message(json.dumps(short)) == decode_page_message(json.dumps(full))


@pytest.mark.parametrize(
    "text",
    [
        *("[]", "[[]]", '["k"]', '["k",1,2,3]', '["k",1,5,[],"1",1]', '["k",1,5,9,"1",1]', '["k",1,5,null,"1",1]'),
        *('["k",1,1e300,1,"1",1]', '["s",1,5]', '["s",1,5,0,0,[],1]', "[{},1,2]", '["hello",1,2]', '["t",0,2]'),
        *('["t",1,5,"zz"]', '["t",1,5,"",1]', '["k",1,"' + "9" * 9000 + '",1,"1",1]', "[" * 9000, '["t",1,0]'),
    ],
)
def test_a_short_array_that_no_page_sends_is_refused(text: str) -> None:
    with pytest.raises(MessageError, match="reload the page"):
        decode_page_message(text)


def test_what_is_said_over_lines_that_break_arrives_once_and_in_order() -> None:
    chance = random.Random(5)
    for _ in range(200):
        outgoing: OutgoingStream[int] = OutgoingStream()
        hearing, arrived = IncomingStream(), []
        said = 0
        while len(arrived) < 40:
            for number, message in outgoing.after(
                chance.randint(0, hearing.received)
            ):  # a new line: said from some place on
                if chance.random() < 0.1:
                    break  # it broke
                if hearing.take(number):
                    arrived.append(message)
            if chance.random() < 0.5:
                outgoing.acknowledge(hearing.received)
            if said < 40:
                outgoing.add(said)
                said += 1
        assert arrived == list(range(40))


def test_a_message_behind_a_gap_is_refused() -> None:
    hearing = IncomingStream(3)
    assert not hearing.take(2)
    assert hearing.take(4)
    with pytest.raises(MessageError, match="message 6 arrived after message 4"):
        hearing.take(6)


def test_nobody_has_heard_what_was_not_said() -> None:
    outgoing: OutgoingStream[str] = OutgoingStream()
    outgoing.add("one")
    with pytest.raises(MessageError, match="was acknowledged"):
        outgoing.acknowledge(2)


def test_what_was_heard_is_kept_no_longer() -> None:
    outgoing: OutgoingStream[str] = OutgoingStream()
    for word in ("one", "two", "three"):
        outgoing.add(word)
    outgoing.acknowledge(2)
    assert list(outgoing.after(0)) == [(3, "three")]
