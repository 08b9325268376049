"""A participant made of X key and mouse events, who reads, answers and plays: any study, part after part.

When to do something is looked up in the live log, as a person looks at the screen; what was answered is kept.
"""

import json
import time
from collections.abc import Callable, Iterable
from contextlib import closing
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path

import numpy as np

from minihuman.activities.pages.plan import PagePlan
from minihuman.activities.play.plan import PlayPlan
from minihuman.activities.questions.plan import QuestionsPlan
from minihuman.activities.questions.question import QuestionItemSpec, build_draft
from minihuman.activities.questions.screens import build_question_screen
from minihuman.agents.goal_search import find_shortest_path
from minihuman.display.drawing.screen import find_spot
from minihuman.display.windows.blocking_window import TITLE
from minihuman.experiment.machine.events import (
    Answered,
    EpisodeEnded,
    Event,
    Noted,
    PageShown,
    PartEnded,
    PartStarted,
    Stepped,
)
from minihuman.experiment.machine.part_sequence import asks_consent_before_play
from minihuman.experiment.plan.session_plan import EpisodePlan, PlannedPart, SessionPlan
from minihuman.experiment.words import InterfaceWords
from minihuman.log.read.session_reader import read_events
from minihuman.worlds.adapters.world import World
from tests.counts import PATIENCE_S
from tests.seats.session_typist import agree
from tests.xserver import Typist

GRID = tuple(product(np.linspace(0.005, 0.995, 200), np.linspace(0.005, 0.995, 120)))


@dataclass
class Participant:
    """Whoever sits there, and what they have answered: part, item, JSON value."""

    typist: Typist
    plan: SessionPlan
    part_file: Path
    size_px: tuple[int, int]
    given: list[tuple[str, str, str]] = field(default_factory=list)
    _read: tuple[int, list[Event]] = (0, [])  # the log's size when it was read last, and what was in it

    def take_part(self) -> None:
        """Do every part, to the end."""
        agreed = 0
        if asks_consent_before_play(self.plan):
            agree(self.typist, self.part_file.parent)
            agreed = 1 + next(
                n for n, part in enumerate(self.plan.parts) if isinstance(part.plan, PagePlan) and part.plan.agree
            )
        for number, part in list(enumerate(self.plan.parts))[agreed:]:
            self._until(lambda events, n=number: any(isinstance(e, PartStarted) and e.part == n for e in events))
            self._do(number, part)

    def _do(self, number: int, part: PlannedPart) -> None:
        match part.plan:
            case PagePlan() as page:
                for place in range(1, len(page.pages) + 1):
                    self._until(_page_is_open(number, place))
                    self.typist.tap("enter")
            case QuestionsPlan() as asked:
                for place, question in enumerate(asked.items):
                    self._until(_answers(number, place))
                    self._answer(number, part.name, asked, place, question)
                    self.typist.tap("tab")
            case PlayPlan() as play:
                self._play(number, play)
            case _:
                self.typist.tap(*self.plan.key_pool)

    def _answer(self, number: int, name: str, asked: QuestionsPlan, place: int, question: QuestionItemSpec) -> None:
        """Now by mouse, now by key: a right answer where there is one, else one that depends on the place."""
        codes, count = question.all_codes, len(question.all_codes)
        chosen = codes.index(question.right) if question.right in codes else (place * 3 + 1) % max(1, count)
        time.sleep(0.15)  # the question has to be on the screen before it can be pointed at
        match question.kind:
            case "slider" if place % 2:
                steps = place + 1
                self.typist.tap("home", *["right"] * steps)
                value: object = int(question.minimum + steps * question.step)
            case "slider":
                total = round((question.maximum - question.minimum) / question.step)
                steps = round((0.1 + 0.13 * place) * total)
                self._click(asked, place, "slider", steps / total)  # a whole step: a pixel more is the same answer
                value = int(question.minimum + steps * question.step)
            case "number":
                value = int(question.minimum) + 5
                self.typist.tap(*str(value))
            case _ if place % 2:
                self.typist.tap(str(chosen + 1))
                value = codes[chosen]
            case _:
                self._click(asked, place, f"option:{chosen}")
                value = codes[chosen]
        self.given.append((name, question.name, json.dumps(value, ensure_ascii=False)))

    def _click(self, asked: QuestionsPlan, place: int, target: str, along: float = 0.5) -> None:
        words, question = InterfaceWords(self.plan.language, self.plan.words), asked.items[place]
        screen = build_question_screen(
            words,
            title=asked.title,
            draft=build_draft(question, rtl=words.rtl),
            number=place,
            count=len(asked.items),
            note="",
        )
        found = [(x, y, find_spot(screen, self.size_px, float(x), float(y))) for x, y in GRID]
        inside = [(x, y, at) for x, y, (name, at) in found if name == target]
        assert inside, f"{target} is nowhere on the screen"
        middle = np.median([y for _, y, _ in inside])
        x, y, _ = min(inside, key=lambda spot: abs(spot[2] - along) + abs(spot[1] - middle))
        self.typist.point(TITLE, float(x), float(y))
        self.typist.button(True)
        self.typist.button(False)

    def _play(self, number: int, play: PlayPlan) -> None:
        for place in range(len(play.instruction)):
            self._until(_page_is_open(number, place + 1))
            self.typist.tap("enter")
        for episode in self.plan.episodes[play.first : play.first + play.count]:
            before = None if episode.episode == play.first else episode.episode - 1
            self._until(_ready_or_over(number, before))
            if any(isinstance(event, PartEnded) and event.part == number for event in self._events()):
                return
            if _last_phase(self._events()) == "ready":
                time.sleep(0.05)
                self.typist.tap("enter")
            self._until(lambda events: _last_phase(events) == "playing")
            for done, key in enumerate(_way(episode), 1):
                self.typist.tap(key)
                self._until(_steps(episode.episode, done))
            self._until(_over(episode.episode))
            self._until(lambda events: _last_phase(events) != "hold")
            if _last_phase(self._events()) == "feedback":
                self.typist.tap("enter")
        if play.rest:
            self._until(lambda events: _last_phase(events) == "rest")
            self.typist.tap("enter")

    def _until(self, holds: Callable[[list[Event]], bool]) -> None:
        deadline_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < deadline_s:
            if holds(self._events()):
                return
            time.sleep(0.03)
        raise AssertionError(f"the log stopped at {self._events()[-3:]}")

    def _events(self) -> list[Event]:
        if not self.part_file.exists():
            return []
        size = self.part_file.stat().st_size
        if size != self._read[0]:
            self._read = size, list(read_events(self.part_file))
        return self._read[1]


