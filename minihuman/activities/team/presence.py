"""Presence: who holds each person's seat, and how long ago its page and its person gave a sign of life. No clock.

An agent that stands in for a person holds the seat until the person may take it back; whether they may, and whether the
block goes on without them at all, the protocol says. The wait counts from the last sign of life, and no step that is
closed meanwhile restarts it.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from minihuman.activities.team.events import SeatHolder
from minihuman.activities.team.plan import PERSON, PINGS_PER_WAIT, TeamPlan
from minihuman.experiment.machine.life_signs import LifeSigns, SeatState

PRESENCE_RULES = "2"  # the fact "presence_rules": a wait counts from the last sign of life; before, from each step anew
_SILENT_SHARE = 2 / PINGS_PER_WAIT  # of that time without a word, in which a ping at least is missing


class SeatSighting(NamedTuple):
    """What is to be seen of a person's seat."""

    state: SeatState
    since_s: float  # the sign of life that it is counted from


class SeatNews(NamedTuple):
    """A seat that is seen otherwise than before."""

    seat: int
    state: SeatState
    for_s: float  # how long it has been so; of one that is here again, since its last sign of life


@dataclass(slots=True)
class SeatPresence:
    """What is known of the person of one seat."""

    signs: LifeSigns = field(default_factory=LifeSigns)
    holder: SeatHolder = "person"  # who acts in it
    replaced_s: float = -math.inf  # when an agent took it last
    waited_since_s: float | None = None  # what came before is no silence: they could not act, or nobody looked

    def find_page_sign_s(self) -> float:
        """Return the time of the page's last sign of life, or when it was first waited for."""
        since_s = self.waited_since_s or 0.0
        if self.signs.page_s is None:
            return since_s
        return self.signs.page_s

    def find_person_sign_s(self) -> float:
        """Return the time of the person's last sign of life, or when they were first waited for."""
        since_s = self.waited_since_s or 0.0
        if self.signs.person_s is None:
            return since_s
        return max(self.signs.person_s, since_s)


class TeamPresence:
    """The seats of a team's people.

    Args:
        kinds: by seat, "person" or an agent.
        rules: the protocol's ``[blocks.team]``.
    """

    def __init__(self, kinds: tuple[str, ...], rules: TeamPlan) -> None:
        self._rules = rules
        self._seats = {seat: SeatPresence() for seat, kind in enumerate(kinds) if kind == PERSON}
        self.has_ended = False  # a partner left, and the block ends for it

    @property
    def persons(self) -> frozenset[int]:
        """The seats of people, whoever acts in them now."""
        return frozenset(self._seats)

    @property
    def absent(self) -> frozenset[int]:
        """The seats of people in which the stand-in acts."""
        return frozenset(seat for seat, presence in self._seats.items() if presence.holder == "agent")

    @property
    def present(self) -> frozenset[int]:
        """The seats in which their people act."""
        return self.persons - self.absent

    def may_act(self, seat: int) -> bool:
        """Tell whether a seat is its person's, or theirs to take back.

        Who watches has the seat back if no other person acts.
        """
        match self._rules.partner_return or "seat":
            case "seat":
                return True
            case "watch" if not self.present:
                return True
        return seat not in self.absent

    def is_shut_out(self, seat: int) -> bool:
        """Tell whether the block is over for a seat's person, as an agent has the seat for good."""
        return self._rules.partner_return == "end" and not self.may_act(seat)

    # Signs of life

    def follow(self, seat: int, signs: LifeSigns) -> None:
        """Follow a seat's signs of life from here on, those of its page and person."""
        self._seats[seat].signs = signs

    def note_input(self, seat: int, now_s: float, *, is_held: bool = False) -> None:
        """Take note of an input of the person of a seat, of whom nothing else is known; ``is_held``: by a held key."""
        signs = self._seats[seat].signs
        if is_held or not signs.tells_acts:
            signs.act(now_s)

    def has_acted(self, seat: int) -> bool:
        """Tell whether the person of a seat has done anything since its signs of life are followed."""
        return self._seats[seat].signs.person_s is not None

    def begin_wait(self, seats: Iterable[int], now_s: float) -> None:
        """Begin to wait for seats: what came before is no silence of theirs."""
        for seat in seats:
            self._seats[seat].waited_since_s = now_s

    def look(self, now_s: float) -> None:
        """Begin to wait for the seats that nobody has waited for yet."""
        self.begin_wait([seat for seat, presence in self._seats.items() if presence.waited_since_s is None], now_s)

    def find_sighting(self, seat: int, now_s: float, *, is_real_time: bool) -> SeatSighting:
        """Find what is to be seen of a seat; in turns a person who gives no input thinks, and is here."""
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

    def find_overdue(self, asking: int, now_s: float, *, is_real_time: bool) -> list[int]:
        """Find the seats whose people have given no sign of life for as long as partners wait, the longest gone first.

        The last person who acts is not among them; of two with the same last sign that is the one whose seat asks.
        """
        self.look(now_s)
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
        """Find those of the seats whose people have given no sign of life for as long as they may think."""
        limit_s = self._rules.thinking_limit_s
        return [seat for seat in seats if now_s - self._seats[seat].find_person_sign_s() >= limit_s]

    def find_news(self, known: Sequence[SeatState], now_s: float, *, is_real_time: bool) -> SeatNews | None:
        """Find a seat that is not as it is known to be; None where all are, or nothing is known of any.

        Args:
            known: by seat of the team.
            now_s: the time.
            is_real_time: whether time makes the steps.
        """
        if not known:
            return None
        self.look(now_s)
        for seat in self._seats:
            sighting = self.find_sighting(seat, now_s, is_real_time=is_real_time)
            if sighting.state != known[seat]:
                return SeatNews(seat, sighting.state, now_s - sighting.since_s)
        return None

    def has_returned(self, seat: int) -> bool:
        """Tell whether the person of a seat is here, and has done something since an agent took it."""
        presence = self._seats[seat]
        acted_s = presence.signs.person_s
        return presence.signs.page == "open" and acted_s is not None and acted_s >= presence.replaced_s

    # Who holds a seat

    def take_back(self, seat: int) -> None:
        """Give a seat back to its person."""
        self._seats[seat].holder = "person"

    def hand_over(self, seats: Iterable[int], now_s: float = -math.inf) -> bool:
        """Give seats to the stand-in; False where the block ends instead."""
        if self._rules.partner_leaves == "end":
            self.has_ended = True
            return False
        for seat in seats:
            self._seats[seat].holder = "agent"
            self._seats[seat].replaced_s = now_s
        return True

    def restore(self, absent: Iterable[int]) -> None:
        """Go on from where the stand-in had these seats."""
        for seat in absent:
            self._seats[seat].holder = "agent"
