"""A seat of a real-time team whose page claims that each tick came before it was due.

Its partner is to keep control: no more of the partner's inputs are late beside it than beside an honest seat, and its
log names what it claimed.
"""

import asyncio
import random
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from minihuman.activities.team.events import JointStepped, TeamFormed
from minihuman.admin.verify.episodes import verify_teams
from minihuman.admin.verify.log import find_log_differences
from minihuman.experiment.machine.events import CLOCK_NOTE, Event, Noted
from minihuman.log.read.session_reader import read_events
from minihuman.worlds.adapters.world import World
from tests.activities.team.study import PEOPLE, team_study
from tests.counts import PATIENCE_S, count
from tests.web.serving import serving
from tests.web.typed_page import TypedPage

pytestmark = [pytest.mark.program, pytest.mark.nightly]
N_PAIRS = count(1, 3)  # of each kind
N_STEPS = count(20, 40)
PERIOD_MS = 300
LATE_MS = 100
AHEAD_S = 4.0  # a server refuses what is more than 5 s ahead
NOTED_S = 1.2  # what is claimed to be a second ahead when it arrives, after some way, is named in the log
MAX_RISE = 0.05  # of the partner's share of late inputs


class EarlyPage(TypedPage):
    """A participant whose page claims a tick's time as soon as it knows of the tick."""

    most_ahead_s = 0.0  # of the server's clock, that it claimed

    def _take(self, data: str | bytes) -> None:
        super()._take(data)
        due_ns = self._due_ns
        if due_ns is None or self._zero_s is None or self._told_due_ns == due_ns:
            return
        ahead_s = due_ns / 1e9 - (time.monotonic() - self._zero_s)
        if ahead_s < AHEAD_S:
            self._told_due_ns = due_ns
            self.most_ahead_s = max(self.most_ahead_s, ahead_s)
            self._last_ns = max(self._last_ns, due_ns - 1_000)  # so that the tick has the time at which it is due
            self.say(t="tick")


class AheadPage(TypedPage):
    """A participant whose page has a clock that is ahead of the server's."""

    most_ahead_s = AHEAD_S

    def _take_one(self, message: dict[str, Any]) -> None:
        super()._take_one(message)
        if message.get("m", message)["t"] == "welcome":
            assert self._zero_s is not None
            self._zero_s -= AHEAD_S


KINDS: dict[str, Callable[..., TypedPage]] = {"honest": TypedPage, "early": EarlyPage, "ahead": AheadPage}


async def play_pairs(host: str, tokens: list[str]) -> list[float]:
    """Let pairs play, one after the other: an honest page, and one of each kind in turn.

    Returns:
        by how many seconds the second page of each pair ran ahead of the server's clock.
    """
    ahead_s = []
    kinds = [*KINDS.values()] * N_PAIRS
    for number, kind in enumerate(kinds):
        honest, other = (
            page(host, tokens[2 * number + seat], keys_per_s=2.0, rtt_s=0.02, rng=random.Random(2 * number + seat))
            for seat, page in enumerate((TypedPage, kind))
        )
        playing = asyncio.create_task(honest.take_part())
        while not honest.screen:  # so that theirs is the first log of the two
            await asyncio.sleep(0.05)
        await asyncio.wait_for(asyncio.gather(playing, other.take_part()), PATIENCE_S)
        ahead_s.append(getattr(other, "most_ahead_s", 0.0))
    return ahead_s


def measure_late_share(events: list[Event], seat: int) -> float:
    """Return the share of the joint steps in which the seat's input came too late."""
    sources = [event.sources[seat] for event in events if isinstance(event, JointStepped)]
    assert len(sources) > N_STEPS / 2  # an episode may end at its goal
    return sources.count("late") / len(sources)


def list_claims(events: list[Event]) -> list[str]:
    """List what a log has of a page that is ahead; a busy machine's may be behind."""
    notes = [event.text for event in events if isinstance(event, Noted)]
    return [text for text in notes if text.startswith(CLOCK_NOTE) and "ahead" in text]


def test_an_honest_partner_of_a_seat_that_claims_its_ticks_early_keeps_control(tmp_path: Path) -> None:
    n_people = 2 * N_PAIRS * len(KINDS)
    block = f'pace = "real_time"\nstep_period_ms = {PERIOD_MS}'
    team = f"{PEOPLE}\nlate_ms = {LATE_MS}"
    path = team_study(tmp_path, block=block, team=team, episodes=1, max_steps=N_STEPS, participants=n_people)
    with serving(path, tmp_path, links=n_people) as served:
        ahead_s = asyncio.run(play_pairs(f"127.0.0.1:{served.port}", served.tokens))
        served.stop()
    logs = sorted((tmp_path / "duet").rglob("*.mcap"))
    assert len(logs) == n_people
    assert [list(find_log_differences(log, World)) for log in logs] == [[]] * len(logs)
    assert all(is_right for _, is_right in verify_teams(tmp_path / "duet"))
    shares: dict[str, list[float]] = {kind: [] for kind in KINDS}
    for number in range(n_people // 2):
        kind = [*KINDS][number % len(KINDS)]
        sessions = [list(read_events(log)) for log in logs[2 * number : 2 * number + 2]]
        [seat] = [event.seat for event in sessions[0] if isinstance(event, TeamFormed)]
        shares[kind].append(measure_late_share(sessions[0], seat))
        assert list_claims(sessions[0]) == []
        assert bool(list_claims(sessions[1])) == (ahead_s[number] > NOTED_S), (kind, ahead_s[number])
    means = {kind: sum(of_kind) / len(of_kind) for kind, of_kind in shares.items()}
    print(
        f"{N_PAIRS} pairs of each kind, at most {N_STEPS} steps of {PERIOD_MS} ms: share of the honest inputs that "
        f"were late " + ", ".join(f"{100 * mean:.1f} % beside {kind}" for kind, mean in means.items())
    )
    assert means["early"] < means["honest"] + MAX_RISE
    assert means["ahead"] < means["honest"] + MAX_RISE
