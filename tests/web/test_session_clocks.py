"""The session's time, by the server's clock and the page's."""

import pytest

from minihuman.web.messages import MessageError
from minihuman.web.page_presence import PagePresence
from minihuman.web.session_clocks import SegmentClock

S = 1_000_000_000


def test_a_page_may_be_a_little_ahead_of_the_server_and_a_thousandth_more_with_time() -> None:
    clock = SegmentClock(0)
    clock.check(1, 5 * S, 0)
    clock.check(1, 1_006 * S, 1_000 * S)
    with pytest.raises(MessageError, match="message 7 has time 5000000001 ns, but the session is at 0 ns"):
        clock.check(7, 5 * S + 1, 0)
    with pytest.raises(MessageError, match="reload the page"):
        clock.check(7, 1_006 * S + 1, 1_000 * S)


def test_the_time_of_a_page_that_went_on_without_a_server_counts_unless_it_claims_more_than_a_day() -> None:
    clock = SegmentClock(100)
    assert clock.at(150) == 50
    clock.catch_up(30)
    assert clock.at(150) == 80
    clock.catch_up(-10)
    clock.catch_up(24 * 3_600 * S)
    assert clock.at(150) == 80


def test_only_the_newest_socket_says_that_the_page_is_gone() -> None:
    presence = PagePresence(0.0)
    first = presence.open_socket(1.0)
    second = presence.open_socket(2.0)
    presence.close_socket(first, 5.0)
    assert presence.is_here
    assert presence.absence_s(9.0) == 0
    presence.close_socket(second, 10.0)
    assert not presence.is_here
    assert presence.absence_s(12.5) == 2.5


def test_a_page_that_was_sent_away_has_no_socket_that_counts() -> None:
    presence = PagePresence(0.0)
    number = presence.open_socket(1.0)
    presence.dismiss(4001)
    assert not presence.is_newest(number)
    assert not presence.is_here
    assert presence.dismissal_code == 4001


def test_a_page_that_is_open_may_be_left_alone() -> None:
    presence = PagePresence(1.0)
    presence.open_socket(1.0)
    presence.record_act(4.0)
    assert presence.inactivity_s(10.0) == 6.0


def test_a_page_that_said_farewell_is_not_offline_and_is_here_again_with_its_next_socket():
    presence = PagePresence(0.0)
    number = presence.open_socket(1.0)
    presence.bid_farewell(3.0, is_left=True)
    presence.close_socket(number, 4.0, 1006)
    assert (presence.signs.page, presence.signs.page_s) == ("left", 3.0)
    presence.open_socket(9.0)
    assert (presence.signs.page, presence.signs.page_s) == ("open", 9.0)
