"""A seat: one participant's session between a page and a log. Messages in, messages out; no socket, no clock.

The page is the only source of inputs, and stamps them; the session is the only source of what is true. What the page
showed in advance and what the session says are compared at every step.
"""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from minihuman.log.record.recorder import Recorder
from minihuman.study.activities.agent_events import NewPolicy, WantsPolicy
from minihuman.study.activities.pair_events import WantsStretch
from minihuman.study.activities.port import Outside
from minihuman.study.again import OF_PAGE
from minihuman.study.events import Event, Noted
from minihuman.study.inputs import (
    Asked,
    FocusChanged,
    Input,
    KeyDown,
    KeyUp,
    PointerMoved,
    PointerPressed,
    PointerReleased,
    Shown,
    Stop,
    Tick,
    Typed,
)
from minihuman.study.session import Session
from minihuman.study.stage import MakeWorld
from minihuman.study.undrawn import waits_for_draw
from minihuman.web import wire
from minihuman.web.link import LinkClock
from minihuman.web.rate import KeyRate
from minihuman.web.stream import Saying
from minihuman.web.telling import Settings, Telling

_POINTERS: dict[str, type[PointerPressed | PointerMoved | PointerReleased]] = {
    "pressed": PointerPressed,
    "moved": PointerMoved,
    "released": PointerReleased,
}
_MOST_UNHEARD = 20  # a page has one in a segment
_FAR_RTT_NS = 150_000_000  # until the line is measured


@dataclass(slots=True)
class _Taken:
    """A message of the page's that was taken, and the write that has to be on the disk for it to be safe."""

    number: int
    write: int


