"""Many people at one lobby, some of whom leave in the middle: who is paired when, and what becomes of the others."""

import random
from pathlib import Path

import pytest

from minihuman.activities.team.events import TeamEnded, TeamFormed
from minihuman.admin.payments import compute_payments
from minihuman.admin.protocol_file import read_protocol
from minihuman.admin.status import count_participant_flow
from minihuman.admin.verify.episodes import verify_teams
from minihuman.experiment.machine.transitions import Phase
from minihuman.experiment.protocol.protocol import Protocol
from minihuman.runtime.team_host import TeamTable
from tests.activities.team.machines import Clock, Seat
from tests.activities.team.study import PEOPLE, team_study
from tests.counts import count

ARRIVALS_IN_S, POLL_S, PAIRED_IN_S, LOBBY_S = 60.0, 0.25, 2.0, 20.0
TEAM = f'{PEOPLE}\npartner_leaves = "end"\npartner_wait_s = 5\nlobby_s = {LOBBY_S}'
BONUS = "[bonus]\nper_point = 0.1\nwaiting_per_min = 0.2\nbase_pay = 4.0\n"


class Person:
    """Somebody who comes, reads, waits, and plays to the end or leaves in the middle."""

    def __init__(self, protocol: Protocol, data: Path, table: TeamTable, rng: random.Random) -> None:
        self.seat = Seat(protocol, data, table)
        self.leaves, self.has_left = rng.random() < 0.1, False
        self.waits_since_s = self.waited_s = -1.0
        self._reads_s = rng.uniform(0.5, 3.0)

    def live(self, now_s: float) -> None:
        """A quarter of a second."""
        seat, phase = self.seat, self.seat.machine.phase
        self._reads_s -= POLL_S
        if phase is Phase.PLAYING and self.leaves and len(seat.joint) == 2:
            self.has_left = True
            seat.stop("connection_lost")
            return
        seat.wait(1000 * POLL_S)
        if phase is Phase.PLAYING and seat.machine.phase is Phase.PLAYING:
            seat.press("1")
        elif phase not in (Phase.LOBBY, Phase.WAITING) and self._reads_s <= 0:
            seat.press("enter")
        if self.waits_since_s < 0 and seat.machine.phase is not Phase.INSTRUCTIONS:
            self.waits_since_s = now_s
        if self.waits_since_s >= 0 > self.waited_s and seat.machine.phase is not Phase.LOBBY:
            self.waited_s = now_s - self.waits_since_s


@pytest.mark.nightly(sample=True)
def test_a_crowd_is_paired_at_once_nobody_waits_too_long_and_everybody_is_paid_and_counted(tmp_path: Path) -> None:
    number, rng, clock = count(20, 200), random.Random(5), Clock()
    path = team_study(
        tmp_path, team=TEAM, episodes=1, max_steps=4, participants=number, block='instructions = "Go."', more=BONUS
    )
    protocol = read_protocol(path)
    table = TeamTable(protocol, tmp_path, clock)
    comes_s = sorted(rng.uniform(0.0, ARRIVALS_IN_S) for _ in range(number))
    people: list[Person] = []
    while len(people) < number or not all(person.seat.machine.over for person in people):
        clock.s += POLL_S
        people += [Person(protocol, tmp_path, table, rng) for at_s in comes_s[len(people) :] if at_s <= clock.s]
        for person in people:
            if not person.seat.machine.over:
                person.live(clock.s)
    for person in people:
        person.seat.save()

    teams: dict[str, list[Person]] = {}
    for person in people:
        for formed in person.seat.of(TeamFormed):
            teams.setdefault(formed.team, []).append(person)
    assert {len(members) for members in teams.values()} == {2}
    for members in teams.values():
        second_s = max(person.waits_since_s for person in members)
        assert all(person.waits_since_s + person.waited_s <= second_s + PAIRED_IN_S for person in members)
    assert max(person.waited_s for person in people) <= LOBBY_S + POLL_S

    left = {person.seat.plan.participant.id for person in people if person.has_left}
    stranded = {person.seat.plan.participant.id for person in people if person.seat.of(TeamEnded)}
    unpaired = {person for person in people if not person.seat.of(TeamFormed)}
    with_one = [members for members in teams.values() if sum(person.has_left for person in members) == 1]
    others = unpaired.union(*with_one)
    assert left
    assert stranded == {person.seat.plan.participant.id for person in others if not person.has_left}
    paid = {pay.participant: pay for pay in compute_payments(tmp_path / "duet")}
    assert len(paid) == number
    assert all(paid[code].bonus >= 4.0 for code in stranded)
    for person in people:
        pay = paid[person.seat.plan.participant.id]
        assert abs(60 * pay.waited_min - person.waited_s) <= 2 * POLL_S

    flow = count_participant_flow(tmp_path / "duet")
    course = flow.courses[1]
    assert flow.came == sum(flow.allocated.values()) == sum(course.began.values()) == number
    assert sum(course.complete.values()) == number - len(left)
    assert sum(course.unfinished.values()) == len(left)
    assert all(good for _, good in verify_teams(tmp_path / "duet"))