def _page_is_open(part: int, page: int) -> Callable[[list[Event]], bool]:
    return lambda events: any(isinstance(e, PageShown) and (e.part, e.page) == (part, page) for e in events)


def _answers(part: int, count: int) -> Callable[[list[Event]], bool]:
    return lambda events: sum(isinstance(e, Answered) and e.part == part for e in events) >= count


def _steps(episode: int, count: int) -> Callable[[list[Event]], bool]:
    return lambda events: sum(isinstance(e, Stepped) and e.episode == episode for e in events) >= count


def _over(episode: int) -> Callable[[list[Event]], bool]:
    return lambda events: any(isinstance(e, EpisodeEnded) and e.episode == episode for e in events)


def _ready_or_over(part: int, before: int | None) -> Callable[[list[Event]], bool]:
    def holds(events: list[Event]) -> bool:
        if any(isinstance(e, PartEnded) and e.part == part for e in events):
            return True
        ended = before is None or any(isinstance(e, EpisodeEnded) and e.episode == before for e in events)
        return ended and _last_phase(events) in ("ready", "interval", "fixation", "playing")

    return holds


def _last_phase(events: Iterable[Event]) -> str:
    return [e.text for e in events if isinstance(e, Noted) and e.kind == "phase"][-1]


def _way(episode: EpisodePlan) -> list[str]:
    """The keys of the shortest way to the goal."""
    key_of = {action: key for key, action in episode.key_map.keys.items()}
    with closing(World(episode.world, episode.options)) as world:
        world.reset(episode.seed)
        return [key_of[action] for action in find_shortest_path(world)]
