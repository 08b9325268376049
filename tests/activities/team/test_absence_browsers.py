"""A partner in a browser who is gone in one of six ways: an agent has the seat, and the one who stays is told."""

import json
import os
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest

import minihuman
from minihuman.activities.team.events import JointStepped, SeatSeen, SeatTaken, TeamFormed
from minihuman.admin.verify.episodes import verify_teams
from minihuman.admin.verify.log import find_log_differences
from minihuman.dataset.selection import Selection
from minihuman.experiment.machine.events import KeyPressed, SessionEnded
from minihuman.log.read.session_reader import read_events
from minihuman.worlds.adapters.world import World
from tests.activities.team.browsers import CODES
from tests.activities.team.study import PEOPLE, team_study
from tests.counts import count
from tests.machine import needs
from tests.web.browser import Somebody, browsing
from tests.web.serving import Line, line, serving

pytestmark = needs("chromium")
N_RUNS = int(os.environ.get("MINIHUMAN_ABSENCE_RUNS", count(1, 17)))  # 204 of all twelve
WAIT_S, THINKING_S, PERIOD_MS = 3, 5, 100  # a busy machine's hand comes back within them
TOO_LONG = "options = { length = 60 }"  # no pair whose key "1" means "right" reaches the end of such a line
REPLACED = "A computer program plays for you"
_LOSE_FOCUS = """() => {
  document.hasFocus = () => false;
  dispatchEvent(new Event("blur"));
}"""
GOING: dict[str, Callable[[Somebody, Line], object]] = {
    "closed": lambda person, _: person.page.close(),
    "left": lambda person, _: person.page.goto("about:blank"),
    "asleep": lambda _, wire: setattr(wire, "stalled", True),  # nothing comes, and the connection stands
    "offline": lambda _, wire: wire.cut(),
    "unfocused": lambda person, _: person.page.evaluate(_LOSE_FOCUS),
    "idle": lambda person, wire: None,
}
# A page that a browser closes at once may not come to say so: its socket breaks. On a busy machine one of 34 that were
# left for another page did not, either.
STATES = {"closed": ("closed", "left", "offline"), "left": ("closed", "left", "offline"), "asleep": ("silent",)}
STATES["idle"] = ("idle", "here")  # who thinks over a turn is here


@pytest.mark.nightly(by_day=["closed-ticks"])
@pytest.mark.program
@pytest.mark.parametrize("pace", ["ticks", "turns"])
@pytest.mark.parametrize("how", GOING)
def test_an_agent_takes_the_seat_of_a_partner_who_is_gone_and_the_other_is_told(
    tmp_path: Path, how: str, pace: str
) -> None:
    n_runs = N_RUNS
    block = f'{TOO_LONG}\npace = "real_time"\nstep_period_ms = {PERIOD_MS}' if pace == "ticks" else TOO_LONG
    team = f"{PEOPLE}\npartner_wait_s = {WAIT_S}\nthinking_wait_s = {THINKING_S}"
    episodes, max_steps = (5, 40) if pace == "ticks" else (3, 20)
    protocol = team_study(
        tmp_path, episodes=episodes, max_steps=max_steps, block=block, team=team, participants=2 * n_runs
    )
    heard: dict[int, list[str]] = {}
    with serving(protocol, tmp_path, links=2 * n_runs) as served, browsing() as sit_down:
        for run in range(n_runs):
            tokens = served.tokens[2 * run : 2 * run + 2]
            with line(served.port, rtt_ms=0) as wire:
                stays = sit_down(f"http://127.0.0.1:{served.port}/#t={tokens[0]}")
                port = wire.port if how in ("asleep", "offline") else served.port
                goes = sit_down(f"http://127.0.0.1:{port}/#t={tokens[1]}")
                texts = play_until_one_goes(stays, goes, wire, how, n_before=2 + run % 5)
                heard[run] = stays.page.evaluate("sessionStorage.getItem('heard')").split()
                for person in (stays, goes):
                    person.page.close()
            assert any("A partner is away: a computer program plays for them now" in text for text in texts)
        served.stop()
    logs = sorted((tmp_path / "duet").rglob("*.mcap*"))
    assert len(logs) == 2 * n_runs
    assert [list(find_log_differences(log, World)) for log in logs] == [[]] * len(logs)
    assert all(good for _, good in verify_teams(tmp_path / "duet"))
    takeovers = [takeover for log in logs if (takeover := find_takeover(log, how, pace)) is not None]
    lost = count_lost(logs, [*heard.values()])
    print(
        f"{how}, {pace}: {len(takeovers)} takeovers, all in the first step after the limit; ms since the last sign of "
        f"life when it closed {sorted(takeover.silent_ms for takeover in takeovers)}, "
        f"steps without the partner before {sorted(takeover.n_idle for takeover in takeovers)}, presses lost {lost}"
    )
    assert len(takeovers) == n_runs
    assert {takeover.state for takeover in takeovers} <= set(STATES.get(how, (how,)))
    assert lost == 0
    assert_tables_agree(tmp_path / "duet", logs)


