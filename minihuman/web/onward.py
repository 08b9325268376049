"""The screens that the next few inputs would lead to outside of episodes, each found by trying. No I/O, no clock.

A page shows at once what an input leads to, as in an episode, where that is one of few: going on, agreeing, going back,
choosing an option, time. The session is forked and the input tried; its own screen counts where the two differ.
"""

import hashlib
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import msgspec

from minihuman.errors import WorldError
from minihuman.study.fork import Lend, can_fork, fork
from minihuman.study.inputs import Input, KeyDown, PointerPressed, Shown, Tick
from minihuman.study.screens import (
    BlankScreen,
    Choices,
    Entry,
    FilmScreen,
    PageScreen,
    PairScreen,
    PlayScreen,
    QuestionScreen,
    Scale,
    Screen,
    TextScreen,
)
from minihuman.study.session import Session
from minihuman.web.ahead import name_of
from minihuman.web.drawn import Numbered, drawn
from minihuman.web.wire import Coming, Onward

NEAR_RTT_NS = 40_000_000  # on a shorter line one input ahead is enough
_NAME_BITS = 2**52 - 1  # what a page's numbers hold
_MOST_TRIES = 48  # from one screen
_FLIP_NS = 16_000_000  # until a screen is there
_LOOK_NS = 200_000_000  # until somebody acts on it
_TICK = "tick"
_MOVING = ("step", "steers", "steers_said")  # of a screen that the page goes on with by itself


@dataclass(slots=True)
class _Place:
    """A screen, and the session that shows it."""

    name: int
    session: Session
    depth: int


class Ways:
    """Which screens inputs lead to, from where a session is.

    Args:
        number: numbers a picture, which is sent before the screen that has it.
        lend: lends a world that may be reset.
    """

    def __init__(self, number: Numbered, lend: Lend) -> None:
        self.tried = 0  # inputs
        self._number = number
        self._lend = lend
        self._to_do: deque[tuple[_Place, str]] = deque()
        self._left = 0  # tries
        self._looked_from: set[int] = set()  # since the session shows its screen
        self._screens: set[int] = set()  # that the page has
        self._edges: dict[tuple[int, str], int] = {}
        self._new_screens: list[Coming] = []
        self._new_edges: list[tuple[int, str, int]] = []

    def start_from(self, session: Session, name: int) -> None:
        """The session shows another screen."""
        self._to_do.clear()
        self._left = _MOST_TRIES
        self._looked_from = set()
        if not session.over and can_fork(session) and session.phase is session.part.phase:
            self._look_at(_Place(name, session, 0))

    def grow(self, rtt_ns: int) -> bool:
        """Try one input; False where there is none that is worth it."""
        deepest = 1 if rtt_ns < NEAR_RTT_NS else 3
        while self._to_do and self._left:
            place, said = self._to_do.popleft()
            if place.depth < deepest:
                self._left -= 1
                self._try(place, said)
                return True
        return False

    def take_new(self) -> Onward | None:
        """What the page does not know yet."""
        screens, edges = self._new_screens, self._new_edges
        self._new_screens, self._new_edges = [], []
        return Onward(screens, edges) if edges else None

    def _look_at(self, place: _Place) -> None:
        if place.name not in self._looked_from:
            self._looked_from.add(place.name)
            self._to_do.extend((place, said) for said in inputs_of(place.session))

    def _try(self, place: _Place, said: str) -> None:
        tried = fork(place.session, self._lend)
        self.tried += 1
        _, at_ns = _let_be_seen(tried)
        due_ns = tried.next_tick_ns
        if said == _TICK and due_ns is not None:
            at_ns = max(at_ns, due_ns)
        try:
            tried.receive(_input(said, at_ns))
        except WorldError:  # a world that is not there: what it shows cannot be told before it is
            return
        if tried.over or tried.failure is not None or not can_fork(tried):
            return
        told, name = told_of(tried, self._number)
        playing = tried.play
        if name not in self._screens:
            due_ns = tried.next_tick_ns
            after_ns = None if due_ns is None else max(0, due_ns - at_ns)
            episode, scene = (
                (-1, -1) if playing is None else (playing.plan.episode, name_of(playing.world.scene_hash()))
            )
            self._screens.add(name)
            self._new_screens.append(Coming(name, told, after_ns, episode, scene))
        if self._edges.get((place.name, said)) != name:
            self._edges[place.name, said] = name
            self._new_edges.append((place.name, said, name))
        if playing is None:
            self._look_at(_Place(name, tried, place.depth + 1))


