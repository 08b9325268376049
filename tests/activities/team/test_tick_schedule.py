"""When a real-time team's inputs are due, by the server's clock."""

import random

from minihuman.activities.team.tick_schedule import TickSchedule

PERIOD_S = 0.3
LATE_S = 0.1


def share_of_late(rng: random.Random, *, early_s: float) -> float:
    """Play 70 ticks with a partner who sends them on time, and another ``early_s`` before they are due."""
    schedule = TickSchedule(0.0)
    phase_s = rng.uniform(0.02, 0.09)  # a round trip and a picture
    late = 0
    closed_s = 0.0
    for step in range(1, 71):
        honest_s = step * PERIOD_S + phase_s + rng.uniform(0, 0.03)
        opened_s = min(honest_s, max(closed_s, step * PERIOD_S - early_s))
        schedule.record_input(0, step, opened_s)
        due_s = schedule.find_due_s({1}, step, opened_s, PERIOD_S)
        late += honest_s > due_s + LATE_S
        closed_s = min(honest_s, due_s + LATE_S)
        schedule.record_input(1, step, honest_s)
    return late / 70


def test_a_seat_that_sends_its_ticks_early_makes_its_partner_late_no_more_often() -> None:
    rng = random.Random(1)
    assert max(share_of_late(rng, early_s=0.0) for _ in range(50)) < 0.05
    assert max(share_of_late(rng, early_s=0.29) for _ in range(50)) < 0.05
    assert max(share_of_late(rng, early_s=5.0) for _ in range(50)) < 0.05


def test_a_partner_who_is_away_is_waited_for_no_longer_than_a_period() -> None:
    schedule = TickSchedule(0.0)
    assert schedule.find_due_s({1}, 1, 0.0, PERIOD_S) == PERIOD_S
    assert schedule.find_due_s({1}, 1, 0.31, PERIOD_S) == 0.31
    schedule.record_input(1, 1, 2.0)
    schedule.record_input(1, 1, 3.0)  # the same, asked for again
    assert schedule.find_due_s({1}, 2, 2.0, PERIOD_S) == 2.3
    assert schedule.find_due_s({1}, 9, 2.5, PERIOD_S) == 2.8
    assert schedule.find_due_s(set(), 9, 2.5, PERIOD_S) == 2.5
