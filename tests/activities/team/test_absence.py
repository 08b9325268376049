"""Partners who close the page, leave it, sleep, look elsewhere, lose the network or do nothing: who plays, and when."""

import random
from dataclasses import dataclass, field
from typing import Literal

import pytest

from minihuman.activities.team.joint_play import JointPlay
from minihuman.activities.team.joint_step import StepDue
from minihuman.activities.team.plan import TeamPlan
from minihuman.activities.team.requests import JointRequest, JointTaken, Team
from minihuman.experiment.machine.life_signs import LifeSigns
from tests.activities.team.test_joint_play import BLOCK, PLAN
from tests.counts import count

KINDS = ("person", "person")
STAYS, GOES = 0, 1
IDLE, AGENT_ACTION = 9, 7
POLL_S = 0.05  # how often the server and a waiting page look
PERIOD_S = 0.15  # of a tick
Absence = Literal["closed", "left", "asleep", "unfocused", "offline", "idle"]
ABSENCES: tuple[Absence, ...] = ("closed", "left", "asleep", "unfocused", "offline", "idle")


@dataclass
class Person:
    """A person with a page, as the server hears of them."""

    seat: int
    rng: random.Random
    press_s: tuple[float, float]  # from one key to the next, at least and at most
    ping_s: float
    signs: LifeSigns = field(default_factory=lambda: LifeSigns(tells_acts=True))
    is_page_here: bool = True
    is_person_here: bool = True
    next_press_s: float = 0.0
    next_ping_s: float = 0.0
    next_tick_s: float = 0.0
    step: int = 1
    action: int | None = None
    is_key: bool = False
    key: int | None = None
    n_pressed: int = 0

    def live(self, now_s: float, *, is_real_time: bool) -> None:
        """Press, tick and ping as it comes."""
        if self.is_page_here and now_s >= self.next_ping_s:
            self.next_ping_s = now_s + self.ping_s
            self.signs.hear(now_s)
        if self.is_page_here and self.is_person_here and now_s >= self.next_press_s:
            self.next_press_s = now_s + self.rng.uniform(*self.press_s)
            self.key = self.rng.randrange(5)
            self.n_pressed += 1
            self.signs.act(now_s)
        if self.action is not None or not self.is_page_here:
            return
        if is_real_time and now_s >= self.next_tick_s:
            self.next_tick_s = now_s + PERIOD_S
            self.signs.hear(now_s)
            self.is_key = self.key is not None
            self.action = IDLE if self.key is None else self.key
            self.key = None
        elif not is_real_time and self.key is not None:
            self.action = self.key
            self.is_key = True
            self.key = None

    def vanish(self, absence: Absence, now_s: float) -> tuple[float, float]:
        """Go; return the times of the last signs of life, the person's and the page's, that the limit counts from."""
        match absence:
            case "closed" | "left":
                self.signs.lose_page(absence, now_s)
                self.is_page_here = False
                return now_s, now_s
            case "unfocused":
                self.signs.turn_focus(now_s, has_focus=False)
                self.is_person_here = False
                return now_s, now_s
            case "idle":
                self.is_person_here = False
                return self.signs.person_s or 0.0, self.signs.person_s or 0.0
        self.is_page_here = False  # nothing comes any more; where the network is gone, the socket breaks in a while
        return self.signs.person_s or 0.0, self.signs.page_s or 0.0

    def come_back(self, now_s: float) -> None:
        """Open the page, and play."""
        self.signs.open_page(now_s)
        if not self.signs.has_focus:
            self.signs.turn_focus(now_s, has_focus=True)
        self.is_page_here = True
        self.is_person_here = True
        self.press_s = (0.1, 0.5)
        self.next_press_s = now_s + 0.3
        self.action = None


class Game:
    """Two people at one `JointPlay`, on a clock of the test's own."""

    def __init__(self, seed: int, *, is_real_time: bool, late_ms: float, wait_s: float, thinking_wait_s: float) -> None:
        rng = random.Random(seed)
        rules = TeamPlan(seats=KINDS, late_ms=late_ms, partner_wait_s=wait_s, thinking_wait_s=thinking_wait_s)
        self.joint = JointPlay(KINDS, rules)
        self.people = [Person(seat, rng, (0.1, 0.6 * wait_s), wait_s / 3) for seat in (STAYS, GOES)]
        for person in self.people:
            self.joint.presence.follow(person.seat, person.signs)
            person.signs.act(0.0)
        self.is_real_time = is_real_time
        self.now_s = 0.0
        self.closed_s: list[tuple[float, tuple[str, ...]]] = []  # when each step closed, and who acted

    def run_until(self, end_s: float) -> None:
        while self.now_s < end_s:
            self.now_s += POLL_S
            for person in self.people:
                person.live(self.now_s, is_real_time=self.is_real_time)
            for person in self.people:
                self._ask(person)

    def _ask(self, person: Person) -> None:
        team = Team("ab", 0, person.seat, KINDS)
        want = JointRequest(team, PLAN, BLOCK, person.step, person.action, person.is_key and person.action is not None)
        answer = self.joint.submit(want, self.now_s, is_real_time=self.is_real_time)
        if isinstance(answer, StepDue):
            chosen = dict.fromkeys(answer.agents, AGENT_ACTION)
            answer = self.joint.close(answer, person.seat, chosen, IDLE)
            self.closed_s.append((self.now_s, answer.sources))
        if isinstance(answer, JointTaken):
            person.step += 1
            person.action = None

    def find_takeover_s(self, after_s: float) -> float:
        """When the first step closed after a time in which an agent acted for the one who went."""
        return next(closed_s for closed_s, sources in self.closed_s if closed_s > after_s and sources[GOES] == "agent")


