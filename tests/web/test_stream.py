"""Two ends of the stream, over sockets that break whenever they like."""

import random

import pytest

from minihuman.web.messages import IncomingStream, MessageError, OutgoingStream


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
