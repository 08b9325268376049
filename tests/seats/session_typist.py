"""A participant made of X key events: types a whole session, in every way that fingers fall on keys."""

import time
from collections.abc import Iterator, Sequence
from contextlib import closing
from itertools import cycle
from pathlib import Path

from minihuman.agents.goal_search import find_shortest_path
from minihuman.experiment.machine.events import Noted
from minihuman.experiment.plan.session_plan import EpisodePlan, SessionPlan
from minihuman.log.read.session_reader import read_events
from minihuman.worlds.adapters.world import World
from tests.counts import PATIENCE_S
from tests.xserver import Typist

UNMAPPED = "z"
AGAIN_S = 10.0  # a person who sees that nothing has happened presses again


def type_session(typist: Typist, plan: SessionPlan, data: Path) -> None:
    """Everything from the keyboard check to the closing text. Play is typed blindly: no input may be lost there.

    Keys are tapped, tapped twice within a frame, and rolled from one to the next; strangers and questions between.
    What each screen waits for is looked up in the live log, as a person looks at the screen.
    """
    begin(typist, plan, data)
    for episode in plan.episodes:
        if episode.episode > 0 and episode.episode_in_block == 0:
            enter_at(typist, data, "instructions")
            enter_at(typist, data, "ready")
        until(data, "playing")
        _play(typist, episode)
        enter_at(typist, data, "feedback")
        last_of_block = episode.episode_in_block == episode.episodes_in_block - 1
        if last_of_block and plan.texts[episode.block].rest:
            enter_at(typist, data, "rest")
    enter_at(typist, data, "closing", "page")


def begin(typist: Typist, plan: SessionPlan, data: Path) -> None:
    """Everything up to the first episode's first picture."""
    typist.tap(*plan.key_pool)
    enter_at(typist, data, "instructions")
    enter_at(typist, data, "ready")
    until(data, "playing")


def enter_at(typist: Typist, data: Path, *phases: str) -> None:
    """Press Enter in one of these phases until it is taken: it is not before the screen is there."""
    until(data, *phases)
    entered = _count_phases(data)
    deadline_s = time.monotonic() + PATIENCE_S
    time.sleep(0.2)  # written before it is shown
    while True:
        typist.tap("enter")
        again_s = time.monotonic() + AGAIN_S
        while time.monotonic() < again_s:
            if _count_phases(data) != entered:
                return
            time.sleep(0.05)
        assert time.monotonic() < deadline_s, f"no Enter leads on from {' or '.join(phases)}"


def agree(typist: Typist, data: Path) -> None:
    """Read a consent to its end and agree: before that there is no log to look anything up in."""
    deadline_s = time.monotonic() + PATIENCE_S
    while not any(data.rglob("*.part")):
        assert time.monotonic() < deadline_s, "nobody could agree"
        typist.tap("enter")
        for _ in range(20):
            time.sleep(0.05)
            if any(data.rglob("*.part")):
                return


def until(data: Path, *phases: str) -> None:
    """Wait until the live log says that the session is in one of these phases."""
    deadline_s = time.monotonic() + PATIENCE_S
    while (now := _phase(data)) not in phases:
        assert time.monotonic() < deadline_s, f"the session stays in {now!r}, not in {' or '.join(phases)}"
        time.sleep(0.05)


def _phases(data: Path) -> list[str]:
    events = [event for part in data.rglob("*.part") for event in read_events(part)]
    return [event.text for event in events if isinstance(event, Noted) and event.kind == "phase"]


def _phase(data: Path) -> str:
    return (_phases(data) or [""])[-1]


def _count_phases(data: Path) -> int:
    """How many the session has been in; none once it has ended."""
    return len(_phases(data))


def _play(typist: Typist, episode: EpisodePlan) -> None:
    typist.tap(UNMAPPED, *episode.key_map.spare_keys)
    typist.tap("escape", "escape")  # end the session? no
    typist.tap("f8", "enter")  # a pause
    fingers = cycle((_tap, _roll, _tap))
    for pair in _pairs(_way(episode)):
        next(fingers)(typist, pair)


def _way(episode: EpisodePlan) -> list[str]:
    """The keys of the shortest way to the goal."""
    key_of = {action: key for key, action in episode.key_map.keys.items()}
    with closing(World(episode.world, episode.options)) as world:
        world.reset(episode.seed)
        return [key_of[action] for action in find_shortest_path(world)]


def _pairs(keys: Sequence[str]) -> Iterator[Sequence[str]]:
    return (keys[start : start + 2] for start in range(0, len(keys), 2))


def _tap(typist: Typist, keys: Sequence[str]) -> None:
    typist.tap(*keys)


def _roll(typist: Typist, keys: Sequence[str]) -> None:
    """The second key goes down before the first comes up; one key alone, or twice the same, cannot be rolled."""
    if len(set(keys)) < 2:
        typist.tap(*keys)
        return
    for key in keys:
        typist.press(key)
    for key in keys:
        typist.release(key)
