"""The session host: one participant's session between a page and a log. Messages in, messages out; no socket, no clock.

The page is the only source of inputs, and stamps them; the session alone decides their effect, and what the page showed
in advance is compared with it at every step. The offset between page and server clock comes from the message with the
shortest round trip.
"""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from minihuman.activities.agent_blocks.requests import NewPolicy, PolicyRequest
from minihuman.activities.preferences.requests import ClipRequest
from minihuman.activities.team.episode import TeamEpisode
from minihuman.activities.team.events import PictureCorrected
from minihuman.activities.team.requests import TeamAnswerRequest
from minihuman.experiment.keys import PAD_DEAD_ZONE
from minihuman.experiment.machine import inputs
from minihuman.experiment.machine.activity import RequestHandler, WorldFactory
from minihuman.experiment.machine.events import Event, KeyPressed, Linked, Noted, Stepped
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.pending_session import awaits_allocation
from minihuman.experiment.replay import BROWSER_NOTE
from minihuman.log.record.recorder import Recorder
from minihuman.web import messages
from minihuman.web.messages import OutgoingStream, RoundTripMessage
from minihuman.web.outbox import Outbox, PageSettings

_DRIFT_AFTER_NS = 60_000_000_000  # before, jitter hides the drift
_MAX_DRIFT_NS = 200_000_000  # of the page's clock against the server's: 2 % between two looks, which are 10 s apart
_NEVER_NS = 1 << 62


