"""Two people's pages at the far ends of a network that delays, reorders and loses: both logs hold the same world."""

import heapq
import random
from pathlib import Path

import pytest

from minihuman.activities.team.events import InputLate, JointStepped
from minihuman.experiment.machine.events import KeyPressed, Stepped
from minihuman.experiment.machine.inputs import Input, KeyDown, ScreenShown, Tick
from minihuman.experiment.machine.transitions import Phase
from tests.activities.team.machines import MS, Seat, sit_down
from tests.activities.team.study import team_study
from tests.activities.team.test_partners import TICKS, proven
from tests.counts import count

EVERY_MS, STEP_MS = 50, 25  # a page sends so often; time passes in such steps
DELAY_MS, LOSS, RETRANSMIT_MS = (20, 180), 0.02, 500


class Page:
    """What a page sends: numbered messages, taken by the server in their order, whenever they come."""

    def __init__(self, seat: Seat, rng: random.Random) -> None:
        self.seat, self._rng = seat, rng
        self._sent = self._taken = 0
        self.overtaken = self.lost = 0
        self._air: list[tuple[int, int, str]] = []  # when it arrives, its number, and the key, if any
        self._early: dict[int, str] = {}

    def send(self, now_ns: int) -> None:
        """Send what was seen, and a key now and then."""
        playing = self.seat.machine.phase is Phase.PLAYING
        key = self._rng.choice("123") if playing else "enter"
        delay_ms = self._rng.uniform(*DELAY_MS)
        while self._rng.random() < LOSS:
            self.lost += 1
            delay_ms += RETRANSMIT_MS
        message = (now_ns + round(delay_ms * MS), self._sent, key if self._rng.random() < 0.3 else "")
        heapq.heappush(self._air, message)
        self._sent += 1

    def arrive(self, now_ns: int) -> None:
        """Give the server what has come, in the order of sending."""
        while self._air and self._air[0][0] <= now_ns:
            _, number, key = heapq.heappop(self._air)
            self.overtaken += number != self._taken
            self._early[number] = key
            while self._taken in self._early:
                key, self._taken = self._early.pop(self._taken), self._taken + 1
                inputs: list[Input] = [Tick(now_ns), ScreenShown(now_ns, now_ns, now_ns)]
                self.seat.take_at(now_ns, *inputs, *([KeyDown(now_ns, key)] if key else []))
        self.seat.take_at(now_ns)


@pytest.mark.nightly(sample=True)
def test_no_tick_differs_between_two_logs_whatever_the_network_does(tmp_path: Path) -> None:
    wanted, ticks, late, overtaken, lost, pair = count(300, 100_000), 0, 0, 0, 0, 0
    while ticks < wanted:
        rng, folder = random.Random(pair), tmp_path / str(pair)
        folder.mkdir()
        block = f"{TICKS}\noptions = {{ length = 60 }}"
        study = team_study(folder, block=block, episodes=count(2, 50), max_steps=40, participants=2)
        seats, clock, _ = sit_down(study, folder)
        pages, now_ms = [Page(seat, rng) for seat in seats], 0
        while not all(seat.machine.over for seat in seats) and now_ms < 10_000_000:
            now_ms += STEP_MS
            clock.s = now_ms / 1000
            for page in pages:
                if now_ms % EVERY_MS == 0 and not page.seat.machine.over:
                    page.send(now_ms * MS)
                page.arrive(now_ms * MS)
        one, two = ([(step.actions, step.sources, step.digest) for step in seat.of(JointStepped)] for seat in seats)
        assert one == two
        states = [[(step.episode, step.step, step.state_hash) for step in seat.of(Stepped)] for seat in seats]
        assert states[0] == states[1]
        for seat in seats:
            acted = {(step.key_t_ns, step.key) for step in seat.of(Stepped) if step.key}
            acted |= {(key.key_t_ns, key.key) for key in seat.of(InputLate)}
            pressed = {(key.t_ns, key.key) for key in seat.of(KeyPressed) if key.verdict == "queued"}
            assert acted <= pressed
        assert pair or proven(*seats)
        ticks += len(one)
        late += sum(len(seat.of(InputLate)) for seat in seats)
        overtaken += sum(page.overtaken for page in pages)
        lost += sum(page.lost for page in pages)
        pair += 1
        print(f"{pair} pairs, {ticks} ticks, {overtaken} messages overtaken, {lost} lost, {late} keys late", flush=True)
    assert overtaken > ticks / 10
    assert late > 0
    assert lost > 0
