"""The server: one page, one socket a browser, a task each; the session's own work is a seat's.

What blocks for the disk (joins, finishing a log) runs in threads. Looking ahead is done between messages, for one seat
after the other, a few scenes at a time, so that a key never waits for more than two milliseconds or one scene.
"""

import asyncio
import contextlib
import logging
import time
from collections import deque
from collections.abc import AsyncIterator, Sequence
from pathlib import Path

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Route, WebSocketRoute
from starlette.types import ASGIApp
from starlette.websockets import WebSocket

from minihuman.seats.machine import machine_facts, world_facts
from minihuman.web import wire
from minihuman.web.arrivals import Arrivals
from minihuman.web.ending import end_of, ending
from minihuman.web.guard import HELLO_S, KEPT, MAX_KEPT, MAX_WAITING, Allowance, is_ours
from minihuman.web.headers import Guarded
from minihuman.web.joining import Joining, Turned
from minihuman.web.line import Line, LineError
from minihuman.web.page_files import page_routes
from minihuman.web.place import Place
from minihuman.web.said import said

LOG = logging.getLogger("minihuman")
KEPT_S = 600.0  # a seat whose session is over, for pages that come again
LOOK_S = 1.0
POLL_S = 0.1
GROW_S = 0.01  # so long what lies ahead of a seat is looked for before the page is told of it, and others have a turn
TURN_S = 0.002  # and so long before messages have one
TOGETHER_BYTES = 65_536  # of messages that go over the line as one
# Codes of a closed socket after which the page does not come again by itself.
ANOTHER, REFUSED, FOREIGN = 4001, 4003, 4004
BUSY = 4100  # the page tries again in a while
OLD = 4002  # and after this it is loaded anew: it is of another release than the server


