"""Who holds a seat: what happens when a person is silent, leaves, and comes back, without a session or a clock."""

import pytest

from minihuman.activities.team.plan import TeamPlan
from minihuman.activities.team.presence import TeamPresence
from minihuman.experiment.machine.life_signs import LifeSigns

KINDS = ("person", "scripted:random", "person")


def presence(**rules) -> TeamPresence:
    return TeamPresence(KINDS, TeamPlan(seats=KINDS, partner_wait_s=10, **rules))


def test_at_first_every_person_holds_their_own_seat_and_the_agent_is_nobody():
    seats = presence()
    assert seats.persons == seats.present == {0, 2}
    assert seats.absent == set()


def test_the_stand_in_gets_a_seat_and_its_person_takes_it_back():
    seats = presence()
    assert seats.hand_over({2})
    assert (seats.present, seats.absent) == ({0}, {2})
    assert seats.may_act(2)
    seats.take_back(2)
    assert seats.present == {0, 2}
    assert not seats.has_ended


def test_where_a_block_ends_for_a_partner_who_left_no_agent_gets_the_seat():
    seats = presence(partner_leaves="end")
    assert not seats.hand_over({2})
    assert seats.has_ended
    assert seats.absent == set()


@pytest.mark.parametrize(
    ("rule", "may_act", "is_shut_out"), [("seat", True, False), ("watch", False, False), ("end", False, True)]
)
def test_who_comes_back_to_an_agent_acts_watches_or_is_shut_out(rule, may_act, is_shut_out):
    seats = presence(partner_return=rule)
    seats.hand_over({2})
    assert (seats.may_act(2), seats.is_shut_out(2)) == (may_act, is_shut_out)
    assert seats.may_act(0)
    assert not seats.is_shut_out(0)


def test_who_watches_has_the_seat_back_when_nobody_else_acts():
    seats = presence(partner_return="watch")
    seats.hand_over({0, 2})
    assert seats.may_act(0)
    assert seats.may_act(2)


def overdue(seats: TeamPresence, now_s: float, *, asking: int = 0, is_real_time: bool = True) -> list[int]:
    for seat in seats.persons:
        seats._seats[seat].signs.hear(now_s)
    return seats.find_overdue(asking, now_s, is_real_time=is_real_time)


def test_a_person_who_presses_nothing_is_idle_after_the_wait_in_ticks_and_a_key_ends_that():
    seats = presence()
    assert overdue(seats, 5.0) == []  # the wait begins when somebody looks
    seats.note_input(0, now_s=12.0)
    assert overdue(seats, 14.9) == []
    assert overdue(seats, 15.0) == [2]
    assert seats.find_sighting(2, 15.0, is_real_time=True).state == "idle"
    seats.note_input(2, now_s=15.0)
    seats.note_input(0, now_s=16.0)
    assert overdue(seats, 24.9) == []


def test_in_turns_who_presses_nothing_thinks_and_has_a_limit_of_their_own():
    seats = presence(thinking_wait_s=30)
    assert overdue(seats, 0.0, is_real_time=False) == []
    assert overdue(seats, 29.9, is_real_time=False) == []
    assert seats.find_thinkers([0, 2], 29.9) == []
    seats.note_input(0, now_s=29.9)
    assert seats.find_thinkers([0, 2], 30.0) == [2]


def test_who_thinks_may_think_longer_than_partners_wait_for_one_who_is_gone():
    assert TeamPlan(partner_wait_s=3).thinking_limit_s == 120
    assert TeamPlan(partner_wait_s=300).thinking_limit_s == 300
    assert TeamPlan(partner_wait_s=300, thinking_wait_s=20).thinking_limit_s == 20


@pytest.mark.parametrize("is_real_time", [True, False])
@pytest.mark.parametrize("state", ["closed", "left", "offline", "silent", "unfocused"])
def test_who_is_gone_is_overdue_the_wait_after_their_last_sign_of_life(state, is_real_time):
    seats = presence()
    signs = LifeSigns()
    seats.follow(2, signs)
    signs.act(1.0)
    match state:
        case "unfocused":
            signs.turn_focus(2.0, has_focus=False)
        case "closed" | "left":
            signs.lose_page(state, 2.0)
        case "offline":
            signs.hear(2.0)
            signs.lose_page("offline", 6.0)  # found out later: no sign of life
        case "silent":
            signs.hear(2.0)
    for now_s, gone in ((2.0, []), (11.9, []), (12.0, [2])):
        seats.note_input(0, now_s)
        if state == "unfocused":
            signs.hear(now_s)
        assert seats.find_overdue(0, now_s, is_real_time=is_real_time) == gone
    assert seats.find_sighting(2, 12.0, is_real_time=is_real_time) == (state, 2.0)


def test_the_last_person_who_acts_is_never_overdue():
    seats = presence()
    assert overdue(seats, 0.0) == []
    seats.hand_over({0}, 1.0)
    assert overdue(seats, 1000.0) == []


def test_of_two_people_who_are_gone_the_one_who_gave_the_later_sign_keeps_the_seat():
    seats = presence()
    seats.note_input(0, 3.0)
    seats.note_input(2, 2.0)
    assert seats.find_overdue(2, 100.0, is_real_time=True) == [2]


def test_nobody_takes_a_seat_back_before_they_did_something_since_or_with_their_page_closed():
    seats = presence()
    signs = LifeSigns()
    seats.follow(2, signs)
    signs.act(1.0)
    seats.hand_over({2}, 20.0)
    assert not seats.has_returned(2)
    signs.lose_page("closed", 21.0)
    signs.act(22.0)
    assert not seats.has_returned(2)
    signs.open_page(23.0)
    assert seats.has_returned(2)


def test_a_seat_is_told_what_it_does_not_know_of_the_others():
    seats = presence()
    signs = LifeSigns()
    seats.follow(2, signs)
    signs.act(1.0)
    known = ("here", "here", "here")
    assert seats.find_news(known, 1.0, is_real_time=False) is None
    signs.lose_page("left", 2.0)
    seats.note_input(0, 3.0)
    assert seats.find_news(known, 3.5, is_real_time=False) == (2, "left", 1.5)
    assert seats.find_news(("here", "here", "left"), 3.5, is_real_time=False) is None
    assert seats.find_news((), 3.5, is_real_time=False) is None


def test_a_restored_seat_is_the_agents_even_where_the_block_would_end():
    seats = presence(partner_leaves="end")
    seats.restore({2})
    assert seats.absent == {2}
    assert not seats.has_ended