def play_until_one_goes(stays: Somebody, goes: Somebody, wire: Line, how: str, *, n_before: int) -> list[str]:
    """Play together, then let one go and the other play on to the end; return what was on the other's screen."""
    people = (stays, goes)
    for person in people:
        person.until("s.welcomed && s.kind !== ''")
    while REPLACED in goes.screen() or not is_under_way(people, n_before):
        for person in people:
            person.press("1" if person.state["playing"] else "enter")
        stays.page.wait_for_timeout(30)
    GOING[how](goes, wire)
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


class Takeover(NamedTuple):
    """How an agent took a seat, in the server's clock."""

    state: str  # of the person, as it was seen last before
    silent_ms: int  # since their last sign of life, when the agent's first step closed
    n_idle: int  # steps that closed without the person before


def find_takeover(log: Path, how: str, pace: str) -> Takeover | None:
    """Return the last takeover that a log has; None where the log's person went.

    No step closes without the agent once the limit is over, however late the server is: each step says for how long the
    person had given no sign of life when it closed.
    """
    events = list(read_events(log))
    [formed] = [event for event in events if isinstance(event, TeamFormed)]
    other = 1 - formed.seat
    joint = [event for event in events if isinstance(event, JointStepped)]
    sources = [event.sources[other] for event in joint]
    if not sources or sources[-1] != "agent":
        return None
    first = max(place for place, source in enumerate(sources) if source != "agent") + 1
    taken = [event for event in events if isinstance(event, SeatTaken) and event.seat == other]
    assert (taken[-1].by, taken[-1].step) == ("agent", joint[first].step)
    silent_ms = [event.silent_ms[other] for event in joint]
    limit_ms = (THINKING_S if how == "idle" and pace == "turns" else WAIT_S) * 1_000
    waited_ms = [silent for silent, source in zip(silent_ms, sources, strict=True) if source != "agent"]
    assert max(waited_ms) < limit_ms <= silent_ms[first]
    sighted = [event.state for event in events if isinstance(event, SeatSeen) and event.seat == other]
    acted = [place for place, source in enumerate(sources) if source == "person"]
    n_idle = first - max(acted, default=-1) - 1
    return Takeover(sighted[-1] if sighted else "here", silent_ms[first], n_idle)


def count_lost(logs: list[Path], heard: list[list[str]]) -> int:
    """Count the presses that the pages of those who stayed heard and the logs lack, but for Enter after the end."""
    logged = []
    for log in logs:
        presses = [event for event in read_events(log) if isinstance(event, KeyPressed) and event.down]
        logged.append([press.key for press in presses if press.verdict != "repeat"])
    n_lost = 0
    for codes in heard:
        keys = [CODES[code] for code in codes]
        n_lost += min(count_missing(keys, of_log) for of_log in logged)
    return n_lost


def count_missing(keys: list[str], logged: list[str]) -> int:
    if keys[: len(logged)] != logged:
        return len(keys)
    return sum(key != "enter" for key in keys[len(logged) :])


def assert_tables_agree(study: Path, logs: list[Path]) -> None:
    """The table `teams` says of each complete log's seats who acted in how many steps, as its joint steps have it."""
    teams = minihuman.open_study(study, Selection(with_=("rules",))).table("teams")
    for log in logs:
        events = list(read_events(log))
        if not any(isinstance(event, SessionEnded) and event.reason == "complete" for event in events):
            continue
        joint = [event.sources for event in events if isinstance(event, JointStepped)]
        of_log = teams[teams["participant"] == log.name.partition("_")[0]]
        tabled = [Counter[str](), Counter[str]()]
        for played_by in of_log["played_by"]:
            for seat, steps in enumerate(json.loads(played_by)):
                tabled[seat].update(steps)
        assert tabled == [Counter(sources) for sources in zip(*joint, strict=True)]