class Server:
    """A study, served.

    Args:
        arrivals: the study, and who comes.
        data: where sessions are kept.
        routes: of other pages that this server has.
    """

    def __init__(self, arrivals: Arrivals, data: Path, *, routes: Sequence[BaseRoute] = ()) -> None:
        self.places: dict[str, Place] = {}
        self._arrivals = arrivals
        self._web = arrivals.protocol.web
        self._joining = Joining(arrivals, data, self.places)
        self._routes = routes
        self._waiting = 0  # sockets that have not said who they are, or are being seated
        self._growing: deque[Place] = deque()
        self._to_grow = asyncio.Event()

    def app(self) -> ASGIApp:
        """The application."""
        routes = [
            *page_routes(),
            Route("/favicon.ico", _no_icon),
            WebSocketRoute("/socket", self._socket),
            *self._routes,
        ]
        return Guarded(Starlette(routes=routes, lifespan=self._lifespan))

    @contextlib.asynccontextmanager
    async def _lifespan(self, _: Starlette) -> AsyncIterator[None]:
        worlds = world_facts(block.world for block in self._arrivals.protocol.blocks)
        self._joining.facts = {"player": "human", **await asyncio.to_thread(machine_facts), **worlds}
        tasks = [asyncio.create_task(work()) for work in (self._grow, self._look_after, self._poll)]
        try:
            yield
        finally:
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)
            await asyncio.gather(*(asyncio.to_thread(place.leave) for place in self.places.values()))

    # A socket

    async def _socket(self, socket: WebSocket) -> None:
        line = Line(socket)
        if not is_ours(socket.headers.get("origin"), socket.headers.get("host")):
            await line.close(FOREIGN)
            return
        if self._waiting >= MAX_WAITING:
            await line.close(BUSY)
            return
        try:
            await line.accept()
            hello, place = await self._welcomed(line)
            if isinstance(place, Turned):
                await line.say(wire.plain(wire.Refused(place.reason, place.words)))
                await line.close(OLD if place.reason == "old" else REFUSED)
                return
            await self._serve(line, place, hello)
        except LineError:
            return
        except TimeoutError:
            await line.close(REFUSED, "a page says hello at once")
        except wire.WireError as error:
            await line.close(REFUSED, str(error))

    async def _welcomed(self, line: Line) -> tuple[wire.Hello, Place | Turned]:
        """Who is there, and their seat."""
        self._waiting += 1
        try:
            hello = wire.read(await asyncio.wait_for(line.hear(), HELLO_S))
            if not isinstance(hello, wire.Hello):
                raise wire.WireError("a page says hello first")
            return hello, await self._joining.place(hello)
        finally:
            self._waiting -= 1

    async def _serve(self, line: Line, place: Place, hello: wire.Hello) -> None:
        welcome, after = place.greet(hello)
        number = place.sockets
        place.changed.set()
        self._want_more(place)
        writing = asyncio.create_task(self._write(line, place, number, welcome, after))
        allowance = Allowance(time.monotonic())
        try:
            while place.sockets == number:
                text = await line.hear()
                while not allowance.take(time.monotonic()):
                    await asyncio.sleep(0.1)  # the line waits with it; whoever comes back has a lot to say at once
                await self._hear(line, place, wire.read(text))
        finally:
            writing.cancel()
            place.seen_s = time.monotonic()
            place.gone(number)
            await asyncio.gather(writing, return_exceptions=True)

    async def _hear(
        self, line: Line, place: Place, message: wire.Hello | wire.Numbered | wire.Heard | wire.Ping
    ) -> None:
        match message:
            case wire.Numbered():
                told = place.seat.saying.said
                place.take(message)
                await self._finish_if_over(place)
                if place.seat.saying.kept > MAX_KEPT:
                    place.forget()
                    raise wire.WireError("a page says what it has heard")
                if place.seat.saying.said != told or isinstance(message.what, wire.Link):  # there is more to find
                    self._want_more(place)
            case wire.Heard():
                was_behind = place.seat.saying.kept > KEPT
                place.seat.saying.heard(message.n)
                if was_behind:  # nothing was looked for ahead
                    self._want_more(place)
            case wire.Ping():
                received_ns = place.now_ns()
                await line.say(wire.plain(wire.Pong(message.sent, received_ns, place.now_ns())))
            case wire.Hello():
                raise wire.WireError("a page says hello once")

    async def _write(self, line: Line, place: Place, number: int, welcome: wire.Welcome, after: int) -> None:
        """Send what there is to send, as long as this is the newest socket of its seat."""
        await line.say(wire.plain(welcome))
        sent, acked, saying = after, 0, place.seat.saying
        while True:
            await place.changed.wait()
            place.changed.clear()
            if place.sockets != number or place.seat.saying is not saying:
                place.changed.set()  # for the newest
                await line.close(ANOTHER)
                return
            if place in self._growing and all(_can_wait(message) for _, message in saying.after(sent)):
                continue  # it goes with what is found ahead, in a moment
            safe = place.seat.safe()  # before what is said: who is told that a key is safe has been told where it led
            parts, size = [], 0
            for told, message in saying.after(sent):
                parts.append(wire.numbered(told, message))
                sent, size = told, size + len(parts[-1])
                if size > TOGETHER_BYTES:
                    await line.say(b"".join(parts))
                    parts, size = [], 0
            if safe > acked:
                acked = safe
                parts.append(wire.acked(acked))
            if parts:
                await line.say(b"".join(parts))

    # Ends

    async def _finish_if_over(self, place: Place) -> None:
        """Bring the log of a session that is over to the disk, then say so; later where the register is away."""
        if not place.seat.over or place.finishing:
            return
        place.finishing = True
        try:
            await self._finish(place)
        except OSError as error:
            if not place.delayed:
                LOG.warning("a session is over, and nobody is told so yet: %s", error)
            place.delayed = True
            place.finishing = False  # whoever looks after seats tries again

    async def _finish(self, place: Place) -> None:
        session, seated = place.seat.session, place.seated
        await asyncio.to_thread(place.finish)
        end = end_of(session.end_reason, agreed=place.agreed, part_kind=session.part.part.kind)
        if place.broken:
            end = "broken"
        if not place.agreed:
            why = "declined" if end == "declined" else session.end_reason
            self._joining.set_apart(place)
            await asyncio.to_thread(self._arrivals.decline, seated, why)
        person = await asyncio.to_thread(self._arrivals.id_on_platform, seated.participant)
        found = ending(self._web, end, person=person)
        words = said(session.plan.language)
        place.over = wire.Over(end, words[end], words["code"], found.code, words["leave"], found.url)
        place.seat.saying.say(place.over)
        place.changed.set()

    async def _look_after(self) -> None:
        """End the sessions whose pages do not come back, and forget those that are over."""
        while True:
            await asyncio.sleep(LOOK_S)
            for place in tuple(self.places.values()):
                try:
                    await self._look_after_one(place)
                except Exception:  # one seat's trouble is no other's
                    LOG.exception("a seat could not be looked after")

    async def _look_after_one(self, place: Place) -> None:
        now_s = time.monotonic()
        gone_s = 0.0 if place.here else now_s - place.seen_s
        if not place.seat.over:
            place.look_at_desk()
        if not place.seat.over and gone_s > self._web.grace_s:
            place.stop("connection_lost", "the page did not come back")
        if not place.seat.over and 0 < self._web.idle_s < now_s - place.acted_s:
            place.stop("timed_out", f"nothing was pressed for {self._web.idle_s:g} s")
        await self._finish_if_over(place)
        if place.over is not None and gone_s > KEPT_S:
            del self.places[place.key]
            place.seat.close()

    async def _poll(self) -> None:
        """See to learners that were asked for a policy."""
        while True:
            await asyncio.sleep(POLL_S)
            for place in tuple(self.places.values()):
                if place.poll():
                    self._want_more(place)

    # Looking ahead

    def _want_more(self, place: Place) -> None:
        if place not in self._growing:
            self._growing.append(place)
        self._to_grow.set()

    async def _grow(self) -> None:
        while True:
            if not self._growing:
                self._to_grow.clear()
                await self._to_grow.wait()
            place, began_s = self._growing.popleft(), time.monotonic()
            turn_s = began_s
            while place.here and place.grow():
                now_s = time.monotonic()
                if now_s > began_s + GROW_S:
                    self._want_more(place)
                    break
                if now_s > turn_s + TURN_S:
                    await asyncio.sleep(0)
                    turn_s = time.monotonic()
            place.tell_found()
            await asyncio.sleep(0)


def _can_wait(message: wire.Told | wire.Picture) -> bool:
    """Whether a page that went ahead loses nothing if it hears of a message a little later."""
    return isinstance(message, wire.Now) and message.tick is None and not message.who


async def _no_icon(_: Request) -> Response:
    return Response(status_code=204)
