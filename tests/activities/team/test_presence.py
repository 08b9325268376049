"""Who holds a seat: what happens when a person is silent, leaves, and comes back, without a session or a clock."""

import pytest

from minihuman.activities.team.plan import TeamPlan
from minihuman.activities.team.presence import TeamPresence

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


def test_a_person_is_silent_after_the_wait_and_a_key_ends_the_silence():
    seats = presence()
    seats.note_silence(2, now_s=5.0)
    seats.note_silence(2, now_s=12.0)  # the first tick without a key counts
    assert not seats.is_silent(2, now_s=14.9)
    assert seats.is_silent(2, now_s=15.0)
    seats.note_key(2, now_s=15.0)
    assert not seats.is_silent(2, now_s=24.9)


def test_the_last_person_who_acts_is_never_silent():
    seats = presence()
    seats.note_key(2, now_s=0.0)
    seats.hand_over({0})
    assert not seats.is_silent(2, now_s=1000.0)


def test_a_person_whose_seat_an_agent_has_is_silent_at_once():
    seats = presence()
    seats.note_key(2, now_s=1.0)
    seats.hand_over({2})
    assert seats.is_silent(2, now_s=1.0)


def test_a_restored_seat_is_the_agents_even_where_the_block_would_end():
    seats = presence(partner_leaves="end")
    seats.restore({2})
    assert seats.absent == {2}
    assert not seats.has_ended
