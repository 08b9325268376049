"""Presence: the holder of each person's seat, and the last sign of life of its page and its person. Reads no clock.

An agent that stands in for a person holds the seat until the person may take it back. The protocol decides whether a
person may return, and whether the block continues without them. The wait for a person counts from their last sign of
life; steps that close in the meantime do not restart it.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from minihuman.activities.team.events import SeatHolder
from minihuman.activities.team.plan import PERSON, PINGS_PER_WAIT, TeamPlan
from minihuman.activities.team.step_clock import MS_PER_S
from minihuman.experiment.machine.life_signs import LifeSigns, SeatState

PRESENCE_RULES = "2"  # the fact "presence_rules": a wait counts from the last sign of life; before, from each step anew
_SILENT_SHARE = 2 / PINGS_PER_WAIT  # of partner_wait_s; a page without a sign for so long has missed at least one


class SeatSighting(NamedTuple):
    """The visible state of a person's seat."""

    state: SeatState
    since_s: float  # the time of the sign of life from which the state counts


class SeatNews(NamedTuple):
    """A seat whose visible state has changed."""

    seat: int
    state: SeatState
    for_s: float  # how long the state has lasted; for "here", the time since the last sign of life


@dataclass(slots=True)
class SeatPresence:
    """The presence of the person in one seat."""

    signs: LifeSigns = field(default_factory=LifeSigns)
    holder: SeatHolder = "person"  # who acts in the seat
    replaced_s: float = -math.inf  # when an agent last took the seat
    waited_since_s: float | None = None  # when the wait for the person began; earlier silence does not count

    def find_page_sign_s(self) -> float:
        """Return the time of the page's last sign of life, or else the start of the wait for it; 0 for neither."""
        since_s = self.waited_since_s or 0.0
        if self.signs.page_s is None:
            return since_s
        return self.signs.page_s

    def find_person_sign_s(self) -> float:
        """Return the time of the person's last sign of life, or of the start of the wait for them if that is later.

        It is 0 if there is neither.
        """
        since_s = self.waited_since_s or 0.0
        if self.signs.person_s is None:
            return since_s
        return max(self.signs.person_s, since_s)


