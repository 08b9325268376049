"""A participant's connection: the session, its recording, and the page. This module uses asyncio and the disk.

The parts do without asyncio: `page_protocol` decides which streams resume, `page_presence` whether the page is here,
`session_clocks` keeps the session's time, and `hosted_session` finishes the log.
"""

import asyncio
import logging
import secrets
from collections.abc import Callable, Iterable
from concurrent.futures import Executor
from contextlib import suppress
from typing import Any, TypeVar

from minihuman.errors import LogError, WorldError
from minihuman.experiment.machine.inputs import ExperimenterCommand, Stop
from minihuman.experiment.plan.session_plan import needs_gamepad
from minihuman.experiment.plan.trials import list_sound_digests
from minihuman.experiment.words import InterfaceWords
from minihuman.log.record.session_leases import Lease, SessionLeases
from minihuman.runtime.session_loop import CommandInbox
from minihuman.storage.system import current_system, monotonic_s
from minihuman.web import messages
from minihuman.web.arrivals import Admission
from minihuman.web.eligibility import get_page_texts, list_touch_keys
from minihuman.web.hosted_session import HostedSession, SessionRecording
from minihuman.web.key_codes import KEY_CODES
from minihuman.web.page_presence import PagePresence, find_sign_interval_ms
from minihuman.web.page_protocol import PageProtocol, PageSession, ServerMessages, StreamNames
from minihuman.web.session_budget import SessionBudget
from minihuman.web.session_clocks import SegmentClock
from minihuman.worlds.adapters.foreign_code import WorldCodeError
from minihuman.worlds.source_digest import kernels_digest

LOG = logging.getLogger("minihuman")
T = TypeVar("T")
_ACTS = (
    messages.KeyMessage,
    messages.PointerMessage,
    messages.TextMessage,
    messages.FieldMessage,
    messages.AxisMessage,
    messages.MouseMotionMessage,
)  # messages that show that the participant does something


