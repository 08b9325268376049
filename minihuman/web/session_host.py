"""The session host: one participant's session between a page and a log. Messages in, messages out; no socket, no clock.

The page is the only source of inputs, and stamps them; the session alone decides their effect, and what the page showed
in advance is compared with it at every step. The offset between page and server clock comes from the message with the
shortest round trip.
"""

from collections.abc import Sequence
from dataclasses import replace

from minihuman.experiment.keys import PAD_DEAD_ZONE
from minihuman.experiment.machine import inputs
from minihuman.experiment.machine.activity import ActivityRequest, RequestHandler, WorldFactory
from minihuman.experiment.machine.events import Event, Noted, Stepped
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.replay import BROWSER_NOTE
from minihuman.log.record.recorder import Recorder
from minihuman.web import messages
from minihuman.web.message_streams import OutgoingStream
from minihuman.web.outbox import Outbox, PageSettings
from minihuman.web.page_inputs import MakeInput, PageInputs, order_flip
from minihuman.web.session_clocks import PageClock
from minihuman.web.session_writer import SessionWriter

_MOST_UNHEARD = 20  # a page has one in a segment
_FAR_RTT_NS = 150_000_000  # until the latency is measured


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
        self._mark_ns = 0  # what is not later is in the log, or never will be
        if logged:
            self._mark_ns = logged[-1].t_ns
        self.last_at_ns = self._mark_ns
        self.outbox = Outbox(session, make_world, settings, logged)
        self.link = PageClock()
        self._agent = agent
        self._prepared: inputs.ActivityInput | None = None  # an answer that took long, until the session has it
        self._is_announced = False  # the page was asked when it is to be taken
        self._inputs = PageInputs((*logged, *unwritten))
        self._writer = SessionWriter(session, recorder)
        self._has_begun = bool(logged)  # the session knows what time it is
        self._draws = True  # the page does not know the screen
        self._notes: list[str] = []  # of the page, that come with its next message
        self.has_stepped = any(isinstance(event, Stepped) for event in logged)
        self._unheard = 0  # notes of what was done in segments before
        self._writer.write(unwritten)

    # What the outside looks at

    @property
    def over(self) -> bool:
        """Whether the session is."""
        return self.session.over

    @property
    def outgoing(self) -> OutgoingStream[messages.ServerMessage | messages.PictureMessage]:
        """Return the messages to the page; another object after a restart."""
        return self.outbox.outgoing

    @property
    def is_polled(self) -> bool:
        """Whether a part may want something from outside; in joint turns the page asks four times a second."""
        play = self.session.play
        return self._agent is not None and (play is None or not play.is_joint or play.real_time)

    def safe(self, durable: int | None = None) -> int:
        """Return the last of the page's messages that may be acknowledged, and all before it: those on the disk.

        Args:
            durable: how many of the recorder's writes count, if not all on the disk; -1: not even those before it.
        """
        return self._writer.safe(durable)

    # Inputs

    def begin_stream(self, settled: int) -> None:
        """Begin with another stream of the page's: it was loaded again, or is open in another tab.

        What of it is not later than the session was taken under another number, or never will be.

        Args:
            settled: the last of its messages that were acknowledged.
        """
        self.outbox.through = settled
        self.outbox.moved = settled
        self._writer.begin_stream(settled)
        self._mark_ns = self.last_at_ns
        self.link = PageClock()

    def note(self, text: str) -> None:
        """Note something of the page at the time of its next message; "" is nothing."""
        if text:
            self._notes.append(text)

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
        leads = self.outbox.waits_for(message)
        if leads:
            self.outbox.moved = number
        if at_ns <= self._mark_ns:
            self._writer.write(self._inputs.note_missed(message, at_ns, self.last_at_ns))
            self._writer.record_taken(number)
            return False
        self._advance(number, at_ns, message, arrival_ns)
        play = self.session.play
        computes = self.outbox.is_computed
        self._draws = play is None  # else when the page is told where the session is, if it is
        events = self._add_notes(message, at_ns, self._find_events(message, at_ns, arrival_ns))
        waits = more and play is not None and self.session.play is play and (computes or not leads)
        if waits:
            self._writer.write_later(events)
        else:
            self._writer.write(events)
        is_kept_early = isinstance(message, messages.DisplayedMessage) and not events  # until the next write is safe
        self._writer.record_taken(number, with_next=is_kept_early)
        self.outbox.follow(events)
        if not waits:
            self._answer()
        is_step = any(isinstance(event, Stepped) for event in events)
        self.has_stepped |= is_step
        return is_step

    def _add_notes(self, message: messages.PageMessage, at_ns: int, events: list[Event]) -> list[Event]:
        """Put notes of the page before a message's events, and how its step differed from the session's."""
        notes = self._notes
        self._notes = []
        if difference := self.outbox.compare(message, events):
            notes.append(difference)
        return [*(Noted(at_ns, BROWSER_NOTE, note) for note in notes), *events]

    def _advance(self, number: int, at_ns: int, message: messages.PageMessage, arrival_ns: int | None) -> None:
        """Let the session's time be a message's."""
        if at_ns <= self.last_at_ns:
            raise messages.MessageError(
                f"message {number} has time {at_ns} ns, which is not after the previous one's {self.last_at_ns} ns; "
                "reload the page"
            )
        self.last_at_ns = at_ns
        self.outbox.at_ns = at_ns
        if arrival_ns is not None:
            self.note(self.link.arrive(at_ns, arrival_ns))
        if not self._has_begun and not isinstance(message, messages.TickMessage):
            self._writer.write(self.session.receive(inputs.Tick(at_ns)))
        self._has_begun = True

    def stop(self, stop: inputs.Stop | inputs.ExperimenterCommand) -> None:
        """End the session from outside, or do what the experimenter asks while no page is there.

        Raises:
            LogError: if the log cannot be written.
        """
        self._writer.write(self.session.receive(stop))

    def ask(self, command: str, text: str) -> None:
        """Let the page say when the experimenter's wish reached it."""
        self._ask_page(lambda at_ns: inputs.ExperimenterCommand(at_ns, command, text))  # type: ignore[arg-type]

    def _ask_page(self, make_input: MakeInput) -> None:
        self.outgoing.add(messages.CommandMessage(self._inputs.ask(make_input)))

    # What a part wants from outside

    def _answer(self) -> None:
        """Answer the part's requests at the time of the page's last message, and tell the page where that led.

        What takes long is polled for.
        """
        while self._agent is not None and not self.session.over and (request := self.session.request) is not None:
            answer = None
            if not request.takes_long:
                answer = self._agent.answer(request, self.session.play, self.last_at_ns)
            if answer is None:
                break
            events = self.session.receive(answer, draws=self._draws)
            self._writer.write(events)
            self.outbox.follow(events)
            if (early := self.outbox.steps.take_early()) is not None:
                self._writer.write(self._step_shown(early, self.last_at_ns))
        self.outbox.send_state()

    def poll(self) -> bool:
        """See whether others, or what takes long, have an answer; True if there is something to tell the page."""
        request = self._request
        if request is not None and request.awaits_others:
            count = self._writer.count
            self._answer()
            return self._writer.count > count
        if self._agent is None or self._is_announced or (request := self._long_request) is None:
            return False
        if self._prepared is None:
            self._prepared = self._agent.answer(request, None, self.last_at_ns)
        if self._prepared is None:
            return False
        self._is_announced = True
        self._ask_page(self._take_prepared)
        return True

    @property
    def _request(self) -> ActivityRequest | None:
        """Return what a part of the session wants from outside."""
        if self.session.over:
            return None
        return self.session.request

    @property
    def _long_request(self) -> ActivityRequest | None:
        """Return the request whose answer takes long, where it can be taken now; during an episode it has to wait."""
        request = self._request
        if request is not None and request.takes_long:
            return request
        return None

    def _take_prepared(self, at_ns: int) -> inputs.Input | None:
        """Return the answer that took long; if an episode has begun since the page is asked again after it."""
        self._is_announced = False
        if self._prepared is None or self._long_request is None:
            return None
        prepared = self._prepared
        self._prepared = None
        return replace(prepared, t_ns=at_ns)

    # What the page did

    def _find_events(self, message: messages.PageMessage, at_ns: int, arrival_ns: int | None) -> list[Event]:
        match message:
            case messages.RoundTripMessage():
                linked = self.link.linked(at_ns, message)
                if arrival_ns is not None:
                    self.note(self.link.look(linked, arrival_ns))
                return [linked]
            case messages.GamepadMessage(id=name, axes=axes, buttons=buttons):
                detail = f"{axes} axes of -1 to 1, {buttons} buttons, dead zone {PAD_DEAD_ZONE}, read once a frame"
                return [Noted(at_ns, BROWSER_NOTE, f"gamepad {name}: {detail}")]
            case messages.LateInputMessage():
                self._unheard += 1
                if self._unheard > _MOST_UNHEARD:
                    return []
                return [Noted(at_ns, BROWSER_NOTE, f"not taken: {message.text}")]
            case messages.KeyMessage(trusted=False):
                detail = "up"
                if message.down:
                    detail = "down"
                note = Noted(
                    at_ns, BROWSER_NOTE, f"key {message.key} {detail} at {message.stamp} ns was made by a script"
                )
                return [note, *self._play(message, at_ns)]
            case messages.DisplayedMessage(step=step) if step >= 0:
                return self._step_shown(message, at_ns)
        return self._play(message, at_ns)

    def _play(self, message: messages.PageMessage, at_ns: int) -> list[Event]:
        is_present = isinstance(message, messages.DisplayedMessage) and self.outbox.is_present(message)
        page_input = self._inputs.convert(message, at_ns, is_present=is_present)
        if page_input is None:
            return []
        return self.session.receive(page_input, at_ns=at_ns, draws=self._draws)

    def _step_shown(self, message: messages.DisplayedMessage, at_ns: int) -> list[Event]:
        """Take word of a step's picture, compared with where the session was then."""
        steps = self.outbox.steps
        if not steps.knows(message):
            steps.keep_early(message)
            return []
        submit_ns, flip_ns = order_flip(message, at_ns)
        correction = self.outbox.describe_correction(message, at_ns, submit_ns, flip_ns)
        if correction is not None:
            return [correction]
        difference = steps.difference(message)
        notes: list[Event] = []
        if difference:
            notes.append(Noted(at_ns, BROWSER_NOTE, difference))
        display = inputs.ScreenShown(at_ns, submit_ns, flip_ns, message.step)
        return [*notes, *self.session.receive(display, at_ns=at_ns, draws=self._draws)]

    # Messages to the page

    def grow(self) -> bool:
        """Look one scene, or one screen, further ahead; False if there is nothing to look at."""
        return self.outbox.grow(self.link.rtt_ns or _FAR_RTT_NS)

    def restart(self, *, computes: bool | None = None) -> None:
        """Tell the page everything from the start: it is another one, or knows nothing any more.

        ``computes`` says whether it has compiled the rules that are here; None: it is as it was.
        """
        if computes is not None:
            self.outbox.page_computes = computes
        self.outbox.restart(self._inputs.open_questions, has_begun=self._has_begun)
        if not self.over and self._has_begun:
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