class TeamPresence:
    """The presence of a team's people in their seats.

    Args:
        kinds: by seat, "person" or the name of an agent.
        rules: the protocol's ``[blocks.team]`` table.
    """

    def __init__(self, kinds: tuple[str, ...], rules: TeamPlan) -> None:
        self._rules = rules
        self._n_seats = len(kinds)
        self._seats = {seat: SeatPresence() for seat, kind in enumerate(kinds) if kind == PERSON}
        self.has_ended = False  # a partner left, and the block ends for it

    @property
    def persons(self) -> frozenset[int]:
        """Return the seats of people, whether they or an agent act in them now."""
        return frozenset(self._seats)

    @property
    def absent(self) -> frozenset[int]:
        """Return the seats of people in which the stand-in acts."""
        return frozenset(seat for seat, presence in self._seats.items() if presence.holder == "agent")

    @property
    def present(self) -> frozenset[int]:
        """Return the seats of people who act in them themselves."""
        return self.persons - self.absent

    def may_act(self, seat: int) -> bool:
        """Return whether a seat's person holds it or may take it back.

        Under the rule "watch", a person may take the seat back only if no other person acts.
        """
        match self._rules.partner_return or "seat":
            case "seat":
                return True
            case "watch" if not self.present:
                return True
        return seat not in self.absent

    def is_shut_out(self, seat: int) -> bool:
        """Return whether the block is over for a seat's person because an agent has the seat for good."""
        return self._rules.partner_return == "end" and not self.may_act(seat)

    # Signs of life

    def follow(self, seat: int, signs: LifeSigns) -> None:
        """Attach the object that holds the signs of life of a seat's page and person; the page's host updates it."""
        self._seats[seat].signs = signs

    def note_input(self, seat: int, now_s: float, *, is_held: bool = False) -> None:
        """Record an input as a sign of life of the seat's person.

        An input from a held key always counts. Any other input counts only for a page that does not report the
        person's acts itself.
        """
        signs = self._seats[seat].signs
        if is_held or not signs.tells_acts:
            signs.act(now_s)

    def has_acted(self, seat: int) -> bool:
        """Return whether a seat's person has given any sign of life since the seat's page was connected."""
        return self._seats[seat].signs.person_s is not None

    def begin_wait(self, seats: Iterable[int], now_s: float) -> None:
        """Begin to wait for seats, so that earlier silence does not count."""
        for seat in seats:
            self._seats[seat].waited_since_s = now_s

    def _begin_first_waits(self, now_s: float) -> None:
        """Begin to wait for the seats that have not been waited for yet."""
        new_seats = [seat for seat, presence in self._seats.items() if presence.waited_since_s is None]
        self.begin_wait(new_seats, now_s)

    def find_sighting(self, seat: int, now_s: float, *, is_real_time: bool) -> SeatSighting:
        """Return the visible state of a seat; in turns, a person who gives no input is thinking and counts as here."""
        presence = self._seats[seat]
        page_s = presence.find_page_sign_s()
        person_s = presence.find_person_sign_s()
        wait_s = self._rules.partner_wait_s
        if presence.signs.page != "open":
            return SeatSighting(presence.signs.page, page_s)
        if now_s - page_s >= _SILENT_SHARE * wait_s:
            return SeatSighting("silent", page_s)
        if not presence.signs.has_focus:
            return SeatSighting("unfocused", person_s)
        if is_real_time and now_s - person_s >= wait_s:
            return SeatSighting("idle", person_s)
        return SeatSighting("here", page_s)

    def measure_silence_ms(self, now_s: float, *, is_real_time: bool) -> tuple[int, ...]:
        """Return, by seat, the whole milliseconds since the sign of life from which a wait for the person counts.

        The number stays below the waiting limit while the person is waited for; it is 0 for an agent's seat. The tuple
        is empty if no seat has a page that reports its person's acts.
        """
        if not any(presence.signs.tells_acts for presence in self._seats.values()):
            return ()
        silent_ms = [0] * self._n_seats
        for seat, presence in self._seats.items():
            sighting = self.find_sighting(seat, now_s, is_real_time=is_real_time)
            since_s = sighting.since_s
            if sighting.state == "here":
                since_s = presence.find_person_sign_s()
            silent_ms[seat] = max(0, math.floor((now_s - since_s) * MS_PER_S))
        return tuple(silent_ms)

    def find_overdue(self, asking: int, now_s: float, *, is_real_time: bool) -> list[int]:
        """Return the seats whose people have been silent for the partners' waiting time, the longest absent first.

        One person always remains: if all are overdue, the seat with the latest sign of life is left out.

        Args:
            asking: the seat whose request is answered; it is left out if the latest signs are equally late.
            now_s: the present time in seconds.
            is_real_time: whether steps happen by the clock.
        """
        self._begin_first_waits(now_s)
        sightings = {seat: self.find_sighting(seat, now_s, is_real_time=is_real_time) for seat in self.present}
        overdue = [
            seat
            for seat, sighting in sightings.items()
            if sighting.state != "here" and now_s - sighting.since_s >= self._rules.partner_wait_s
        ]
        overdue.sort(key=lambda seat: (sightings[seat].since_s, seat == asking))
        if len(overdue) < len(sightings):
            return overdue
        return overdue[:-1]

    def find_thinkers(self, seats: Iterable[int], now_s: float) -> list[int]:
        """Return those of the seats whose people have given no sign of life for the limit of thinking time."""
        limit_s = self._rules.thinking_limit_s
        return [seat for seat in seats if now_s - self._seats[seat].find_person_sign_s() >= limit_s]

    def find_news(self, known_states: Sequence[SeatState], now_s: float, *, is_real_time: bool) -> SeatNews | None:
        """Return a seat whose state differs from the known state; None if no seat differs or no states are known.

        Args:
            known_states: the state of each of the team's seats as the asking seat knows it; empty if it knows none.
            now_s: the present time in seconds.
            is_real_time: whether steps happen by the clock.
        """
        if not known_states:
            return None
        self._begin_first_waits(now_s)
        for seat in self._seats:
            sighting = self.find_sighting(seat, now_s, is_real_time=is_real_time)
            if sighting.state != known_states[seat]:
                return SeatNews(seat, sighting.state, now_s - sighting.since_s)
        return None

    def has_returned(self, seat: int) -> bool:
        """Return whether a seat's person is here and has acted since an agent took the seat."""
        presence = self._seats[seat]
        acted_s = presence.signs.person_s
        return presence.signs.page == "open" and acted_s is not None and acted_s >= presence.replaced_s

    # Who holds a seat

    def take_back(self, seat: int) -> None:
        """Return a seat to its person."""
        self._seats[seat].holder = "person"

    def hand_over(self, seats: Iterable[int], now_s: float = -math.inf) -> bool:
        """Give seats to the stand-in at a time in seconds; return False if the block ends instead.

        By default the time precedes all others, so that any act of the person counts as later.
        """
        if self._rules.partner_leaves == "end":
            self.has_ended = True
            return False
        for seat in seats:
            self._seats[seat].holder = "agent"
            self._seats[seat].replaced_s = now_s
        return True

    def restore(self, absent: Iterable[int]) -> None:
        """Give the stand-in again the seats that it held when an earlier process ended."""
        for seat in absent:
            self._seats[seat].holder = "agent"