class Connection(PageSession):
    """Connects one participant's page with their session.

    Args:
        admission: the participant's admission.
        hosted: the participant's session.
        inbox: the experimenter's commands.
        leases: this server's session leases; None if no other machine serves this study.
        max_outage_s: the longest time for which a session taken over from another server may have had no server.
        threads: the threads in which the session runs, as its worlds may keep it waiting; None to run it in the
            server's loop.
    """

    def __init__(
        self,
        admission: Admission,
        hosted: HostedSession,
        inbox: CommandInbox,
        leases: SessionLeases | None = None,
        *,
        max_outage_s: float = 0.0,
        threads: Executor | None = None,
    ) -> None:
        self.key = admission.key
        self.admission = admission
        self.hosted = hosted
        self.host = hosted.host
        self.lease: Lease | None = None
        if leases is not None:
            self.lease = admission.lease
        self.recording = SessionRecording(hosted, self.lease, leases)
        self.presence = PagePresence(monotonic_s(), hosted.signs)
        self.loop = asyncio.get_running_loop()
        self._threads = threads
        self._turn = asyncio.Lock()  # one thread at a time
        self._polling: asyncio.Task[Any] | None = None
        self.changed = asyncio.Event()  # set if there is something to send
        self.network = ""  # from which it was made, in memory only
        self.over: messages.SessionOver | None = None  # the last message to the page
        self.transport: messages.TransportName = "websocket"  # of the newest page
        self._inbox = inbox
        self._streams = StreamNames()
        self._is_blind = False  # whether looking ahead has failed
        self._clock = _start_clock(hosted, max_outage_s)
        self._budget = SessionBudget(hosted.host.session.plan)
        self.is_over_budget = False  # the page sent more than its session can need, and the session was ended

    @property
    def outgoing(self) -> ServerMessages:
        """Return the stream of messages to the page; a restart replaces it."""
        return self.host.outbox.outgoing

    @property
    def agreed(self) -> bool:
        """Return whether anything is recorded, because the participant consented or the study asks for no consent."""
        return bool(self.hosted.files)

    @property
    def has_taken_part(self) -> bool:
        """Return whether the participant made a step or, in a study without episodes, whether they agreed."""
        return self.host.has_stepped or (self.agreed and not self.host.session.plan.episodes)

    @property
    def is_unproven(self) -> bool:
        """Return whether a participant came without one of the study's links, and has not taken part yet."""
        return bool(self.network) and not self.has_taken_part

    @property
    def has_lease(self) -> bool:
        """Return whether the session has a lease that is not lost, and its recording is not finished."""
        return self.lease is not None and not self.lease.lost and not self.recording.is_finished

    def now_ns(self) -> int:
        """Return the session's time in nanoseconds, by the server's clock."""
        return self._clock.at(current_system().clock.monotonic_ns())

    def _make_input_time_ns(self) -> int:
        """Return the session's time for an input from outside the page: now, but after the page's last message."""
        return max(self.now_ns(), self.host.last_at_ns + 1)

    # Threads

    @property
    def has_threads(self) -> bool:
        """Return whether the session's work is done in threads, because its worlds may keep it waiting."""
        return self._threads is not None

    @property
    def is_busy(self) -> bool:
        """Return whether a thread is at work on the session, so that no other code may read it."""
        return self._turn.locked()

    async def run(self, work: Callable[..., T], *arguments: Any) -> T:
        """Call a function that works on the session, and return its result.

        If the session's worlds may keep it waiting, the call runs in a thread, after the calls before it. The work is
        finished even if the task that awaits it is cancelled.
        """
        if self._threads is None:
            return work(*arguments)
        return await asyncio.shield(self._run_in_turn(self._threads, work, arguments))

    async def _run_in_turn(self, threads: Executor, work: Callable[..., T], arguments: tuple[Any, ...]) -> T:
        """Call a function in a thread once no other thread works on the session; return its result."""
        async with self._turn:
            return await self.loop.run_in_executor(threads, work, *arguments)

    async def take_batches(self, protocol: PageProtocol) -> Iterable[bytes]:
        """Return the pending messages to the page in batches, once no thread works on the session."""
        if self._threads is None:
            return protocol.take_batches()
        async with self._turn:
            return list(protocol.take_batches())

    def poll_soon(self) -> None:
        """Poll the session from the loop, or in a thread if the session runs in one."""
        if self._threads is None:
            self.poll()
        else:
            self._polling = self.loop.create_task(self.run(self.poll))

    def _wake_sender(self) -> None:
        """Wake the task that sends to the page, from the loop or from the session's thread."""
        if self._threads is None:
            self.changed.set()
        else:
            self.loop.call_soon_threadsafe(self.changed.set)

    # The page

    def greet(
        self, hello: messages.Hello, transport: messages.TransportName = "websocket"
    ) -> tuple[messages.Welcome, int, int]:
        """Welcome a page on a new socket or another transport, and resume or restart the streams of messages.

        Returns:
            The answer, the socket's number, and the number of the last message of the server's stream that the page
            has; 0 if that stream begins anew.
        """
        socket_number = self.presence.open_socket(monotonic_s())
        if transport != self.transport:  # noted, since the log's fact is the transport at the segment's start
            self.transport = transport
            self.host.note(f"the page speaks by {transport} from here on")
        if transport == "http":
            self.host.link.rtt_ns = None  # it was measured on another transport, perhaps in another network
        if self._streams.receive_stream(hello.stream, hello.first):
            self.host.begin_stream(hello.first - 1)
        if hello.segment == self.hosted.segment:
            self._catch_up_with_page(hello.last)
        if self._streams.resumes(hello.life, hello.heard, self.outgoing):
            self.outgoing.acknowledge(hello.heard)
            return self._build_welcome(resumes=True), socket_number, hello.heard
        self._streams.life = secrets.token_hex(4)
        self.host.restart(computes=bool(hello.kernels) and hello.kernels == kernels_digest())
        if self.over is not None:
            self.outgoing.add(self.over)
        return self._build_welcome(resumes=False), socket_number, 0

    def _catch_up_with_page(self, page_ns: int) -> None:
        """Advance the session's clock to a page's last time, since the page's clock ran on while there was no server.

        If the page's time, in nanoseconds on the session's clock, is not plausible, the segment gets a new name.
        """
        clock = current_system().clock
        ahead_ns = page_ns - self.now_ns()
        note = self._clock.catch_up(ahead_ns, wall_ns=clock.wall_ns(), monotonic_ns=clock.monotonic_ns())
        self.host.note(note)
        if not self._clock.allows(page_ns, self.now_ns()):
            # a new name, so that the page discards the messages it has kept, which would all be refused
            self.hosted.segment = secrets.token_hex(8)

    def _build_welcome(self, *, resumes: bool) -> messages.Welcome:
        """Build the answer to a hello, which says from where both streams of messages continue.

        Args:
            resumes: whether the page continues with the server's stream, rather than with a new one.
        """
        plan = self.host.session.plan
        quit_text = {"quit_title": InterfaceWords(plan.language, plan.words)["quit.title"]}
        return messages.Welcome(
            segment=self.hosted.segment,
            life=self._streams.life,
            again=resumes,
            heard=self._streams.incoming.received,
            now=self._make_input_time_ns(),
            keys=dict(KEY_CODES),
            touch=list_touch_keys(plan),
            gamepad=needs_gamepad(plan),
            sign_ms=find_sign_interval_ms(plan),
            token=self.admission.token,
            words=get_page_texts(plan.language) | quit_text,
            taken=self.host.last_at_ns,
            sounds=list_sound_digests(plan),
        )

    def is_too_slow(self) -> bool:
        """Return whether a round trip over HTTP takes longer than a step of the real-time episode being played.

        An episode that the page computes waits for no round trip. A page with a socket is never too slow: the
        protocol admitted its latency.
        """
        rtt_ns = self.host.link.rtt_ns
        if self.transport != "http" or rtt_ns is None or self.host.over:
            return False
        play = self.host.session.play
        if play is None or not play.real_time or self.host.outbox.is_computed:
            return False
        rtt_ms = rtt_ns / 1e6
        return rtt_ms > play.plan.step_period_ms

    def hear(self, now_s: float) -> None:
        """Record that the page is alive at a monotonic time in seconds."""
        self.presence.hear(now_s)

    def record_act(self) -> None:
        """Record that the participant is typing a text that the page has not sent yet."""
        self.presence.record_act(monotonic_s())

    def bid_farewell(self, *, is_left: bool) -> None:
        """Record that the page was closed, or that the participant left it for another page."""
        self.presence.bid_farewell(monotonic_s(), is_left=is_left)

    def spend(self, n_bytes: int, *, number: int, is_text: bool = False) -> bool:
        """Count the size of a message against the session's budget; end the session of a page that sends too much.

        Args:
            n_bytes: the size of the message.
            number: its number; one that was received before costs nothing.
            is_text: whether it holds what was typed.

        Returns:
            Whether the message is within the budget; always False once the session has been ended for its budget.
        """
        if self.is_over_budget:
            return False
        if number <= self._streams.incoming.received:
            return True
        if self._budget.spend(n_bytes, self.now_ns, is_text=is_text):
            return True
        self.is_over_budget = True
        limit_bytes = self._budget.find_limit_bytes(self.now_ns())
        self.stop("aborted", f"the page sent more than the {limit_bytes} bytes that this session can need by now")
        return False

    def forget(self) -> None:
        """Discard the messages kept for the page, so that it starts afresh when it reconnects."""
        self._streams.life = ""
        self.host.restart()

    def dismiss(self, code: int) -> None:
        """Disconnect the page with a socket's closing code, because this server no longer hosts the session."""
        self.presence.dismiss(code)
        self.changed.set()

    def safe(self) -> int:
        """Return the number of the last message of the page that may be acknowledged, as no crash can lose it."""
        if self.lease is None:
            return self.host.safe()
        return self.host.safe(self.lease.count_acknowledgeable(monotonic_s()))

    def count_unsaved(self) -> int:
        """Return the number of the page's messages that were received but may not be on the disk yet."""
        return max(0, self.host.outbox.through - self.safe())

    def take(self, numbered: messages.NumberedMessage, *, more: bool = False) -> None:
        """Handle a numbered message of the page's stream. If the log cannot be written, the session ends.

        Args:
            numbered: the message.
            more: whether further messages arrived with this one.

        Raises:
            MessageError: if the message is out of order, or its time is not plausible.
        """
        incoming = self._streams.incoming
        received = incoming.received
        if self.presence.dismissal_code or not incoming.take(numbered.n):
            return
        try:
            self._take_new(numbered, more=more)
        except messages.MessageError:
            incoming.received = received  # it was refused, so that the page must not hear that it was taken
            raise

    def _take_new(self, numbered: messages.NumberedMessage, *, more: bool) -> None:
        """Give the session a message that was not received before; the arguments are those of ``take``."""
        arrival_ns = current_system().clock.monotonic_ns()
        note = self._clock.check(numbered.n, numbered.at, self._clock.at(arrival_ns))
        if note:
            self.host.note(note)
        if self.host.over:
            return
        if isinstance(numbered.what, _ACTS):
            self.presence.record_act(arrival_ns / 1e9)
        elif isinstance(numbered.what, messages.FocusMessage):
            self.presence.turn_focus(arrival_ns / 1e9, has_focus=numbered.what.focused)
        is_step = self._call_or_end(
            self.host.receive, numbered.n, numbered.at, numbered.what, more=more, arrival_ns=arrival_ns
        )
        if is_step and self.host.outbox.looks_ahead:
            self.host.outbox.record_step_time(current_system().clock.monotonic_ns() - arrival_ns)

    # What does not come from the page

    def hear_from_disk(self) -> None:
        """Wake the sender to acknowledge messages that became durable; end the session if its log cannot be written.

        A page that waits for an acknowledgement may send nothing, so it would not learn of the failure otherwise.
        """
        self.changed.set()
        if not self.hosted.is_log_broken:
            return
        if self._threads is None:
            self._end_without_log()
        else:
            self._polling = self.loop.create_task(self.run(self._end_without_log))

    def _end_without_log(self) -> None:
        """End the session because a write to its log failed."""
        if not self.host.over:
            self._call_or_end(self.hosted.require_log)
        self._wake_sender()

    def poll(self) -> bool:
        """Check whether an agent or a participant has answered a request; return True if there is news for the page."""
        has_news = bool(self._call_or_end(self.host.poll))
        if has_news:
            self._wake_sender()
        return has_news

    def grow(self) -> bool:
        """Explore one more scene ahead of the session; return False if none is left or looking ahead has failed."""
        if self._is_blind:
            return False
        try:
            return self.host.grow()
        except Exception:  # a bug of ours or of a world's: this page alone waits for the network
            LOG.exception("nothing is looked for ahead of a session any more")
            self._is_blind = True
            return False

    def send_prefetched(self) -> None:
        """Send the page the scenes and screens that were found ahead."""
        self.host.outbox.send_prefetched()
        self._wake_sender()

    def read_inbox(self) -> None:
        """Pass the experimenter's commands to the page, or carry them out at once if no page is connected."""
        for request in self._inbox.read_new():
            if self.presence.is_here:
                self.host.ask(request.what, request.text)
            else:
                command = ExperimenterCommand(self._make_input_time_ns(), request.what, request.text)
                self._call_or_end(self.host.stop, command)
            self._wake_sender()

    def stop(self, reason: str, detail: str) -> None:
        """End the session for a reason outside the page: one of ``Stop``'s reasons, with a detail for the log."""
        self._call_or_end(self.host.stop, Stop(self._make_input_time_ns(), reason, detail))  # type: ignore[arg-type]
        self._wake_sender()

    def _call_or_end(self, function: Callable[..., bool | None], *arguments: object, **options: object) -> bool | None:
        """Call a function that works on the session; if it fails, end the session with the reason and return None.

        Raises:
            MessageError: as the function does; the session goes on.
        """
        try:
            return function(*arguments, **options)
        except LogError as error:
            self.host.session.receive(Stop(self.host.last_at_ns, "disk_full", str(error)))
        except messages.MessageError:
            raise
        except WorldError as error:  # of a picture for the page, which the session itself does not draw
            log_text = str(error)
            if isinstance(error, WorldCodeError):
                log_text = error.log_text
            self.host.stop(Stop(self.host.last_at_ns, "world_error", log_text))
        except Exception as error:  # a bug of ours: this session ends, the others go on
            LOG.exception("a session failed")
            stop = Stop(self.host.last_at_ns, "internal_error", f"{type(error).__name__}: {error}")
            with suppress(Exception):
                self.host.stop(stop)
        return None

    # Its end

    def finish(self) -> None:
        """Finish and seal the log, waiting for the disk. After an ``OSError`` this can be called again.

        Raises:
            LeaseLostError: if another server has the session, so that it did not end here.
            OSError: if the enrolment log, the lease or the log cannot be written where other servers have them.
        """
        self.recording.finish()

    def leave(self) -> None:
        """Make the log durable and stop hosting the session, which the next server resumes. This waits for the disk."""
        self.recording.leave(is_dismissed=bool(self.presence.dismissal_code))


def _start_clock(hosted: HostedSession, max_outage_s: float) -> SegmentClock:
    """Return a clock that shows the time since a session's start by the wall clock, but at least the last logged time.

    The wall clock may have been set back since the session began.

    Args:
        hosted: the session.
        max_outage_s: the longest time for which the session may have had no server, in seconds.
    """
    clock = current_system().clock
    wall_ns = clock.wall_ns()
    monotonic_ns = clock.monotonic_ns()
    logged_ns = hosted.host.last_at_ns
    since_start_ns = max(wall_ns - hosted.started_ns, logged_ns)
    # before the consent there is no log, so a session that is taken over then seems to start only now
    latest_ns = logged_ns + round(max_outage_s * 1e9)
    return SegmentClock(
        monotonic_ns - since_start_ns,
        wall_ns=wall_ns,
        monotonic_ns=monotonic_ns,
        outage_ns=max(0, latest_ns - since_start_ns),
    )
