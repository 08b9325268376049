"""Two ends of the stream, over sockets that break whenever they like."""

import random

import pytest

from minihuman.web.stream import Hearing, Saying
from minihuman.web.wire import WireError


def test_what_is_said_over_lines_that_break_arrives_once_and_in_order() -> None:
    chance = random.Random(5)
    for _ in range(200):
        saying: Saying[int] = Saying()
        hearing, arrived = Hearing(), []
        said = 0
        while len(arrived) < 40:
            for number, message in saying.after(
                chance.randint(0, hearing.heard)
            ):  # a new line: said from some place on
                if chance.random() < 0.1:
                    break  # it broke
                if hearing.take(number):
                    arrived.append(message)
            if chance.random() < 0.5:
                saying.heard(hearing.heard)
            if said < 40:
                saying.say(said)
                said += 1
        assert arrived == list(range(40))


def test_a_message_behind_a_gap_is_refused() -> None:
    hearing = Hearing(3)
    assert not hearing.take(2)
    assert hearing.take(4)
    with pytest.raises(WireError, match="message 6 follows message 4"):
        hearing.take(6)


def test_nobody_has_heard_what_was_not_said() -> None:
    saying: Saying[str] = Saying()
    saying.say("one")
    with pytest.raises(WireError, match="not said yet"):
        saying.heard(2)


def test_what_was_heard_is_kept_no_longer() -> None:
    saying: Saying[str] = Saying()
    for word in ("one", "two", "three"):
        saying.say(word)
    saying.heard(2)
    assert list(saying.after(0)) == [(3, "three")]
