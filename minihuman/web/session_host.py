"""The session host: one participant's session between a page and a log, with messages in and out. No socket, no clock.

The page is the only source of inputs, and timestamps them. The session alone decides their effect, and what the page
showed in advance is compared with the session at every step. The offset between the page's and the server's clock is
taken from the message with the shortest round trip.
"""

from collections.abc import Sequence
from dataclasses import replace

from minihuman.experiment.keys import PAD_DEAD_ZONE
from minihuman.experiment.machine import inputs
from minihuman.experiment.machine.activity import ActivityRequest, RequestHandler, WorldFactory
from minihuman.experiment.machine.events import Event, Noted, SessionStarted, Stepped
from minihuman.experiment.machine.page_alterations import format_alteration
from minihuman.experiment.machine.session import SessionMachine
from minihuman.experiment.replay import BROWSER_NOTE
from minihuman.log.record.recorder import Recorder
from minihuman.web import messages
from minihuman.web.message_streams import OutgoingStream
from minihuman.web.outbox import Outbox, PageSettings
from minihuman.web.page_inputs import MakeInput, PageInputs, get_display_times
from minihuman.web.session_clocks import PageClock
from minihuman.web.session_writer import SessionWriter

_MAX_ALTERATION_NOTES = 500  # a translated page reports one alteration per screen
_MAX_LATE_INPUT_NOTES = 20  # a page reports at most one per segment
_FAR_RTT_NS = 150_000_000  # assumed round trip until one is measured