def told_of(session: Session, number: Numbered, known: int = 0) -> tuple[dict[str, Any], int]:
    """What a page is told of a session's screen, and its name: the same wherever the session stands the same.

    Args:
        session: as it stands.
        number: gives a picture its number.
        known: the name of what the page has; a film that it goes through by itself is not told again for each step.
    """
    screen = session.screen
    if isinstance(screen, FilmScreen | PairScreen):
        which = screen.film if isinstance(screen, FilmScreen) else screen.pair
        name = _name((screen.prompt, screen.progress, which), session)
        return ({} if name == known else drawn(screen, number)), name
    told = drawn(screen, number)
    if isinstance(screen, PlayScreen) and session.play is None:
        told["picture"] = number(screen.picture)
    left_out = ("picture", *_MOVING) if goes_on_by_itself(session) else ("picture",)
    looks = {key: value for key, value in told.items() if key not in left_out}
    return told, _name(looks, session)


def _name(looks: object, session: Session) -> int:
    stands = (session.part.number, session.phase, session.next_episode)
    digest = hashlib.blake2b(msgspec.json.encode((looks, stands)), digest_size=8).digest()
    return int.from_bytes(digest, "little") & _NAME_BITS


def goes_on_by_itself(session: Session) -> bool:
    """Whether the page moves what is on the screen: an episode that is played or gone through, two films."""
    return session.play is not None or isinstance(session.screen, PairScreen | FilmScreen)


def inputs_of(session: Session) -> Iterator[str]:
    """What somebody may well do next, the likeliest first, as the page says it: "key:enter", "point:go_on", "tick"."""
    screen: Screen = session.screen
    if session.next_tick_ns is not None:
        yield _TICK
    match screen:
        case TextScreen(keys=keys) if keys:
            yield from (f"key:{key}" for key, pressed in keys if not pressed)
        case TextScreen() if screen.prompt:
            yield "key:enter"
        case PageScreen(buttons=buttons):
            yield from ("key:enter", "point:go_on", "key:right", "key:left")
            yield from (f"point:{button.name}" for button in buttons if button.name == "back")
        case QuestionScreen(item=item, buttons=buttons):
            yield from ("key:enter", "key:tab", "point:go_on")
            yield from _answers(item)
            yield from (one for button in buttons if button.name == "back" for one in ("key:page_up", "point:back"))


def _answers(item: object) -> Iterator[str]:
    match item:
        case Choices(options=options) | Scale(points=options):
            for number in range(min(9, len(options))):
                yield f"key:{number + 1}"
                yield f"point:option:{number}"
            yield from ("key:down", "key:up") if isinstance(item, Choices) else ("key:right", "key:left")
        case Entry():
            return


def _let_be_seen(session: Session) -> tuple[int, int]:
    """Let the screen be shown; when that was, and when somebody may act on it."""
    flip_ns = session.now_ns + _FLIP_NS
    if isinstance(session.screen, BlankScreen | TextScreen | PlayScreen):
        session.receive(Shown(flip_ns, flip_ns, flip_ns))
    return flip_ns, flip_ns + _LOOK_NS


def _input(said: str, at_ns: int) -> Input:
    kind, _, what = said.partition(":")
    match kind:
        case "key":
            return KeyDown(at_ns, what, "")
        case "point":
            return PointerPressed(at_ns, 0.5, 0.5, what, 0.5)
    return Tick(at_ns)
