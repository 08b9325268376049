"""A seat on a server: its recorder, the streams, and whichever socket is the newest. Knows asyncio and the disk."""

import asyncio
import logging
import secrets
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from minihuman.errors import LogError
from minihuman.lab.seal import note_end
from minihuman.lab.shelf import ShelfError
from minihuman.seats.desk import Desk
from minihuman.study.inputs import Asked, Stop
from minihuman.web import wire
from minihuman.web.arrivals import Seated
from minihuman.web.codes import CODES
from minihuman.web.said import said
from minihuman.web.seat import Seat
from minihuman.web.seating import Made
from minihuman.web.stream import Hearing

LOG = logging.getLogger("minihuman")
_AHEAD_NS = 5_000_000_000  # a page's clock may be so far before ours, and a thousandth more with time


class Place:
    """One participant's.

    Args:
        seated: who it is.
        made: their seat.
        desk: where the experimenter asks for something.
    """

    def __init__(self, seated: Seated, made: Made, desk: Desk) -> None:
        self.key = seated.key
        self.seated = seated
        self.segment = made.segment
        self.seat: Seat = made.seat
        self.changed = asyncio.Event()  # there is something to send
        self.finishing = False
        self.delayed = False  # its end is, since the register is away
        self.finished = False  # its log is on the disk, or never will be
        self.seen_s = time.monotonic()  # when a socket was here last
        self.acted_s = self.seen_s  # when something was pressed last
        self.sockets = 0  # so many have been here: the newest counts
        self.here = False  # the newest is open
        self.life = ""
        self.blind = False  # what keys lead to cannot be found out
        self.broken = False  # something of its log is lost
        self._made = made
        self._desk = desk
        self._closed = False  # its log is
        self._zero_ns = time.monotonic_ns() - (time.time_ns() - made.started_ns)
        self._hearing = Hearing()
        self._stream = ""
        self.loop = asyncio.get_running_loop()
        self.path: Path | None = None
        self.over: wire.Over | None = None  # what the page is told at last

    @property
    def agreed(self) -> bool:
        """Whether anything is recorded."""
        return self._made.agreed

    def gone(self, number: int) -> None:
        """A socket is closed."""
        self.here = self.here and number != self.sockets

    def forget(self) -> None:
        """Keep nothing for the page: it begins anew when it comes again."""
        self.life = ""
        self.seat.begin_again()

    def now_ns(self) -> int:
        """The session's time, by the server's clock."""
        return time.monotonic_ns() - self._zero_ns

    def greet(self, hello: wire.Hello) -> tuple[wire.Welcome, int]:
        """A page is here, on a new socket: the answer, and after which of our messages to go on."""
        self.sockets += 1
        self.here = True
        self.seen_s = time.monotonic()
        if hello.stream != self._stream:
            self._stream, self._hearing = hello.stream, Hearing(hello.first - 1)
        again = bool(self.life) and hello.life == self.life and hello.heard <= self.seat.saying.said
        if again:
            self.seat.saying.heard(hello.heard)
        else:
            self.life = secrets.token_hex(4)
            self.seat.begin_again()
            if self.over is not None:
                self.seat.saying.say(self.over)
        now_ns = max(self.now_ns(), self.seat.last_at_ns + 1)
        words = said(self.seat.session.plan.language)
        welcome = wire.Welcome(
            segment=self.segment,
            life=self.life,
            again=again,
            heard=self._hearing.heard,
            now=now_ns,
            keys=dict(CODES),
            token=self.seated.token,
            words=words,
            taken=self.seat.last_at_ns,
        )
        return welcome, hello.heard if again else 0

    def take(self, numbered: wire.Numbered) -> None:
        """Take a message of the page's stream. A log that cannot be written ends the session.

        Raises:
            WireError: if it is out of order, or of another time.
        """
        if not self._hearing.take(numbered.n):
            return
        now_ns = self.now_ns()
        if numbered.at > now_ns + _AHEAD_NS + now_ns // 1000:
            raise wire.WireError(f"message {numbered.n} is of {numbered.at} ns; it is {now_ns} ns")
        if self.seat.over:
            return
        if isinstance(numbered.what, wire.Key | wire.Point | wire.Type):
            self.acted_s = time.monotonic()
        self._guarded(lambda: self.seat.receive(numbered.n, numbered.at, numbered.what))
        self.changed.set()

    def poll(self) -> bool:
        """See whether a learner has made something; True if there is something to tell the page."""
        if not self.seat.has_agent:
            return False
        found = False

        def look() -> None:
            nonlocal found
            found = self.seat.poll()

        self._guarded(look)
        if found:
            self.changed.set()
        return found

    def grow(self) -> bool:
        """Look one scene further ahead; False if nothing is left. Where that fails the session goes on without."""
        if self.blind:
            return False
        try:
            return self.seat.grow()
        except Exception:  # a bug of ours or of a world's: keys wait for the line, here alone
            LOG.exception("nothing is looked for ahead of a session any more")
            self.blind = True
            return False

    def tell_found(self) -> None:
        """Tell the page what was found ahead."""
        self.seat.tell_found()
        self.changed.set()

    def look_at_desk(self) -> None:
        """Hand on what the experimenter asks for: to the page, or at once where there is none."""
        for request in self._desk.asked():
            if self.here:
                self.seat.ask(request.what, request.text)
            else:
                asked = Asked(max(self.now_ns(), self.seat.last_at_ns + 1), request.what, request.text)
                self._guarded(lambda asked=asked: self.seat.stop(asked))  # type: ignore[misc]
            self.changed.set()

    def stop(self, reason: str, detail: str) -> None:
        """End the session from outside."""
        at_ns = max(self.now_ns(), self.seat.last_at_ns + 1)
        self._guarded(lambda: self.seat.stop(Stop(at_ns, reason, detail)))  # type: ignore[arg-type]
        self.changed.set()

    def _guarded(self, do: Callable[[], None]) -> None:
        try:
            do()
        except LogError as error:
            self.seat.session.receive(Stop(self.seat.last_at_ns, "disk_full", str(error)))
        except wire.WireError:
            raise
        except Exception as error:  # a bug of ours: this session ends and says so, the others go on
            LOG.exception("a session failed")
            stop = Stop(self.seat.last_at_ns, "internal_error", f"{type(error).__name__}: {error}")
            with suppress(Exception):
                self.seat.stop(stop)

    def finish(self) -> None:
        """Finish the log and seal it; blocks for the disk. After an ``OSError`` it can be called again.

        Raises:
            OSError: if the register cannot be written; the log is whole.
        """
        if not self._closed:
            self._closed = True
            try:
                self.path = self._made.recorder.close()
            except LogError:
                self.broken = True
            finally:
                self.seat.let_go()
        if self.path is not None:
            _noted(self.path)
        self.finished = True

    def leave(self) -> None:
        """Make it durable and go: the next server goes on with it. Blocks for the disk."""
        if not self._closed:
            self.seat.let_go()
            for file in self._made.files:
                file.leave()


def _noted(log: Path) -> None:
    """Seal it, and put it on the shelf. Neither costs anybody their code, as the log is here."""
    try:
        note_end(log)
    except ShelfError as error:
        LOG.warning("%s; `minihuman gather` puts it there later", error)
    except LogError as error:
        LOG.warning("%s is whole, but was not sealed: %s", log, error)