class Seat:
    """Takes what the page says, and has in ``saying`` what is to be told it.

    Args:
        session: new, or taken up from its log.
        recorder: where its events go; the session's, and a few of the page's own.
        make_world: makes worlds to look ahead in.
        settings: what of the protocol is about pages.
        agent: answers what a part wants from outside; None where no part does.
        logged: the events of the log that a session is taken up from; what the page said up to their end is in it.
        unwritten: what that session has said and the log does not hold.
    """

    def __init__(
        self,
        session: Session,
        recorder: Recorder,
        make_world: MakeWorld,
        settings: Settings,
        *,
        agent: Outside | None = None,
        logged: Sequence[Event] = (),
        unwritten: Sequence[Event] = (),
    ) -> None:
        self.session = session
        self.recorder = recorder
        self.presses = 0
        self._mark_ns = logged[-1].t_ns if logged else 0
        self.last_at_ns = self._mark_ns
        self._telling = Telling(session, make_world, settings, logged)
        self._agent = agent
        self._learnt: NewPolicy | None = None  # what a learner made, until the session has it
        self._learnt_told = False  # the page was asked to say when
        self._last_asked = 0
        self._writes = 0  # of events
        self._begun = bool(logged)  # the session knows what time it is
        self._before_plan: list[Event] = []  # of the page's own, until the group is drawn
        self._taken: deque[_Taken] = deque()
        self._unheard = 0  # notes of what was done in segments before
        self._settled = 0  # the last message of the page's that is safe
        self._link = LinkClock()
        self._rate = KeyRate()
        self._asked: dict[int, Callable[[int], Input | None]] = {}  # what happens once the page has said when
        self._write(unwritten)

    # What the outside looks at

    @property
    def over(self) -> bool:
        """Whether the session is."""
        return self.session.over

    @property
    def saying(self) -> Saying[wire.Told | wire.Picture]:
        """What the page is told; another object when it begins anew."""
        return self._telling.saying

    @property
    def rtt_ns(self) -> int | None:
        """Of the line, at its best lately; None until it was measured."""
        return self._link.rtt_ns

    @property
    def has_agent(self) -> bool:
        """Whether a part may want something from outside."""
        return self._agent is not None

    def safe(self) -> int:
        """The last of the page's messages that is on the disk, and all before it: what may be acknowledged."""
        durable = self.recorder.durable_writes
        while self._taken and self._taken[0].write <= durable:
            self._settled = self._taken.popleft().number
        return self._settled

    # Inputs

    def receive(self, number: int, at_ns: int, said: wire.Said) -> None:
        """Take a numbered message of the page's.

        Raises:
            LogError: if the log cannot be written.
            WireError: if its time is not later than the last one's.
        """
        self._telling.through = number
        if _may_lead_on(said) and not (_is_release(said) and self._telling.goes_by_presses):
            self._telling.moved = number
        if at_ns <= self._mark_ns:  # it is in the log that the session was taken up from
            self._taken.append(_Taken(number, 0))
            return
        if at_ns <= self.last_at_ns:
            raise wire.WireError(f"message {number} is of {at_ns} ns; the one before it was of {self.last_at_ns} ns")
        self.last_at_ns = self._telling.at_ns = at_ns
        if not self._begun and not isinstance(said, wire.Time):
            self._write(self.session.receive(Tick(at_ns)))
        self._begun = True
        events = self._events(said, at_ns)
        self._write(events)
        told_later = isinstance(said, wire.Show) and not events  # only by what follows: keep it until that is safe
        unsaid = told_later or waits_for_draw(self.session)
        self._taken.append(_Taken(number, self._writes + unsaid))
        self._telling.follow(events)
        self._answer()

    def stop(self, stop: Stop | Asked) -> None:
        """End the session from outside, or do what the experimenter asks while no page is there.

        Raises:
            LogError: if the log cannot be written.
        """
        self._write(self.session.receive(stop))

    def ask(self, what: str, text: str) -> None:
        """Let the page say when the experimenter's wish reached it."""
        self._ask(lambda at_ns: Asked(at_ns, what, text))  # type: ignore[arg-type]  # the desk's own words

    def _ask(self, then: Callable[[int], Input | None]) -> None:
        number = self._last_asked = self._last_asked + 1
        self._asked[number] = then
        self.saying.say(wire.Ask(number))

    # What a part wants from outside

    def _answer(self) -> None:
        """Give the part what it waits for, at the time of what the page said last; a learner's work is polled for."""
        while self._agent is not None and not self.session.over and (want := self.session.wants) is not None:
            if isinstance(want, WantsPolicy) and want.learning:
                return
            given = self._agent.answer(want, self.session.play, self.last_at_ns)
            if given is None:
                return
            events = self.session.receive(given)
            self._write(events)
            self._telling.follow(events)

    def poll(self) -> bool:
        """See whether a learner that was asked has made something; True if there is something to tell the page."""
        if not self.session.over and isinstance(self.session.wants, WantsStretch):
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
    def _wants_learnt(self) -> WantsPolicy | None:
        """What a learner was asked for, where it can be taken now; while an episode is played it has to wait."""
        want = None if self.session.over else self.session.wants
        return want if isinstance(want, WantsPolicy) and want.learning else None

    def _take_learnt(self, at_ns: int) -> Input | None:
        """The policy that was made; if an episode has begun since the page is asked again after it."""
        self._learnt_told = False
        if self._learnt is None or self._wants_learnt is None:
            return None
        given, self._learnt = self._learnt, None
        return replace(given, t_ns=at_ns)

    def _events(self, said: wire.Said, at_ns: int) -> list[Event]:
        match said:
            case wire.Link():
                return [self._link.linked(at_ns, said)]
            case wire.Unheard():
                self._unheard += 1
                if self._unheard > _MOST_UNHEARD:
                    return []
                return [Noted(at_ns, OF_PAGE, f"not taken: {said.text}")]
            case wire.Key(trusted=False):
                what = "down" if said.down else "up"
                made = Noted(at_ns, OF_PAGE, f"key {said.key} {what} at {said.stamp} ns was made by a script")
                return [made, *self._played(said, at_ns)]
            case wire.Show(step=step) if step >= 0:
                return self._step_shown(said, at_ns)
        return self._played(said, at_ns)

    def _played(self, said: wire.Said, at_ns: int) -> list[Event]:
        happened = self._input(said, at_ns)
        return [] if happened is None else self.session.receive(happened, at_ns=at_ns)

    def _input(self, said: wire.Said, at_ns: int) -> Input | None:
        match said:
            case wire.Key():
                stamp_ns = min(said.stamp, at_ns)
                if not said.down:
                    return KeyUp(stamp_ns, said.key, said.symbol)
                self.presses += not said.repeat
                self._rate.pressed(stamp_ns)
                return KeyDown(stamp_ns, said.key, said.symbol, repeat=said.repeat)
            case wire.Show() if self._telling.is_present(said):
                return Shown(at_ns, *_in_order(said, at_ns))
            case wire.Time():
                return Tick(at_ns)
            case wire.Type():
                return Typed(at_ns, "".join(letter for letter in said.text if letter.isprintable()))
            case wire.Point():
                return _POINTERS[said.what](at_ns, said.x, said.y, said.target, said.along)
            case wire.Focus():
                return FocusChanged(at_ns, said.focused)
            case wire.Echo() if said.number in self._asked:
                return self._asked.pop(said.number)(at_ns)
        return None

    def _step_shown(self, said: wire.Show, at_ns: int) -> list[Event]:
        """Word of a step's picture: held against where the session was then."""
        if not self._telling.knows(said):
            return []
        difference = self._telling.difference(said)
        events: list[Event] = [Noted(at_ns, OF_PAGE, difference)] if difference else []
        submit_ns, flip_ns = _in_order(said, at_ns)
        return [*events, *self.session.receive(Shown(at_ns, submit_ns, flip_ns, said.step), at_ns=at_ns)]

    def _write(self, events: Sequence[Event]) -> None:
        """Write what the session says; what the page says of itself before there is a plan comes with it."""
        if waits_for_draw(self.session):
            self._before_plan += events
            return
        if events and self._before_plan:
            events = sorted([*events, *self._before_plan], key=lambda event: event.t_ns)
            self._before_plan = []
        if events:
            self._writes += 1
            self.recorder.write(events)

    # What the page is told

    def grow(self) -> bool:
        """Look one scene, or one screen, further ahead; False if there is nothing to look at."""
        return self._telling.grow(self._link.rtt_ns or _FAR_RTT_NS, self._rate.hz)

    def tell_found(self) -> None:
        """Tell the page what was found ahead since it was told last."""
        self._telling.tell_found()

    def begin_again(self) -> None:
        """The page is another one, or knows nothing any more: tell it all from the start."""
        self._telling.begin_again(self._asked, begun=self._begun)
        if not self.over and self._begun:
            self._answer()

    def let_go(self) -> None:
        """Let a learner go."""
        if self._agent is not None:
            self._agent.close()

    def close(self) -> None:
        """Let go of worlds and of a learner."""
        self.session.close()
        self.let_go()
        self._telling.close()


def _may_lead_on(said: wire.Said) -> bool:
    """Whether a session may go on by what a page says: not by word of what it showed, nor of the line."""
    return not isinstance(said, wire.Show | wire.Link | wire.Unheard)


def _is_release(said: wire.Said) -> bool:
    return isinstance(said, wire.Key) and not said.down


def _in_order(said: wire.Show, at_ns: int) -> tuple[int, int]:
    """When it was submitted and when it was there, no later than the word of it."""
    flip_ns = min(said.flip, at_ns)
    return min(said.submit, flip_ns), flip_ns