class SessionHost:
    """Receives the page's messages and fills the outbox with the answers.

    Args:
        session: the session, new or resumed from its log.
        recorder: the recorder of the session's events and of a few events of the page.
        make_world: makes worlds to look ahead in.
        settings: the protocol's settings for pages.
        agent: answers the parts' requests to agents and other participants; None if no part makes requests.
        logged: the events of the log that the session is resumed from.
        unwritten: the session's events that the log does not contain yet.
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
        self._mark_ns = 0  # messages of the page that are not later are ignored: see ``begin_stream``
        if logged:
            self._mark_ns = logged[-1].t_ns
        self.last_at_ns = self._mark_ns
        self.outbox = Outbox(session, make_world, settings, logged)
        self.link = PageClock()
        self._agent = agent
        self._prepared: inputs.ActivityInput | None = None  # the answer to a long request, until the session has it
        self._is_announced = False  # whether the page was asked to set that answer's time
        self._inputs = PageInputs((*logged, *unwritten))
        self._writer = SessionWriter(session, recorder)
        self._has_begun = bool(logged)  # whether the session has received an input
        self._draws = True  # whether the session draws its pictures; in an episode the page has them already
        self._notes: list[str] = []  # about the page, to be logged with its next message
        self.has_stepped = any(isinstance(event, Stepped) for event in logged)
        self._alterations = 0  # count of reported alterations of the page
        self._unheard = 0  # count of reported inputs of earlier segments
        self._writer.write(unwritten)

    # What the outside looks at

    @property
    def over(self) -> bool:
        """Return whether the session is over."""
        return self.session.over

    @property
    def outgoing(self) -> OutgoingStream[messages.ServerMessage | messages.PictureMessage]:
        """Return the stream of messages to the page; a restart replaces it."""
        return self.outbox.outgoing

    @property
    def has_agent(self) -> bool:
        """Return whether the session has an agent, so that it may have to be polled."""
        return self._agent is not None

    @property
    def is_polled(self) -> bool:
        """Return whether the host must be polled for answers to requests; in joint turns, the page's ticks suffice."""
        if not self.has_agent:
            return False
        play = self.session.play
        plays_joint_turns = play is not None and play.is_joint and not play.real_time
        return not plays_joint_turns

    def safe(self, durable: int | None = None) -> int:
        """Return the number up to which all of the page's messages are on the disk and can be acknowledged.

        Args:
            durable: how many of the recorder's writes count as durable; None for all on the disk, -1 for none at all.
        """
        return self._writer.safe(durable)

    # Inputs

    def begin_stream(self, settled: int) -> None:
        """Begin another stream of the page, which was reloaded or is open in another tab.

        Messages of the stream that are not later than the session's present time are ignored, since the session has
        already received them under other numbers, or has gone on without them.

        Args:
            settled: the number of the stream's last acknowledged message.
        """
        self.outbox.through = settled
        self.outbox.moved = settled
        self._writer.begin_stream(settled)
        self._mark_ns = self.last_at_ns
        self.link = PageClock()

    def note(self, text: str) -> None:
        """Keep a note about the page, to be logged with its next message; "" is ignored."""
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
        """Handle a numbered message of the page; return whether the world made a step.

        Args:
            number: the message's number.
            at_ns: the message's time in nanoseconds.
            message: the message.
            more: whether further messages arrived with this one. In an episode, a message is then written and answered
                with the next one, unless the page waits for the answer and does not compute the episode itself.
            arrival_ns: the time of arrival by the server's clock; None to leave the clocks uncompared.

        Raises:
            LogError: if the log cannot be written.
            MessageError: if the time is not later than that of the last message.
        """
        self.outbox.through = number
        play = self.session.play
        page_waits = self.outbox.waits_for(message)
        if page_waits:
            self.outbox.moved = number
        if at_ns <= self._mark_ns:
            self._writer.write(self._inputs.note_missed(message, at_ns, self.last_at_ns))
            self._writer.record_taken(number)
            return False
        self._advance(number, at_ns, message, arrival_ns)
        computes = self.outbox.is_computed
        self._draws = play is None
        events = self._find_events(message, at_ns, arrival_ns)
        stepped = _find_step(events)
        events = self._add_notes(message, at_ns, events, stepped)
        is_deferred = more and play is not None and self.session.play is play and (computes or not page_waits)
        if is_deferred:
            self._writer.write_later(events)
        else:
            self._writer.write(events)
        self._writer.record_taken(number, with_next=not events and isinstance(message, messages.DisplayedMessage))
        self.outbox.follow(events)
        if not is_deferred:
            self._answer_requests()
        self.has_stepped |= stepped is not None
        return stepped is not None

    def _add_notes(
        self, message: messages.PageMessage, at_ns: int, events: list[Event], stepped: Stepped | None
    ) -> list[Event]:
        """Return a message's events with notes about the page and about differences of its step.

        The notes come first, but after the start of the session, with which a log begins.
        """
        if difference := self.outbox.compare(message, stepped):
            self._notes.append(difference)
        if not self._notes:
            return events
        notes = self._notes
        self._notes = []
        start = [event for event in events[:1] if isinstance(event, SessionStarted)]
        return [*start, *(Noted(at_ns, BROWSER_NOTE, note) for note in notes), *events[len(start) :]]

    def _advance(self, number: int, at_ns: int, message: messages.PageMessage, arrival_ns: int | None) -> None:
        """Advance the session's time to that of a message, which begins the session if it is the first.

        The arguments are those of ``receive``.

        Raises:
            LogError: if the log cannot be written.
            MessageError: if the time is not later than that of the last message.
        """
        if at_ns <= self.last_at_ns:
            raise messages.MessageError(
                f"message {number} has time {at_ns} ns, which is not after the previous one's {self.last_at_ns} ns; "
                "reload the page"
            )
        self.last_at_ns = at_ns
        self.outbox.at_ns = at_ns
        if arrival_ns is not None and (note := self.link.compare_arrival(at_ns, arrival_ns)):
            self._notes.append(note)
        if not self._has_begun and not isinstance(message, messages.TickMessage):
            self._writer.write(self.session.receive(inputs.Tick(at_ns)))
        self._has_begun = True

    def stop(self, stop: inputs.Stop | inputs.ExperimenterCommand) -> None:
        """End the session from outside, or carry out an experimenter's command while no page is connected.

        Raises:
            LogError: if the log cannot be written.
        """
        self._writer.write(self.session.receive(stop))

    def ask(self, command: str, text: str) -> None:
        """Send the page an experimenter's command and its text; the session carries it out when the page echoes it."""
        self._send_question(lambda at_ns: inputs.ExperimenterCommand(at_ns, command, text))  # type: ignore[arg-type]

    def _send_question(self, make_input: MakeInput) -> None:
        """Send the page a question, whose echo sets the time of the input that ``make_input`` makes."""
        self.outgoing.add(messages.CommandMessage(self._inputs.ask(make_input)))

    # What a part wants from outside

    def _answer_requests(self) -> None:
        """Answer the part's requests at the time of the page's last message, and send the page the resulting state.

        Requests whose answer takes long are answered by ``poll``.
        """
        while self._agent is not None and not self.session.over:
            request = self.session.request
            if request is None or request.takes_long:
                break
            answer = self._agent.answer(request, self.session.play, self.last_at_ns)
            if answer is None:
                break
            events = self.session.receive(answer, draws=self._draws)
            self._writer.write(events)
            self.outbox.follow(events)
            early_step = self.outbox.steps.take_early()
            if early_step is not None:
                self._writer.write(self._find_display_events(early_step, self.last_at_ns))
        self.outbox.send_state()

    def poll(self) -> bool:
        """Check whether a pending request has an answer; return True if there is news for the page."""
        request = self._request
        if request is not None and request.awaits_others:
            count = self._writer.count
            self._answer_requests()
            return self._writer.count > count
        if self._agent is None or self._is_announced or (request := self._long_request) is None:
            return False
        if self._prepared is None:
            self._prepared = self._agent.answer(request, None, self.last_at_ns)  # outside of episodes
        if self._prepared is None:
            return False
        self._is_announced = True
        self._send_question(self._take_prepared)
        return True

    @property
    def _request(self) -> ActivityRequest | None:
        """Return the present request of the session's part to an agent or other participants; None if there is none."""
        if self.session.over:
            return None
        return self.session.request

    @property
    def _long_request(self) -> ActivityRequest | None:
        """Return the present request if its answer takes long; None otherwise, as during an episode."""
        request = self._request
        if request is not None and request.takes_long:
            return request
        return None

    def _take_prepared(self, at_ns: int) -> inputs.Input | None:
        """Return and discard the prepared answer to a long request, with the time of the page's echo.

        If an episode has begun in the meantime, return None, and keep the answer until after the episode.
        """
        self._is_announced = False
        if self._prepared is None or self._long_request is None:
            return None
        prepared = self._prepared
        self._prepared = None
        return replace(prepared, t_ns=at_ns)

    # What the page did

    def _find_events(self, message: messages.PageMessage, at_ns: int, arrival_ns: int | None) -> list[Event]:
        """Return the events of a message: notes about a report of the page, or the session's events for an input."""
        match message:
            case messages.RoundTripMessage():
                linked = self.link.record_round_trip(at_ns, message)
                if arrival_ns is not None:
                    self.note(self.link.compare_round_trip(linked, arrival_ns))
                return [linked]
            case messages.GamepadMessage(id=name, axes=axes, buttons=buttons):
                detail = f"{axes} axes of -1 to 1, {buttons} buttons, dead zone {PAD_DEAD_ZONE}, read once a frame"
                return [Noted(at_ns, BROWSER_NOTE, f"gamepad {name}: {detail}")]
            case messages.PageAlteration(what=what, detail=detail):
                self._alterations += 1
                if self._alterations > _MAX_ALTERATION_NOTES:
                    return []
                return [Noted(at_ns, BROWSER_NOTE, format_alteration(what, detail))]
            case messages.LateInputMessage():
                self._unheard += 1
                if self._unheard > _MAX_LATE_INPUT_NOTES:
                    return []
                return [Noted(at_ns, BROWSER_NOTE, f"not taken: {message.text}")]
            case messages.KeyMessage(trusted=False):
                direction = "up"
                if message.down:
                    direction = "down"
                text = f"key {message.key} {direction} at {message.stamp} ns was made by a script"
                return [Noted(at_ns, BROWSER_NOTE, text), *self._apply_input(message, at_ns)]
            case messages.DisplayedMessage(step=step) if step >= 0:
                return self._find_display_events(message, at_ns)
        return self._apply_input(message, at_ns)

    def _apply_input(self, message: messages.PageMessage, at_ns: int) -> list[Event]:
        """Pass the input of a message, if it has one, to the session; return the resulting events."""
        is_present = isinstance(message, messages.DisplayedMessage) and self.outbox.is_present(message)
        page_input = self._inputs.convert(message, at_ns, is_present=is_present)
        if page_input is None:
            return []
        return self.session.receive(page_input, at_ns=at_ns, draws=self._draws)

    def _find_display_events(self, message: messages.DisplayedMessage, at_ns: int) -> list[Event]:
        """Return the events for a picture of a step that was displayed, with a note if it differs from the session's.

        A report on the picture of a joint step that is not closed yet is kept for later, and has no events now.
        """
        steps = self.outbox.steps
        if not steps.knows(message):
            steps.keep_early(message)
            return []
        submit_ns, flip_ns = get_display_times(message, at_ns)
        correction = self.outbox.describe_correction(message, at_ns, submit_ns, flip_ns)
        if correction is not None:
            return [correction]
        difference = steps.describe_difference(message)
        notes: list[Event] = []
        if difference:
            notes.append(Noted(at_ns, BROWSER_NOTE, difference))
        display = inputs.ScreenShown(at_ns, submit_ns, flip_ns, message.step)
        return [*notes, *self.session.receive(display, at_ns=at_ns, draws=self._draws)]

    # Messages to the page

    def grow(self) -> bool:
        """Explore one more scene or screen ahead of the session; return False if nothing is left."""
        return self.outbox.grow(self.link.rtt_ns or _FAR_RTT_NS)

    def restart(self, *, computes: bool | None = None) -> None:
        """Send the page everything from the start, because it is a new page or knows nothing any more.

        Args:
            computes: whether the page has compiled the rules of this server; None if that has not changed.
        """
        if computes is not None:
            self.outbox.page_computes = computes
        self.outbox.restart(self._inputs.open_questions, has_begun=self._has_begun)
        if not self.over and self._has_begun:
            self._answer_requests()

    def close_agent(self) -> None:
        """Close the agent, if there is one."""
        if self._agent is not None:
            self._agent.close()

    def close(self) -> None:
        """Close the session's worlds and its agent."""
        self.session.close()
        self.close_agent()
        self.outbox.close()


def _find_step(events: Sequence[Event]) -> Stepped | None:
    """Return the step among the events of an input; None if it made none."""
    for event in events:
        if isinstance(event, Stepped):
            return event
    return None
