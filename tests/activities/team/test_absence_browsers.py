"""A partner who closes the browser's page, or goes to another: an agent has the seat, and the one who stays is told."""

from collections.abc import Callable
from pathlib import Path

import pytest

from minihuman.activities.team.events import JointStepped, SeatSeen, SeatTaken, TeamFormed
from minihuman.admin.verify.episodes import verify_teams
from minihuman.admin.verify.log import find_log_differences
from minihuman.log.read.session_reader import read_events
from minihuman.worlds.adapters.world import World
from tests.activities.team.study import PEOPLE, team_study
from tests.counts import count
from tests.machine import needs
from tests.web.browser import Somebody, browsing
from tests.web.serving import serving

pytestmark = needs("chromium")
WAIT_S, PERIOD_MS = 1, 100
GOING: dict[str, Callable[[Somebody], object]] = {
    "closed": lambda person: person.page.close(),
    "left": lambda person: person.page.goto("about:blank"),
}


@pytest.mark.nightly(by_day=["closed-ticks"])
@pytest.mark.program
@pytest.mark.parametrize("pace", ["ticks", "turns"])
@pytest.mark.parametrize("how", ["closed", "left"])
def test_an_agent_takes_the_seat_of_a_partner_whose_page_is_gone_and_the_other_is_told(
    tmp_path: Path, how: str, pace: str
) -> None:
    n_runs = count(1, 10)
    block = f'pace = "real_time"\nstep_period_ms = {PERIOD_MS}' if pace == "ticks" else ""
    team = f"{PEOPLE}\npartner_wait_s = {WAIT_S}"
    protocol = team_study(tmp_path, episodes=3, max_steps=40, block=block, team=team, participants=2 * n_runs)
    with serving(protocol, tmp_path, links=2 * n_runs) as served, browsing() as sit_down:
        for run in range(n_runs):
            tokens = served.tokens[2 * run : 2 * run + 2]
            stays, goes = (sit_down(f"http://127.0.0.1:{served.port}/#t={token}") for token in tokens)
            texts = play_until_one_goes(stays, goes, how, n_before=2 + run % 5)
            assert any("A partner is away: a computer program plays for them now" in text for text in texts)
            stays.page.close()
        served.stop()
    logs = sorted((tmp_path / "duet").rglob("*.mcap*"))
    assert len(logs) == 2 * n_runs
    assert [list(find_log_differences(log, World)) for log in logs] == [[]] * len(logs)
    assert all(good for _, good in verify_teams(tmp_path / "duet"))
    n_idle = [check_takeover(log, pace) for log in logs]
    print(f"{how}, {pace}: ticks without the partner before the agent {sorted(number for number in n_idle if number)}")
    assert sum(number is not None for number in n_idle) == n_runs


def play_until_one_goes(stays: Somebody, goes: Somebody, how: str, *, n_before: int) -> list[str]:
    """Play together, then let one go and the other play on to the end; return what was on the other's screen."""
    people = (stays, goes)
    for person in people:
        person.until("s.welcomed && s.kind !== ''")
    while not is_under_way(people, n_before):
        for person in people:
            person.press("1" if person.state["playing"] else "enter")
        stays.page.wait_for_timeout(30)
    GOING[how](goes)
    texts: list[str] = []
    while not stays.state["finished"]:
        is_playing = stays.state["playing"]
        stays.press("1" if is_playing else "enter")
        if is_playing:
            texts.append(stays.screen())
        stays.page.wait_for_timeout(30)
    assert stays.errors == []
    return texts


def is_under_way(people: tuple[Somebody, ...], n_steps: int) -> bool:
    """Whether all play, some steps into an episode; on a busy machine one may be over before both have begun."""
    states = [person.state for person in people]
    assert not any(state["finished"] for state in states)
    return all(state["playing"] and state["step"] >= n_steps for state in states)


def check_takeover(log: Path, pace: str) -> int | None:
    """Check a log's takeover; return in how many ticks the partner idled before, None where the log's person went."""
    events = list(read_events(log))
    [formed] = [event for event in events if isinstance(event, TeamFormed)]
    other = 1 - formed.seat
    gone = [event for event in events if isinstance(event, SeatSeen) and event.seat == other]
    gone = [event for event in gone if event.state in ("closed", "left")]
    if not gone:
        return None
    since = (gone[0].episode, gone[0].step)
    joint = [event for event in events if isinstance(event, JointStepped)]
    sources = [event.sources[other] for event in joint if (event.episode, event.step) > since]
    first = sources.index("agent")
    assert set(sources[first:]) == {"agent"}
    assert [event.by for event in events if isinstance(event, SeatTaken) and event.seat == other][-1] == "agent"
    n_idle = sources.count("late")
    if pace == "ticks":
        assert n_idle <= WAIT_S * 1_000 / PERIOD_MS + 1
    else:
        assert n_idle == 0
    return n_idle