class PageClock:
    """Takes what the page measured, and says it for the log."""

    def __init__(self) -> None:
        self.rtt_ns: int | None = None  # of the quickest of the latest; None until one was measured
        self._first: tuple[int, int] | None = None  # time and offset of the first
        # of the quickest message: since the last look, before that one, and in the first minute
        self._lag_ns = self._last_lag_ns = self._least_lag_ns = _NEVER_NS

    def arrive(self, at_ns: int, arrival_ns: int) -> None:
        """Take the page's time of a message and the server's when it came: all but the quickest waited on the way."""
        self._lag_ns = min(self._lag_ns, arrival_ns - at_ns)

    def look(self, link: Linked) -> str:
        """How far the page's time has moved against the server's clock, if that is too far; "" if not."""
        lag_ns = min(self._lag_ns, self._last_lag_ns)
        self._last_lag_ns, self._lag_ns = self._lag_ns, _NEVER_NS
        if link.drift_ppm is None:
            self._least_lag_ns = min(self._least_lag_ns, lag_ns)
        drift_ns = self._least_lag_ns - lag_ns
        if abs(drift_ns) <= _MAX_DRIFT_NS + link.error_ns:
            return ""
        self._least_lag_ns = lag_ns
        return f"the page's time moved by {drift_ns / 1e6:+.0f} ms against the times at which its messages came"

    def linked(self, at_ns: int, link: RoundTripMessage) -> Linked:
        """An event for the log.

        Args:
            at_ns: the session's time.
            link: the quickest of the page's latest messages there and back.
        """
        least_ns = max(0, (link.back - link.sent) - (link.answered - link.received))
        offset_ns = ((link.received - link.sent) + (link.answered - link.back)) // 2
        self.rtt_ns = least_ns
        if self._first is None:
            self._first = at_ns, offset_ns
        passed_ns = at_ns - self._first[0]
        drift = (offset_ns - self._first[1]) / passed_ns * 1e6 if passed_ns >= _DRIFT_AFTER_NS else None
        return Linked(at_ns, offset_ns, -(-least_ns // 2), link.latest, least_ns, drift)


_POINTERS: dict[str, type[inputs.PointerPressed | inputs.PointerMoved | inputs.PointerReleased]] = {
    "pressed": inputs.PointerPressed,
    "moved": inputs.PointerMoved,
    "released": inputs.PointerReleased,
}
_MOST_UNHEARD = 20  # a page has one in a segment
_FAR_RTT_NS = 150_000_000  # until the latency is measured


@dataclass(slots=True)
class _PendingMessage:
    """A message of the page's that was taken, and the write that has to be on the disk for it to be safe."""

    number: int
    write: int


class SessionHost:
    """Receives the page's messages and fills the outbox with the answers.

    Args:
        session: new, or resumed from its log.
        recorder: where its events go; the session's, and a few of the page's own.
        make_world: makes worlds to look ahead in.
        settings: what of the protocol is about pages.
        agent: answers what a part wants from outside; None where no part does.
        logged: the events of the log that the session is resumed from.
        unwritten: events of that session that the log does not hold.
    """

    def __init__(
        self,
        session: SessionMachine,
        recorder: Recorder,
        make_world: WorldFactory,
        settings: PageSettings,
        *,
        agent: RequestHandler | None = None,
        logged: Sequence[Event] = (),
        unwritten: Sequence[Event] = (),
    ) -> None:
        self.session = session
        self.recorder = recorder
        self.presses = 0
        self._mark_ns = logged[-1].t_ns if logged else 0  # what is not later is in the log, or never will be
        known = (event for event in (*logged, *unwritten) if isinstance(event, KeyPressed))
        self._keys_down = {(event.t_ns - event.waited_ns, event.key) for event in known if event.down}
        self.last_at_ns = self._mark_ns
        self.outbox = Outbox(session, make_world, settings, logged)
        self._agent = agent
        self._learnt: NewPolicy | None = None  # what a learner made, until the session has it
        self._learnt_told = False  # the page was asked to say when
        self._last_asked = 0
        self._writes = 0  # of events
        self._begun = bool(logged)  # the session knows what time it is
        self._before_plan: list[Event] = []  # of the page's own, until the group is drawn
        self._unwritten: list[Event] = []  # of messages that others came with
        self._draws = True  # the page does not know the screen
        self._taken: deque[_PendingMessage] = deque()
        self._unheard = 0  # notes of what was done in segments before
        self._settled = 0  # the last message of the page's that is safe
        self.link = PageClock()
        self._asked: dict[int, Callable[[int], inputs.Input | None]] = {}  # what happens at the page's echo
        self._write(unwritten)

    # What the outside looks at

    @property
    def over(self) -> bool:
        """Whether the session is."""
        return self.session.over

    @property
    def outgoing(self) -> OutgoingStream[messages.ServerMessage | messages.PictureMessage]:
        """The messages to the page; another object after a restart."""
        return self.outbox.outgoing

    @property
    def is_polled(self) -> bool:
        """Whether a part may want something from outside; in a team's turns the page asks four times a second."""
        play = self.session.play
        return self._agent is not None and (not isinstance(play, TeamEpisode) or play.real_time)

    def safe(self, durable: int | None = None) -> int:
        """The last of the page's messages that may be acknowledged, and all before it: those on the disk.

        Args:
            durable: how many of the recorder's writes count, if not all on the disk; -1: not even those before it.
        """
        durable = self.recorder.durable_writes if durable is None else durable
        while self._taken and self._taken[0].write <= durable:
            self._settled = self._taken.popleft().number
        return self._settled

    # Inputs

    def begin_stream(self, settled: int) -> None:
        """Another stream of the page's leads from here on: it was loaded again, or is open in another tab.

        What of it is not later than the session was taken under another number, or never will be.

        Args:
            settled: the last of its messages that were acknowledged.
        """
        self._settled = self.outbox.through = self.outbox.moved = settled
        self._taken.clear()
        self._mark_ns = self.last_at_ns
        self.link = PageClock()

    def receive(
        self,
        number: int,
        at_ns: int,
        message: messages.PageMessage,
        *,
        more: bool = False,
        arrival_ns: int | None = None,
    ) -> bool:
        """Take a numbered message of the page's, and say whether the world made a step.

        Args:
            number: the message's.
            at_ns: its time.
            message: the message.
            more: whether others came with it: of an episode those that lead nowhere are one write and one answer with
                what follows, and where the page computes all are.
            arrival_ns: when it came, by the server's clock; None: the clocks are not compared.

        Raises:
            LogError: if the log cannot be written.
            MessageError: if its time is not later than the last one's.
        """
        self.outbox.through = number
        if leads := self.outbox.waits_for(message):
            self.outbox.moved = number
        if at_ns <= self._mark_ns:
            self._write(self._passed_over(message, at_ns))
            self._taken.append(_PendingMessage(number, self._writes + awaits_allocation(self.session)))
            return False
        if at_ns <= self.last_at_ns:
            raise messages.MessageError(
                f"message {number} has time {at_ns} ns, which is not after the previous one's {self.last_at_ns} ns; "
                "reload the page"
            )
        self.last_at_ns = self.outbox.at_ns = at_ns
        if arrival_ns is not None:
            self.link.arrive(at_ns, arrival_ns)
        if not self._begun and not isinstance(message, messages.TickMessage):
            self._write(self.session.receive(inputs.Tick(at_ns)))
        self._begun = True
        play, computes = self.session.play, self.outbox.is_computed
        self._draws = play is None  # else when the page is told where the session is, if it is
        events = self._events(message, at_ns)
        if difference := self.outbox.compare(message, events):
            events = [Noted(at_ns, BROWSER_NOTE, difference), *events]
        waits = more and play is not None and self.session.play is play and (computes or not leads)
        if waits:
            self._unwritten += events
        else:
            self._write(events)
        depends_on_next = isinstance(message, messages.DisplayedMessage) and not events  # kept until that is safe
        unsaid = depends_on_next or bool(self._unwritten) or awaits_allocation(self.session)
        self._taken.append(_PendingMessage(number, self._writes + unsaid))
        self.outbox.follow(events)
        if not waits:
            self._answer()
        return any(isinstance(event, Stepped) for event in events)

    def stop(self, stop: inputs.Stop | inputs.ExperimenterCommand) -> None:
        """End the session from outside, or do what the experimenter asks while no page is there.

        Raises:
            LogError: if the log cannot be written.
        """
        self._write(self.session.receive(stop))

    def ask(self, what: str, text: str) -> None:
        """Let the page say when the experimenter's wish reached it."""
        self._ask(lambda at_ns: inputs.ExperimenterCommand(at_ns, what, text))  # type: ignore[arg-type]

    def _ask(self, then: Callable[[int], inputs.Input | None]) -> None:
        number = self._last_asked = self._last_asked + 1
        self._asked[number] = then
        self.outgoing.add(messages.CommandMessage(number))

    # What a part wants from outside

    def _answer(self) -> None:
        """Answer the part's requests at the time of the page's last message, and tell the page where that led.

        A learner's work is polled for.
        """
        while self._agent is not None and not self.session.over and (want := self.session.request) is not None:
            is_learning = isinstance(want, PolicyRequest) and want.learning
            given = None if is_learning else self._agent.answer(want, self.session.play, self.last_at_ns)
            if given is None:
                break
            events = self.session.receive(given, draws=self._draws)
            self._write(events)
            self.outbox.follow(events)
            if (early := self.outbox.take_early()) is not None:
                self._write(self._step_shown(early, self.last_at_ns))
        self.outbox.send_state()

    def poll(self) -> bool:
        """See whether a learner that was asked has made something; True if there is something to tell the page."""
        if not self.session.over and isinstance(self.session.request, ClipRequest | TeamAnswerRequest):
            before = self._writes
            self._answer()
            return self._writes > before
        if self._agent is None or self._learnt_told or (want := self._wants_learnt) is None:
            return False
        if self._learnt is None:
            given = self._agent.answer(want, None, self.last_at_ns)
            self._learnt = given if isinstance(given, NewPolicy) else None
        if self._learnt is None:
            return False
        self._learnt_told = True
        self._ask(self._take_learnt)
        return True

    @property
    def _wants_learnt(self) -> PolicyRequest | None:
        """What a learner was asked for, where it can be taken now; while an episode is played it has to wait."""
        want = None if self.session.over else self.session.request
        return want if isinstance(want, PolicyRequest) and want.learning else None

    def _take_learnt(self, at_ns: int) -> inputs.Input | None:
        """The policy that was made; if an episode has begun since the page is asked again after it."""
        self._learnt_told = False
        if self._learnt is None or self._wants_learnt is None:
            return None
        given, self._learnt = self._learnt, None
        return replace(given, t_ns=at_ns)

    def _events(self, message: messages.PageMessage, at_ns: int) -> list[Event]:
        match message:
            case messages.RoundTripMessage():
                linked = self.link.linked(at_ns, message)
                drift = self.link.look(linked)
                return [Noted(at_ns, BROWSER_NOTE, drift), linked] if drift else [linked]
            case messages.GamepadMessage(id=name, axes=axes, buttons=buttons):
                what = f"{axes} axes of -1 to 1, {buttons} buttons, dead zone {PAD_DEAD_ZONE}, read once a frame"
                return [Noted(at_ns, BROWSER_NOTE, f"gamepad {name}: {what}")]
            case messages.LateInputMessage():
                self._unheard += 1
                if self._unheard > _MOST_UNHEARD:
                    return []
                return [Noted(at_ns, BROWSER_NOTE, f"not taken: {message.text}")]
            case messages.KeyMessage(trusted=False):
                what = "down" if message.down else "up"
                made = Noted(
                    at_ns, BROWSER_NOTE, f"key {message.key} {what} at {message.stamp} ns was made by a script"
                )
                return [made, *self._played(message, at_ns)]
            case messages.DisplayedMessage(step=step) if step >= 0:
                return self._step_shown(message, at_ns)
        return self._played(message, at_ns)

    def _passed_over(self, message: messages.PageMessage, at_ns: int) -> list[Event]:
        """A message of a time that has passed: what is not in the log was done in a tab that did not lead."""
        if not isinstance(message, messages.KeyMessage) or not message.down:
            return []
        if (min(message.stamp, at_ns), message.key) in self._keys_down:
            return []
        return [Noted(self.last_at_ns, BROWSER_NOTE, f"not taken: {message.key} at {message.stamp} ns")]

    def _played(self, message: messages.PageMessage, at_ns: int) -> list[Event]:
        happened = self._input(message, at_ns)
        return [] if happened is None else self.session.receive(happened, at_ns=at_ns, draws=self._draws)

    def _input(self, message: messages.PageMessage, at_ns: int) -> inputs.Input | None:
        match message:
            case messages.KeyMessage():
                stamp_ns = min(message.stamp, at_ns)
                if not message.down:
                    return inputs.KeyUp(stamp_ns, message.key, message.symbol)
                self._keys_down.add((stamp_ns, message.key))
                self.presses += not message.repeat
                return inputs.KeyDown(stamp_ns, message.key, message.symbol, repeat=message.repeat)
            case messages.DisplayedMessage() if self.outbox.is_present(message):
                return inputs.ScreenShown(at_ns, *_in_order(message, at_ns))
            case messages.TickMessage():
                return inputs.Tick(at_ns)
            case messages.TextMessage():
                return inputs.TextInput(at_ns, "".join(letter for letter in message.text if letter.isprintable()))
            case messages.PointerMessage():
                stamp_ns = min(message.stamp, at_ns)
                return _POINTERS[message.what](stamp_ns, message.x, message.y, message.target, message.along)
            case messages.AxisMessage():
                return inputs.AxisChanged(min(message.stamp, at_ns), message.axis, message.value)
            case messages.FocusMessage():
                return inputs.FocusChanged(at_ns, message.focused)
            case messages.CommandEcho() if message.number in self._asked:
                return self._asked.pop(message.number)(at_ns)
        return None

    def _step_shown(self, message: messages.DisplayedMessage, at_ns: int) -> list[Event]:
        """Word of a step's picture: held against where the session was then."""
        if not self.outbox.knows(message):
            self.outbox.keep_early(message)
            return []
        submit_ns, flip_ns = _in_order(message, at_ns)
        if self.outbox.is_corrected(message):
            return [PictureCorrected(at_ns, message.episode, message.step, submit_ns, flip_ns)]
        difference = self.outbox.difference(message)
        events: list[Event] = [Noted(at_ns, BROWSER_NOTE, difference)] if difference else []
        return [
            *events,
            *self.session.receive(
                inputs.ScreenShown(at_ns, submit_ns, flip_ns, message.step), at_ns=at_ns, draws=self._draws
            ),
        ]

    def _write(self, events: Sequence[Event]) -> None:
        """Write what the session says; what the page says of itself before there is a plan comes with it."""
        events, self._unwritten = [*self._unwritten, *events], []
        if awaits_allocation(self.session):
            self._before_plan += events
            return
        if events and self._before_plan:
            events = sorted([*events, *self._before_plan], key=lambda event: event.t_ns)
            self._before_plan = []
        if events:
            self._writes += 1
            self.recorder.write(events)

    # Messages to the page

    def grow(self) -> bool:
        """Look one scene, or one screen, further ahead; False if there is nothing to look at."""
        return self.outbox.grow(self.link.rtt_ns or _FAR_RTT_NS)

    def restart(self, *, computes: bool | None = None) -> None:
        """The page is another one, or knows nothing any more: tell it all from the start.

        ``computes`` says whether it has compiled the rules that are here; None: it is as it was.
        """
        if computes is not None:
            self.outbox.page_computes = computes
        self.outbox.restart(self._asked, begun=self._begun)
        if not self.over and self._begun:
            self._answer()

    def close_agent(self) -> None:
        """Let a learner go."""
        if self._agent is not None:
            self._agent.close()

    def close(self) -> None:
        """Let go of worlds and of a learner."""
        self.session.close()
        self.close_agent()
        self.outbox.close()


def _in_order(message: messages.DisplayedMessage, at_ns: int) -> tuple[int, int]:
    """When it was submitted and when it was there, no later than the word of it."""
    flip_ns = min(message.flip, at_ns)
    return min(message.submit, flip_ns), flip_ns
