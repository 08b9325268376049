"""Two people in two browsers who play together, and are interrupted."""

import random
import time
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Literal

from minihuman.activities.team.events import InputLate, JointStepped, SeatTaken
from minihuman.admin.verify.episodes import verify_teams
from minihuman.admin.verify.log import find_log_differences
from minihuman.experiment.machine.events import KeyPressed, Noted, Stepped
from minihuman.experiment.replay import BROWSER_NOTE
from minihuman.log.read.session_reader import read_events
from minihuman.worlds.adapters.world import World
from tests.counts import PATIENCE_S
from tests.web.browser import Somebody, browsing
from tests.web.serving import Line, Serving, line, serving

CODES = {"Digit1": "1", "Digit2": "2", "Digit3": "3", "Enter": "enter"}


class Played:
    """What two people's logs say at the end."""

    def __init__(self, study: Path, heard: list[list[str]]) -> None:
        logs = sorted(study.rglob("*.mcap*"))
        assert len(logs) == 2, logs
        self.events = [list(read_events(log)) for log in logs]
        self.heard = [[CODES[code] for code in keys] for keys in heard]
        self.logged = [
            [
                event.key
                for event in events
                if isinstance(event, KeyPressed) and event.down and event.verdict != "repeat"
            ]
            for events in self.events
        ]
        self.complaints = [list(find_log_differences(log, World)) for log in logs]
        self.notes = [
            event.text
            for events in self.events
            for event in events
            if isinstance(event, Noted) and event.kind == BROWSER_NOTE
        ]
        self.teams = list(verify_teams(study))

    @property
    def lost(self) -> list[list[str]]:
        """Presses that were heard and not logged once in their place; after a session's end Enter leads nowhere."""
        return [
            heard if heard[: len(logged)] != logged else [key for key in heard[len(logged) :] if key != "enter"]
            for heard, logged in zip(self.heard, self.logged, strict=True)
        ]

    def count(self, kind: type) -> list[int]:
        """How many events of a kind each log has."""
        return [sum(isinstance(event, kind) for event in events) for events in self.events]

    @property
    def joint(self) -> list[list[tuple[int, ...]]]:
        """The joint actions in each log."""
        return [[event.actions for event in events if isinstance(event, JointStepped)] for events in self.events]

    @property
    def summary(self) -> dict[str, list[int]]:
        """Counts, by seat's log."""
        return {kind.__name__: self.count(kind) for kind in (Stepped, JointStepped, InputLate, SeatTaken)}


def play_together(
    protocol: Path,
    folder: Path,
    *,
    interruptions: Mapping[str, int] = MappingProxyType({}),
    seed: int = 0,
    rtt_ms: float = 0.0,
    loss: float = 0.0,
    name: str = "duet",
    answers_s: tuple[float, float] | None = None,
    moves_between: int = 5,
    upgrades: Literal["passed", "closed"] = "passed",
) -> tuple[Played, Counter[str]]:
    """Play to the end of both sessions, through interruptions of the server, either connection and either page.

    Args:
        protocol: what is played.
        folder: where the logs go.
        interruptions: how many of each: "kill", "cut" and "reload".
        seed: of what is pressed and interrupted.
        rtt_ms: there and back, of either's line.
        loss: share of the TCP segments that are sent again.
        name: the study's.
        answers_s: how long each takes, at least and at most, from seeing a step to their next key; None: both press on.
        moves_between: presses from one interruption to the next.
        upgrades: what becomes of web sockets on both lines.
    """
    chance, happened = random.Random(seed), Counter[str]()
    with (
        serving(protocol, folder, links=2) as served,
        line(served.port, rtt_ms=rtt_ms, loss=loss) as first,
        line(served.port, rtt_ms=rtt_ms, loss=loss) as second,
        browsing() as sit_down,
    ):
        wires = (first, second)
        for wire in wires:
            wire.upgrades = upgrades
        people = [
            sit_down(f"http://127.0.0.1:{wire.port}/#t={token}")
            for wire, token in zip(wires, served.tokens, strict=True)
        ]
        for somebody in people:
            somebody.until("s.welcomed && s.kind !== ''")
        left = [what for what, times in interruptions.items() for _ in range(times)]
        chance.shuffle(left)
        moves, press = 0, _press if answers_s is None else _Answers(answers_s)
        while not all(somebody.state["finished"] for somebody in people):
            press(people, chance)
            moves += 1
            assert moves < 200 * PATIENCE_S, [somebody.state for somebody in people]
            if left and moves % moves_between == 0 and any(somebody.state["playing"] for somebody in people):
                _interrupt(left.pop(), people, served, wires, chance)
                happened = Counter(interruptions) - Counter(left)
        heard = [somebody.page.evaluate("sessionStorage.getItem('heard') ?? ''").split() for somebody in people]
        assert [somebody.errors for somebody in people] == [[], []]
        served.stop()
    return Played(folder / name, heard), happened


def _press(people: list[Somebody], chance: random.Random) -> None:
    for somebody in people:
        state = somebody.state
        if not state["finished"]:
            somebody.press(chance.choice("123") if state["playing"] or state["kind"] == "play" else "enter")
    people[0].page.wait_for_timeout(60)


class _Answers:
    """People who press one key for each step that they have seen, some time after they saw it."""

    def __init__(self, takes_s: tuple[float, float]) -> None:
        self._takes_s = takes_s
        self._due_s: dict[tuple[int, str, int], float] = {}  # by person and what they see

    def __call__(self, people: list[Somebody], chance: random.Random) -> None:
        for who, somebody in enumerate(people):
            state = somebody.state
            if state["finished"] or (state["playing"] and (state["step"] != state["confirmed"] or not state["known"])):
                continue
            seen = who, state["kind"], state["step"]
            due_s = self._due_s.setdefault(seen, time.monotonic() + chance.uniform(*self._takes_s))
            if time.monotonic() >= due_s:
                del self._due_s[seen]
                somebody.press(chance.choice("123") if state["playing"] else "enter")
        people[0].page.wait_for_timeout(10)


def _interrupt(
    what: str, people: list[Somebody], served: Serving, wires: tuple[Line, Line], chance: random.Random
) -> None:
    who = chance.randrange(2)
    if what == "kill":
        served.kill()
        _press(people, chance)
        served.again()
    elif what == "cut":
        wires[who].cut()
        _press(people, chance)
        wires[who].mend()
    else:
        people[who].page.reload()
    for somebody in people:
        somebody.until("s.finished || (s.welcomed && s.kind !== '')")