@pytest.mark.nightly(sample=True)
@pytest.mark.parametrize("is_real_time", [True, False], ids=["ticks", "turns"])
@pytest.mark.parametrize("absence", ABSENCES)
def test_an_agent_takes_the_seat_within_a_tick_of_the_limit_and_who_comes_back_resumes(
    absence: Absence, is_real_time: bool
) -> None:
    for seed in range(count(25, 200)):
        rng = random.Random(f"{absence} {seed}")
        wait_s = rng.uniform(1.0, 6.0)
        thinking_s = rng.uniform(2.0, 4.0) * wait_s
        game = Game(
            seed,
            is_real_time=is_real_time,
            late_ms=rng.uniform(10, 140),
            wait_s=wait_s,
            thinking_wait_s=thinking_s,
        )
        game.run_until(rng.uniform(0.5, 4.0))
        gone_s = game.now_s
        assert {sources for _, sources in game.closed_s} <= {
            ("person", "person"),
            ("person", "late"),
            ("late", "person"),
        }
        person_s, page_s = game.people[GOES].vanish(absence, gone_s)
        is_thinking = absence == "idle" and not is_real_time
        game.people[STAYS].press_s = (0.1, 0.15)  # so that a step waits, whenever it is
        game.people[STAYS].next_press_s = gone_s
        if absence == "offline":
            game.run_until(gone_s + 0.5 * wait_s)
            game.people[GOES].signs.lose_page("offline", game.now_s)
        game.run_until(gone_s + (thinking_s if is_thinking else wait_s) + 3.0)
        takeover_s = game.find_takeover_s(gone_s)
        if is_thinking:  # the limit counts from when the others began to wait
            assert person_s + thinking_s <= takeover_s <= gone_s + thinking_s + 3 * PERIOD_S
        else:
            first_s = min(person_s, page_s) if is_real_time else page_s
            assert first_s + wait_s - 1e-9 <= takeover_s <= page_s + wait_s + PERIOD_S + 2 * POLL_S
        played = [sources[GOES] for closed_s, sources in game.closed_s if closed_s > takeover_s]
        assert set(played) == {"agent"}
        assert {sources[STAYS] for closed_s, sources in game.closed_s if closed_s > takeover_s} == {"person"}
        back_s = game.now_s
        game.people[GOES].step = len(game.closed_s) + 1
        game.people[GOES].come_back(back_s)
        game.run_until(back_s + 3.0)
        assert "person" in {sources[GOES] for closed_s, sources in game.closed_s if closed_s > back_s}
        assert game.closed_s[-1][1][GOES] in ("person", "late")


@pytest.mark.parametrize("is_real_time", [True, False], ids=["ticks", "turns"])
def test_nobody_who_plays_is_replaced_however_slowly_within_the_limits(is_real_time: bool) -> None:
    for seed in range(25):
        game = Game(seed, is_real_time=is_real_time, late_ms=100, wait_s=2.0, thinking_wait_s=8.0)
        game.people[GOES].press_s = (0.1, 1.9) if is_real_time else (0.1, 7.0)
        game.run_until(30.0)
        assert not any("agent" in sources for _, sources in game.closed_s)


def test_a_person_who_closed_the_page_with_an_input_that_waits_gets_no_seat_back_by_it() -> None:
    game = Game(0, is_real_time=False, late_ms=100, wait_s=2.0, thinking_wait_s=60.0)
    stays, goes = game.people
    stays.next_press_s = 10.0  # thinks
    game.run_until(1.0)
    assert goes.action is not None
    goes.vanish("closed", game.now_s)
    game.run_until(14.0)
    sources = [sources[GOES] for _, sources in game.closed_s]
    assert sources[0] == "person"  # what they gave counts
    assert set(sources[1:]) == {"agent"}
