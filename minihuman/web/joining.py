"""How a page comes to its seat: the one that is there, one that a killed server left, or a new one."""

import asyncio
import contextlib
import hashlib
import itertools
import re
import time
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from weakref import WeakValueDictionary

from minihuman.errors import LogError, MinihumanError
from minihuman.log.paths import LOG_SUFFIX, session_folder
from minihuman.log.record.claim import is_live
from minihuman.log.record.rounds import Rounds
from minihuman.seats.desk import Desk, requests_path
from minihuman.study.events import SETTLED
from minihuman.web import wire
from minihuman.web.arrivals import Arrival, Arrivals, Refused, Seated
from minihuman.web.ending import end_of, ending
from minihuman.web.facts import browser_facts
from minihuman.web.place import Place
from minihuman.web.said import said
from minihuman.web.screening import Door, misfit
from minihuman.web.seating import Disk, Made, begin, go_on
from minihuman.web.telling import Settings

_FOR_GOOD = ("browser", "keyboard", "line")  # who does not fit so goes back with a code; a window can be made larger
_SIZE = re.compile(r"(\d{1,5}) x (\d{1,5})")


@dataclass(frozen=True, slots=True)
class Turned:
    """Somebody who does not come in, and what the page says of it."""

    reason: str
    words: str


class Joining:
    """Seats people.

    Args:
        arrivals: the study, and who comes.
        data: where sessions are kept.
        places: the seats there are; new ones are put in.
    """

    def __init__(self, arrivals: Arrivals, data: Path, places: dict[str, Place]) -> None:
        self.facts: Mapping[str, str] = {}  # of this machine
        self._arrivals, self._data, self._places = arrivals, data, places
        self._disk = Disk(arrivals.protocol, data, Rounds())
        self._wakes = _Wakes()
        web = arrivals.protocol.web
        self._web = web
        self._settings = Settings(web.picture_px, web.encoding)
        self._words = said(arrivals.protocol.study.language)
        self._apart = itertools.count(1)
        self._seats: dict[bytes, str] = {}  # by a digest of what somebody came with
        self._turns: WeakValueDictionary[bytes, asyncio.Lock] = WeakValueDictionary()  # while somebody waits

    async def place(self, hello: wire.Hello) -> Place | Turned:
        """The seat of whoever says hello."""
        if hello.version != wire.VERSION:
            return Turned("old", self._words["busy"])  # it is loaded again by itself
        if reason := misfit(self._web, _door(hello.facts)):
            return self._turned(reason)
        came_with = hashlib.sha256(repr((hello.token, sorted(hello.platform.items()))).encode()).digest()
        turn = self._turns.setdefault(came_with, asyncio.Lock())
        async with turn:
            there = self._places.get(self._seats.get(came_with, ""))
            if there is not None:
                return there
            if len(self._places) >= self._web.most_at_once:
                return self._turned("busy")
            place = await self._seated(hello)
            if isinstance(place, Place):
                self._seats[came_with] = place.key
            return place

    def set_apart(self, place: Place) -> None:
        """Keep a seat for its own page alone: the participant's code is free, and the next who gets it is another."""
        if place.key != place.seated.key:  # it was, and its end is tried again
            return
        del self._places[place.key]
        own = f"{place.key} left {next(self._apart)}"
        self._seats = {came: own if key == place.key else key for came, key in self._seats.items()}
        place.key = own
        self._places[own] = place

    async def _seated(self, hello: wire.Hello) -> Place | Turned:
        seated = await asyncio.to_thread(self._arrivals.arrive, Arrival(hello.token, hello.platform))
        if isinstance(seated, Refused):
            return self._refused(seated)
        if seated.key in self._places:
            return self._places[seated.key]
        facts = {**self.facts, **browser_facts(hello.facts)}
        facts["picture_px"] = "{} x {}".format(*self._settings.picture_px)
        facts["picture_encoding"] = self._settings.encoding
        wake = _Wake(self._wakes)
        try:
            made = await asyncio.to_thread(self._made, seated, facts, wake)
        except (MinihumanError, OSError):
            return self._turned("broken")
        place = wake.place = self._places[seated.key] = Place(seated, made, self._desk(seated))
        return place

    def _made(self, seated: Seated, facts: dict[str, str], wake: "_Wake") -> Made:
        """A seat; blocks for the disk."""
        if seated.part is not None:
            if is_live(seated.part):
                raise LogError(f"{seated.part} is being written by another server")
            with contextlib.suppress(LogError, FileNotFoundError):
                if time.time() - seated.part.stat().st_mtime <= self._web.grace_s:
                    return go_on(seated.part, self._disk, facts, self._settings, at_sync=wake)
        plan = seated.plan or self._arrivals.plan(seated)
        return begin(plan, self._disk, facts, self._settings, at_sync=wake)

    def _desk(self, seated: Seated) -> Desk:
        """Where the experimenter asks for something."""
        folder = session_folder(self._data, self._arrivals.protocol.study.name, seated.participant, seated.session)
        return Desk(requests_path(folder / f"{seated.participant}_ses-{seated.session:02d}{LOG_SUFFIX}"))

    def _refused(self, refused: Refused) -> Turned:
        """Whoever has taken part and comes again gets the code again."""
        if not refused.ended:
            return self._turned(refused.reason)
        end = end_of("complete" if refused.ended not in SETTLED else refused.ended, agreed=True)  # type: ignore[arg-type]
        code, words = ending(self._web, end).code, self._words[end]
        return Turned(end, f"{words} {self._words['code']}: {code}" if code else words)

    def _turned(self, reason: str) -> Turned:
        width, height = self._web.min_window_px
        fields = {"browsers": ", ".join(self._web.browsers), "width": width, "height": height}
        words = self._words[reason].format(**fields)
        code = self._web.codes.screened_out
        return Turned(reason, f"{words} {self._words['code']}: {code}" if code and reason in _FOR_GOOD else words)


class _Wakes:
    """Tells places that something of theirs is durable: the loop is called once for all that it has not seen to yet."""

    def __init__(self) -> None:
        self._woken: deque[Place] = deque()
        self._called = False

    def wake(self, place: Place) -> None:
        """Something became durable; called by the log's thread."""
        self._woken.append(place)
        if not self._called:
            self._called = True
            with contextlib.suppress(RuntimeError):  # the loop is closed: nobody is there to be told
                place.loop.call_soon_threadsafe(self._tell)

    def _tell(self) -> None:
        self._called = False
        while self._woken:
            self._woken.popleft().changed.set()


class _Wake:
    """Tells one place; its recorder is made before it is."""

    def __init__(self, wakes: _Wakes) -> None:
        self.place: Place | None = None
        self._wakes = wakes

    def __call__(self) -> None:
        if self.place is not None:
            self._wakes.wake(self.place)


def _door(facts: Mapping[str, bool | float | str]) -> Door:
    """What a page's facts say of who is at the door."""
    family = str(facts.get("browser", "other")).lower()
    size = _SIZE.fullmatch(str(facts.get("window_px", "")))
    known = next((name for name in ("chrome", "edge", "firefox", "safari") if name in family), "other")
    if "chromium" in family:
        known = "chrome"
    rtt = facts.get("rtt_ms")
    return Door(
        browser=known,
        window_px=(int(size[1]), int(size[2])) if size else (0, 0),
        rtt_ms=float(rtt) if isinstance(rtt, int | float) else None,
        keyboard=facts.get("mouse") is not False or facts.get("touch") is not True,
    )
