"""The session's time, by the server's clock and the page's."""

import pytest

from minihuman.experiment.machine.events import CLOCK_NOTE
from minihuman.web.messages import MessageError
from minihuman.web.page_presence import PagePresence
from minihuman.web.session_clocks import PageClock, SegmentClock

S = 1_000_000_000


def test_a_page_may_be_a_little_ahead_of_the_server_and_a_thousandth_more_with_time() -> None:
    clock = SegmentClock(0)
    clock.check(1, 5 * S, 0)
    clock.check(1, 1_006 * S, 1_000 * S)
    with pytest.raises(MessageError, match="message 7 has time 5000000001 ns, but the session is at 0 ns"):
        clock.check(7, 5 * S + 1, 0)
    with pytest.raises(MessageError, match="reload the page"):
        clock.check(7, 1_006 * S + 1, 1_000 * S)


def claim(clock: SegmentClock, ahead_ns: int, *, now_ns: int = 0, wall_ns: int | None = None) -> str:
    return clock.catch_up(ahead_ns, wall_ns=now_ns if wall_ns is None else wall_ns, monotonic_ns=now_ns)


def test_the_time_of_a_page_that_went_on_without_a_server_counts_for_as_long_as_the_server_was_away() -> None:
    clock = SegmentClock(0, outage_ns=30 * S)
    assert "claimed to be 20.000 s ahead of the server's; 20.000 s count" in claim(clock, 20 * S)
    assert clock.at(0) == 20 * S
    assert claim(clock, -10 * S) == ""
    assert "36000.000 s ahead of the server's; 10.000 s count" in claim(clock, 36_000 * S)
    assert claim(clock, 36_000 * S) == ""  # noted already
    assert clock.at(0) == 30 * S


def test_a_page_that_claims_ten_hours_of_a_server_that_was_never_away_is_noted_and_not_believed() -> None:
    clock = SegmentClock(100)
    assert clock.at(150) == 50
    assert "36000.000 s ahead of the server's; 0.000 s count" in claim(clock, 36_000 * S)
    assert clock.at(150) == 50


def test_a_page_may_have_gone_on_while_the_servers_machine_slept() -> None:
    clock = SegmentClock(0, wall_ns=1_000 * S, monotonic_ns=0)
    claim(clock, 100 * S, now_ns=10 * S, wall_ns=1_070 * S)
    assert clock.at(10 * S) == 70 * S


def test_a_message_more_than_a_second_ahead_is_noted_and_so_is_each_further_second() -> None:
    clock = SegmentClock(0)
    assert clock.check(1, 1 * S, 0) == ""
    assert clock.check(2, 1_500_000_000, 0) == "the page's time is 1.500 s ahead of the server's"
    assert clock.check(3, 2 * S, 0) == ""
    assert clock.check(4, 3 * S, 0) == "the page's time is 3.000 s ahead of the server's"


def test_a_page_that_measures_nothing_is_compared_all_the_same() -> None:
    clock = PageClock()
    assert not any(clock.compare_arrival(t * S, t * S) for t in range(61))
    notes = [clock.compare_arrival(round(t * 1.05 * S), t * S) for t in range(61, 200)]
    assert sum(bool(note) for note in notes) >= 3
    assert all(note.startswith(CLOCK_NOTE) for note in notes if note)
    assert not any(clock.compare_arrival(t * S - 800_000_000, t * S) for t in range(600, 690, 29))


def test_only_the_newest_socket_says_that_the_page_is_gone() -> None:
    presence = PagePresence(0.0)
    first = presence.open_socket(1.0)
    second = presence.open_socket(2.0)
    presence.close_socket(first, 5.0)
    assert presence.is_here
    assert presence.compute_absence_s(9.0) == 0
    presence.close_socket(second, 10.0)
    assert not presence.is_here
    assert presence.compute_absence_s(12.5) == 2.5


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
    assert presence.compute_inactivity_s(10.0) == 6.0


def test_a_page_that_said_farewell_is_not_offline_and_is_here_again_with_its_next_socket():
    presence = PagePresence(0.0)
    number = presence.open_socket(1.0)
    presence.bid_farewell(3.0, is_left=True)
    presence.close_socket(number, 4.0, 1006)
    assert (presence.signs.page, presence.signs.page_s) == ("left", 3.0)
    presence.open_socket(9.0)
    assert (presence.signs.page, presence.signs.page_s) == ("open", 9.0)
